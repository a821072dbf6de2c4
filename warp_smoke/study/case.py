"""What the study measures: cases, the measurement and the row that each yields, and the interface of a suite.

A work–precision diagram shows error against time, one line for each method (E. Hairer, S. P. Nørsett, G. Wanner,
*Solving Ordinary Differential Equations I*, 1993, section II.10). Each case is one point of the diagram.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Protocol

import numpy as np

from warp_smoke.launch import Launcher

# Each row's time is the median of at least this many repeats.
REPEATS = 5


@dataclass(frozen=True)
class Measured:
    """The measurement of one case.

    Attributes:
        errors: by name of the norm (`l1`, `l2`, `linf`, `relative_l2`) or measure (`misclassified_area`, `iterations`).
        seconds: time of each repeat, without compilation and the warm-up run [s].
        cells: cells, texels or rays that one step works on, or None.
        steps: number of steps in one repeat.
        parts: number of parts of one run, each timed and scaled up to the full run; 1 where the full run is repeated.
        passes: time of each pass in a frame, by name, where known [s].
    """

    errors: Mapping[str, float]
    seconds: tuple[float, ...]
    cells: int | None
    steps: int = 1
    parts: int = 1
    passes: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """One point of a diagram.

    Attributes:
        suite: name of the suite.
        problem: what is computed; each problem has its own panel.
        method: how it is computed; each method has its own line.
        parameters: other choices, by name. Those that differ along a line are written beside its points.
        resolution: cells, texels or rays along one side.
        dt: time step [s], or None where nothing moves.
        measure: builds the arrays, runs, compares; takes the launcher and the number of repeats.
        reference: the run that errors are measured from, in words; None for a known answer.
    """

    suite: str
    problem: str
    method: str
    parameters: Mapping[str, str | float]
    resolution: int
    dt: float | None
    measure: Callable[[Launcher, int], Measured] = field(compare=False, repr=False)
    reference: str | None = None

    @property
    def key(self) -> str:
        """Identifies this case among all others, in this run and in later ones."""
        chosen = json.dumps(dict(sorted(self.parameters.items())))
        key = f"{self.suite}/{self.problem}/{self.method}/{chosen}/{self.resolution}/{self.dt}"
        return key if self.reference is None else f"{key}/{self.reference}"


@dataclass(frozen=True)
class Row:
    """A case that was measured, or failed.

    Attributes:
        suite, problem, method, parameters, resolution, dt, key, reference: the case's.
        errors: finite errors, by name.
        median, quartile_low, quartile_high: of the repeats' times [s]; None if the case raised an error.
        repeats: number of repeats.
        set_up: time of building, compiling and warming up [s].
        ns_per_cell: median time per cell and step [ns]; None if cells are not counted.
        copy_share: time to copy one float, over the time per cell: the rate as a share of the copy bandwidth.
        failure: why the row is not a valid result, or None.
        passes: time of each pass in a frame, by name, where known [s].
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
    passes: Mapping[str, float] = field(default_factory=dict)
    reference: str | None = None

    @property
    def labels(self) -> dict[str, str]:
        """The choices in words, by name: resolution, parameters and time step."""
        chosen = {"resolution": f"{self.resolution}"}
        chosen |= {name: value if isinstance(value, str) else f"{value:g}" for name, value in self.parameters.items()}
        return chosen | ({} if self.dt is None else {"dt": f"{self.dt:.3g} s"})


class Suite(Protocol):
    """The interface of a suite's module.

    Attributes:
        TITLE: heading of its diagram.
        MAIN_ERROR: the error on its y axis.
        ERROR_MEANS: label of that axis: the error in words, with its unit.

    A suite whose panels show different errors names them in `PANEL_ERRORS: Mapping[str, tuple[str, str]]`: error and
    label by problem. A suite whose times are not those of a full run labels them in `TIME_MEANS: str`. Problems in
    `TABLES: Mapping[str, str]` get a table instead of a panel; the value describes the table's first row.
    """

    TITLE: str
    MAIN_ERROR: str
    ERROR_MEANS: str

    def cases(self, full: bool) -> list[Case]:
        """Returns the cases: a selection that takes under two minutes on two cores, or (`full`) all of them."""

    def explain(self, rows: Sequence[Row]) -> str:
        """Returns two sentences on the rows without failures: how to read the diagram, and what it shows here."""

    def order(self, rows: Sequence[Row]) -> Mapping[tuple[str, str], float]:
        """Returns fitted orders by problem and method, where orders are known; may be empty."""

    def unexpected(self, rows: Sequence[Row]) -> list[str]:
        """Returns one line for each known answer that the rows miss; empty if there is none."""


def time_repeats(launcher: Launcher, action: Callable[[], object], repeats: int) -> tuple[float, ...]:
    """Returns the seconds that each call of an action takes, after one uncounted warm-up call."""
    action()
    launcher.synchronize()
    seconds = []
    for _ in range(repeats):
        began = perf_counter()
        action()
        launcher.synchronize()
        seconds.append(perf_counter() - began)
    return tuple(seconds)


def time_steps(launcher: Launcher, step: Callable[[int], object], steps: int, repeats: int) -> tuple[float, ...]:
    """Runs equal steps in `repeats` parts of equal length; returns each part's seconds, scaled up to the full run.

    Args:
        launcher: where it runs.
        step: takes the number of the step; it is compiled and warmed up already.
        steps: number in the full run, at least `repeats`.
        repeats: number of parts.
    """
    seconds, done = [], 0
    for part in range(repeats):
        end = steps * (part + 1) // repeats
        began = perf_counter()
        for number in range(done, end):
            step(number)
        launcher.synchronize()
        seconds.append((perf_counter() - began) * steps / (end - done))
        done = end
    return tuple(seconds)


def panel_error(suite: Suite, problem: str) -> tuple[str, str]:
    """Returns the error that a problem's panel shows: its name, and the label of the axis."""
    return getattr(suite, "PANEL_ERRORS", {}).get(problem, (suite.MAIN_ERROR, suite.ERROR_MEANS))


def fit_orders(rows: Sequence[Row], error: str) -> dict[tuple[str, str], float]:
    """Returns the slope of log error over log cell size by problem and method, for lines of three or more resolutions.

    Lines with a resolution that occurs twice, or with an error of 0, are left out.
    """
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
