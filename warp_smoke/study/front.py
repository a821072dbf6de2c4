"""The Pareto front: rows that no other row beats in both error and time; and what clearly beats what."""

from collections.abc import Iterable

from warp_smoke.study.case import Row

# Times that were taken at different moments of one machine differ by up to so much, which is no reason for a choice;
# nor is a difference in error that another stage may turn around.
MARGIN = 0.3


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


def clearly_beats(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether one setting's error or time is clearly less than another's, and the other figure no more.

    Args:
        one: error and time.
        other: error and time.
    """
    no_more = all(a <= b for a, b in zip(one, other, strict=True))
    return no_more and any(a * (1 + MARGIN) < b for a, b in zip(one, other, strict=True))
