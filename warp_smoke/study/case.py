"""What the study measures: cases, what a run of one gives, the rows that come of it, and what a suite offers.

A work–precision diagram shows error against time, one line for each method (E. Hairer, S. P. Nørsett, G. Wanner,
*Solving Ordinary Differential Equations I*, 1993, section II.10). Each case is one point of it.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Protocol

import numpy as np

from warp_smoke.launch import Launcher

# Each row's time is the median of so many repeats, or of more.
REPEATS = 5


@dataclass(frozen=True)
class Measured:
    """What one case gives.

    Attributes:
        errors: by name of the norm (`l1`, `l2`, `linf`, `relative_l2`) or measure (`misclassified_area`, `iterations`).
        seconds: of each repeat, without compilation and the first, which warms up [s].
        cells: cells, texels or rays that one step works on, or None.
        steps: that one repeat takes.
    """

    errors: Mapping[str, float]
    seconds: tuple[float, ...]
    cells: int | None
    steps: int = 1


@dataclass(frozen=True)
class Case:
    """One point of a diagram.

    Attributes:
        suite: name of the suite.
        problem: what is computed; each problem has its own panel.
        method: how; each method has its own line.
        parameters: what else was chosen, by name. What differs along a line is written beside its points.
        resolution: cells, texels or rays along one side.
        dt: time step [s], or None where nothing moves.
        measure: builds the arrays, runs, compares; takes the launcher and the number of repeats.
    """

    suite: str
    problem: str
    method: str
    parameters: Mapping[str, str | float]
    resolution: int
    dt: float | None
    measure: Callable[[Launcher, int], Measured] = field(compare=False, repr=False)

    @property
    def key(self) -> str:
        """What tells this case from all others, in this run and in later ones."""
        chosen = json.dumps(dict(sorted(self.parameters.items())))
        return f"{self.suite}/{self.problem}/{self.method}/{chosen}/{self.resolution}/{self.dt}"


@dataclass(frozen=True)
class Row:
    """A case that was measured, or failed.

    Attributes:
        suite, problem, method, parameters, resolution, dt: the case's.
        key: the case's.
        errors: by name; empty if the case raised an error.
        median, quartile_low, quartile_high: of the repeats' times [s]; None if the case raised an error.
        repeats: how many there were.
        set_up: time of building, compiling and warming up [s].
        ns_per_cell: median for each cell and step [ns]; None if nothing is counted.
        copy_share: time to copy one float, over the time for one cell: the rate as a share of the copy bandwidth.
        failure: why the row is no result, or None.
    """

    suite: str
    problem: str
    method: str
    parameters: Mapping[str, str | float]
    resolution: int
    dt: float | None
    key: str
    errors: Mapping[str, float]
    median: float | None
    quartile_low: float | None
    quartile_high: float | None
    repeats: int
    set_up: float
    ns_per_cell: float | None
    copy_share: float | None
    failure: str | None


class Suite(Protocol):
    """What a suite's module offers.

    Attributes:
        TITLE: heading of its diagram.
        MAIN_ERROR: the error on its y axis.
        ERROR_MEANS: that axis' label: the error in words, with its unit.
    """

    TITLE: str
    MAIN_ERROR: str
    ERROR_MEANS: str

    def cases(self, full: bool) -> list[Case]:
        """What is measured: the whole suite in under two minutes on two cores, or everything."""

    def explain(self, rows: Sequence[Row]) -> str:
        """Two sentences computed from the rows without failures: how to read the diagram, and what it says here."""

    def order(self, rows: Sequence[Row]) -> Mapping[tuple[str, str], float]:
        """Fitted orders by problem and method, where orders are known; may be empty."""

    def unexpected(self, rows: Sequence[Row]) -> list[str]:
        """One line for each known answer that the rows do not give; empty if all is as it should be."""


def time_repeats(launcher: Launcher, action: Callable[[], object], repeats: int) -> tuple[float, ...]:
    """Seconds of each call of an action, after one call that warms up and is not counted."""
    action()
    launcher.synchronize()
    seconds = []
    for _ in range(repeats):
        began = perf_counter()
        action()
        launcher.synchronize()
        seconds.append(perf_counter() - began)
    return tuple(seconds)


def fit_orders(rows: Sequence[Row], error: str) -> dict[tuple[str, str], float]:
    """Slope of log error over log cell size by problem and method, where there are three resolutions or more."""
    lines: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if row.failure is None:
            lines.setdefault((row.problem, row.method), []).append(row)
    orders = {}
    for line, points in lines.items():
        sizes = [row.resolution for row in points]
        errors = [row.errors[error] for row in points]
        if len(set(sizes)) >= 3 and len(set(sizes)) == len(sizes) and min(errors) > 0:
            orders[line] = -float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])
    return orders
