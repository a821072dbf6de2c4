"""Summaries for the page and the documentation: costs of effects, times of passes, methods not worth using."""

from collections.abc import Sequence
from typing import NamedTuple

from warp_smoke.study.case import Row, Suite, panel_error
from warp_smoke.study.front import pareto_front
from warp_smoke.study.words import by_problem, number

# Passes that take less than this share of a frame are left out.
_LEAST_SHARE = 0.01


class EffectCost(NamedTuple):
    """What an effect costs.

    Attributes:
        effect: its name.
        seconds: time that a frame saves without it [s].
        share: the same as a share of a frame with everything.
        changes: how far the last frame without it is from that with everything, by name of the error.
    """

    effect: str
    seconds: float
    share: float
    changes: dict[str, float]


def effect_costs(rows: Sequence[Row]) -> list[EffectCost]:
    """Returns each effect's cost, most expensive first, from the row with everything and those without one effect."""
    whole, *others = rows
    costs = []
    for row in others:
        if row.failure is None and whole.failure is None:
            saved = whole.median - row.median
            costs.append(EffectCost(row.method, saved, saved / whole.median, dict(row.errors)))
    return sorted(costs, key=lambda cost: -cost.seconds)


def pass_times(row: Row) -> list[tuple[str, float]]:
    """Returns the passes that take a noticeable share of a frame, and their times [s], longest first."""
    total = sum(row.passes.values())
    large = [item for item in row.passes.items() if item[1] > _LEAST_SHARE * total]
    return sorted(large, key=lambda item: -item[1])


def never_worth(suite: Suite, rows: Sequence[Row]) -> list[str]:
    """Returns the methods that are beaten in both error and time at each of their points, in every panel."""
    worth = set()
    for problem, found in by_problem(rows).items():
        worth |= {row.method for row in pareto_front(found, panel_error(suite, problem)[0])}
    return [
        method for method in dict.fromkeys(row.method for row in rows if row.failure is None) if method not in worth
    ]


def order_lines(suite: Suite, rows: Sequence[Row]) -> list[str]:
    """Returns the fitted orders, a line for each problem."""
    lines: dict[str, list[str]] = {}
    for (problem, method), slope in suite.order([row for row in rows if row.failure is None]).items():
        lines.setdefault(problem, []).append(f"{method} {number(slope, '.2f')}")
    return [f"{problem}: {' · '.join(found)}" for problem, found in lines.items()]
