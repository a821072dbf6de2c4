"""The Pareto front: rows that no other row beats in both error and time."""

from collections.abc import Iterable

from warp_smoke.study.case import Row


def pareto_front(rows: Iterable[Row], error: str) -> list[Row]:
    """The rows to choose from, fastest first: each has a smaller error than all that are faster.

    Args:
        rows: of one problem; those that failed are left out.
        error: name of the error.
    """
    valid = [row for row in rows if row.failure is None]
    front: list[Row] = []
    for row in sorted(valid, key=lambda row: (row.median, row.errors[error])):
        if not front or row.errors[error] < front[-1].errors[error]:
            front.append(row)
    return front
