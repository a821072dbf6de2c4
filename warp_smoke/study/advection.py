"""Advection: smoke is carried around and back to where it began, so that the initial state is the exact answer.

A cosine hill is rotated once in a plane, and a ball of smoke is deformed and restored (R. J. LeVeque, 1996).
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import warp as wp

from warp_smoke.fluid.advection import SemiLagrangian
from warp_smoke.fluid.cubic import CubicSemiLagrangian
from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.runge_kutta import TRACES
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.fluid.unlimited import UNLIMITED_SCHEMES
from warp_smoke.launch import Launcher
from warp_smoke.study.answers import cosine_hill, deformation
from warp_smoke.study.case import Case, Measured, Row, fit_orders, time_steps
from warp_smoke.study.words import best_at, by_problem, duration, number, percent

TITLE = "Carrying smoke along: advection schemes"
MAIN_ERROR = "relative_l2"
ERROR_MEANS = "relative L2 error of the density"

HILL, TORN, STEPS = "hill, turned once", "ball, torn and brought back", "hill, by length of step"
TRACE = "hill, by trace (cubic)"
UNLIMITED = {f"{name}, unlimited": scheme for name, scheme in UNLIMITED_SCHEMES.items()}
Scheme = Callable[[Launcher, tuple[int, int, int], tuple[str, ...]], SemiLagrangian]
# The most cells that smoke is carried in a step.
_COURANT = 1.0
_SWEPT = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
_TRACED = (1.0, 2.0, 4.0, 8.0, 16.0)
# Cells across the hill's plane, along which nothing varies; two, so that two threads share the work.
_THICKNESS = 2
_RADIUS = 0.25
# The time in which the ball is deformed and restored [s], and the largest speed [m/s].
_PERIOD, _FASTEST = 1.5, 2.0
_BALL = (0.35, 0.35, 0.35)

# Below the orders for smooth fields, 1 and 2: the curvature of the hill jumps at its foot, which lowers second order
# to 5/3 (P. Brenner, V. Thomée, L. B. Wahlbin, 1975); limiters cost MacCormack more at the hill's top, unlimited
# BFECC amplifies values at the border, which the hill touches, and the first-order scheme smears the hill so much
# that its error has little room to grow.
_LEAST_ORDER = {
    "semi_lagrangian": 0.4,
    "semi_lagrangian_cubic": 1.65,
    "maccormack": 1.5,
    "bfecc": 1.65,
    "semi_lagrangian_cubic, unlimited": 1.65,
    "maccormack, unlimited": 1.65,
    "bfecc, unlimited": 1.5,
}
# How far float32 rounding may exceed the initial range, 0 to 1.
_ROUND_OFF = 1e-6


def cases(full: bool) -> list[Case]:
    """Returns every scheme on each problem, with and without limiters, and sweeps over step lengths and traces."""
    planes, cubes = ((32, 64, 128, 256), (32, 64, 128)) if full else ((32, 64, 128), (32, 48, 64))
    swept = 128 if full else 64
    made = []
    for method, scheme in (ADVECTION_SCHEMES | UNLIMITED).items():
        made += [turning_case(HILL, method, scheme, n, _COURANT) for n in planes]
        made += [_torn_case(method, scheme, n) for n in cubes]
    for method, scheme in ADVECTION_SCHEMES.items():
        made += [turning_case(STEPS, method, scheme, swept, courant) for courant in _SWEPT]
    for trace in TRACES:
        scheme = partial(CubicSemiLagrangian, trace=trace)
        made += [turning_case(TRACE, trace, scheme, swept, courant) for courant in _TRACED]
    return made


def turning_case(problem: str, method: str, scheme: Scheme, n: int, courant: float) -> Case:
    """Rotates a cosine hill at (½, ¾) in a unit square of n × n cells once about the middle.

    Args:
        problem: name of the problem.
        method: name of the scheme.
        scheme: creates it.
        n: cells along the square's side.
        courant: cells that the flow moves in a step at the middle of a side.
    """
    steps = round(np.pi * n / courant)

    def measure(launcher: Launcher, repeats: int) -> Measured:
        x = (np.arange(n) + 0.5) / n
        hill = cosine_hill(np.hypot(x[:, None] - 0.5, x[None, :] - 0.75), _RADIUS)
        start = np.repeat(hill[None].astype(np.float32), _THICKNESS, axis=0)
        velocity = _sample_velocity(launcher, start.shape, lambda x, y, z: (0.0, 0.5 - z, y - 0.5))
        lengths = [2 * np.pi * n / steps] * steps
        return _carry(launcher, scheme, start, ("open",) * 6, velocity, lengths, repeats)

    return Case("advection", problem, method, {"courant": courant}, n, 2 * np.pi / steps, measure)


def _torn_case(method: str, scheme: Scheme, n: int) -> Case:
    """Deforms a spherical cosine hill in a unit cube of n³ cells by LeVeque's flow, which then restores it."""
    steps = round(_PERIOD * _FASTEST * n / _COURANT)
    dt = _PERIOD / steps

    def measure(launcher: Launcher, repeats: int) -> Measured:
        x = [(np.indices((n, n, n))[axis] + 0.5) / n - _BALL[axis] for axis in range(3)]
        start = cosine_hill(np.sqrt(sum(each**2 for each in x)), _RADIUS).astype(np.float32)
        velocity = _sample_velocity(launcher, start.shape, deformation)
        lengths = [dt * n * np.cos(np.pi * (step + 0.5) / steps) for step in range(steps)]
        return _carry(launcher, scheme, start, ("closed",) * 6, velocity, lengths, repeats)

    return Case("advection", TORN, method, {"courant": _COURANT}, n, dt, measure)


def _sample_velocity(launcher: Launcher, shape: tuple[int, int, int], flow: Callable) -> tuple[wp.array, ...]:
    """Samples u, v and w of a flow on the faces of a box whose longest side is 1."""
    components = []
    for axis in range(3):
        points = np.indices(face_shape(shape, axis)) + 0.5
        points[axis] -= 0.5
        component = np.broadcast_to(flow(*(points / max(shape)))[axis], points.shape[1:])
        components.append(launcher.array(np.ascontiguousarray(component, np.float32), "velocity"))
    return tuple(components)


def _carry(
    launcher: Launcher,
    scheme: Scheme,
    start: np.ndarray,
    sides: tuple[str, ...],
    velocity: tuple,
    lengths: list[float],
    repeats: int,
) -> Measured:
    """Advects a density by a flow that returns it to where it began.

    Args:
        launcher: where it runs.
        scheme: creates the scheme.
        start: the initial density.
        sides: open or closed for each of -x +x -y +y -z +z.
        velocity: u, v, w [m/s].
        lengths: dt / h of each step [s/m].
        repeats: number of timings.
    """
    advection = scheme(launcher, start.shape, sides)
    density = launcher.array(start, "density")

    def step(number: int) -> None:
        nonlocal density
        advection.trace(velocity, lengths[number])
        density = advection.advect_scalar(density, 0.0)

    step(0)  # warms up
    density.assign(start)
    seconds = time_steps(launcher, step, len(lengths), repeats)
    return Measured(density_errors(density.numpy(), start), seconds, start.size, len(lengths), repeats)


def density_errors(found: np.ndarray, exact: np.ndarray) -> dict[str, float]:
    """Returns norms of the difference (l1 and l2 as means over cells), the mass drift, and the range of `found`."""
    found, exact = found.astype(float), exact.astype(float)
    difference = found - exact
    return {
        "l1": float(np.abs(difference).mean()),
        "l2": float(np.sqrt((difference**2).mean())),
        "linf": float(np.abs(difference).max()),
        "relative_l2": float(np.linalg.norm(difference) / np.linalg.norm(exact)),
        "mass_drift": float(found.sum() / exact.sum() - 1.0),
        "least": float(found.min()),
        "most": float(found.max()),
    }


def order(rows: Sequence[Row]) -> dict[tuple[str, str], float]:
    """Returns the slope of log error over log cell size for each problem and method."""
    return fit_orders([row for row in rows if row.problem in (HILL, TORN)], MAIN_ERROR)


def unexpected(rows: Sequence[Row]) -> list[str]:
    """Returns a line for each scheme that misses its order on the hill or leaves the initial range."""
    lines = []
    for (problem, method), slope in order(rows).items():
        if problem == HILL and slope < _LEAST_ORDER[method]:
            lines.append(f"{problem}: {method} has order {slope:.2f}; expected at least {_LEAST_ORDER[method]:g}")
    for row in rows:
        if row.failure is None and row.method not in UNLIMITED:
            least, most = row.errors["least"], row.errors["most"]
            if least < -_ROUND_OFF or most > 1 + _ROUND_OFF:
                found = f"{row.method} at {row.resolution} gives {least:.3g} to {most:.3g}"
                lines.append(f"{row.problem}: {found}; expected within 0 to 1")
    return lines


def explain(rows: Sequence[Row]) -> str:
    """Explains how to read the diagram, and which scheme reaches a given error first."""
    read = (
        "Each line is a scheme on finer and finer grids, or with longer and longer steps in the panel that says so: "
        "the lower and the further left, the better."
    )
    problems = by_problem(rows)
    slopes = {method: slope for (problem, method), slope in order(rows).items() if problem == HILL}
    if len(slopes) < 2:
        return read
    steep, flat = max(slopes, key=slopes.get), min(slopes, key=slopes.get)
    lowest = min((row.errors["least"] for row in rows if row.failure is None and row.method in UNLIMITED), default=0.0)
    target, fastest, times = best_at(problems[HILL], MAIN_ERROR)
    says = (
        f"Here half the cell divides the error of {steep} by {2 ** slopes[steep]:.1f} and that of {flat} by "
        f"{2 ** slopes[flat]:.1f}; {fastest} is the first to reach {percent(target)} ({duration(times[fastest])})"
    )
    if lowest < -_ROUND_OFF:
        says += f"; without limits there is negative smoke, down to {number(lowest, '.2g')}"
    swept = [row for row in problems.get(STEPS, []) if row.method == flat]
    if len(swept) > 1:
        short, long = (pick(swept, key=lambda row: row.parameters["courant"]) for pick in (min, max))
        says += (
            f", and a Courant number of {short.parameters['courant']:g} instead of {long.parameters['courant']:g} "
            f"changes the error of {flat} from {percent(long.errors[MAIN_ERROR])} to "
            f"{percent(short.errors[MAIN_ERROR])} in {short.median / long.median:.0f} times the time"
        )
    return f"{read} {says}."
