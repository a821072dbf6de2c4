"""The Pareto front."""

from hypothesis import given
from hypothesis import strategies as st
from study_rows import make_row

from warp_smoke.study.front import clearly_beats, pareto_front

POINTS = st.lists(st.tuples(st.integers(1, 6), st.integers(1, 6)), max_size=12)


@given(POINTS)
def test_front_is_what_nothing_beats(points):
    """As by comparing all pairs: a point stays if no other is at least as good in both and better in one."""
    rows = [make_row(key=str(n), median=float(t), errors={"l2": float(e)}) for n, (t, e) in enumerate(points)]
    front = {(row.median, row.errors["l2"]) for row in pareto_front(rows, "l2")}
    beats = [(t, e) for t, e in points if not any(a <= t and b <= e and (a < t or b < e) for a, b in points)]
    assert front == set(beats)


def test_front_leaves_failures_out():
    """A row that failed has no time, and stands on no front."""
    rows = [make_row(), make_row(key="failed", failure="no", median=None, errors={})]
    assert [row.key for row in pareto_front(rows, "l2")] == [rows[0].key]


def test_clearly_is_by_more_than_the_margin():
    """Better by a third in one and no worse in the other; a fifth is not clear, nor is a trade of one for the other."""
    mine = 0.1, 1.0
    assert clearly_beats((0.1, 0.7), mine)
    assert clearly_beats((0.07, 1.0), mine)
    assert not clearly_beats((0.1, 0.8), mine)
    assert not clearly_beats((0.08, 0.8), mine)
    assert not clearly_beats((0.101, 0.1), mine)
    assert not clearly_beats(mine, mine)
