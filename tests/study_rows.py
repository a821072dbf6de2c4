"""Rows that tests of the study share, and a suite that measures nothing."""

from dataclasses import replace
from types import SimpleNamespace

from warp_smoke.study.case import Case, Measured, Row

_ROW = Row(
    suite="s",
    problem="p",
    method="m",
    parameters={},
    resolution=8,
    dt=None,
    key="",
    errors={"l2": 0.1},
    median=1.0,
    quartile_low=0.9,
    quartile_high=1.2,
    repeats=5,
    set_up=0.1,
    ns_per_cell=10.0,
    copy_share=0.05,
    failure=None,
)


def make_row(**fields) -> Row:
    """A row with some of its fields set, and a key of its own."""
    row = replace(_ROW, **fields)
    return row if row.key else replace(row, key=f"{row.suite}/{row.problem}/{row.method}/{row.resolution}/{row.median}")


class FakeSuite(SimpleNamespace):
    """A suite of cases whose errors and times are given; `reference` is what the errors are measured from."""

    TITLE, MAIN_ERROR, ERROR_MEANS = "A suite", "l2", "error"

    def __init__(self, results: dict[str, tuple[float, float]]):
        super().__init__(results=results, measured=[], reference=None)

    def cases(self, full):
        """One for each method, in the place of the suite flow."""
        return [
            Case("flow", "p", method, {}, 8, None, self._measure(method), self.reference) for method in self.results
        ]

    def _measure(self, method):
        def measure(launcher, repeats):
            self.measured.append(method)
            error, seconds = self.results[method]
            if error is None:
                raise ValueError("it went wrong")
            return Measured({"l2": error}, (seconds,) * repeats, 8)

        return measure

    def explain(self, rows):
        """Two sentences."""
        return "Read it so. It says that."

    def order(self, rows):
        """None."""
        return {}

    def unexpected(self, rows):
        """None."""
        return []
