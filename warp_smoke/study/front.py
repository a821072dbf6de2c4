"""The Pareto front: rows that no other row beats in both error and time; and which settings clearly beat others."""

from collections.abc import Iterable

from warp_smoke.study.case import Row

# Times taken at different moments on one machine differ by up to this share, which is no reason for a choice; nor is
# a difference in error that another stage may reverse.
MARGIN = 0.3


def pareto_front(rows: Iterable[Row], error: str) -> list[Row]:
    """Returns the rows to choose from, fastest first: each has a smaller error than all that are faster.

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
    """Returns whether one setting's error or time is clearly less than another's, and its other figure no larger.

    Args:
        one: error and time.
        other: error and time.
    """
    no_more = all(a <= b for a, b in zip(one, other, strict=True))
    return no_more and any(a * (1 + MARGIN) < b for a, b in zip(one, other, strict=True))
