"""Pressure: how fast each solver removes the divergence of a flow, in an empty box and around solids.

The flow to be projected is a round gust, with solids cut out of it. How far the pressure on a grid is from the exact
one is measured with p = exp(cos πx cos 2πy cos πz), whose normal derivative is zero at the walls.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import product

import numpy as np
import warp as wp

from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.operators import close_sides, measure_divergence, measure_fluid_divergence
from warp_smoke.fluid.pressure import PRESSURE_SOLVERS, PressureProblem
from warp_smoke.geometry import Mesh
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher
from warp_smoke.scene import Collider
from warp_smoke.study.case import Case, Measured, Row, fit_orders, time_repeats
from warp_smoke.study.words import by_method, duration, percent

TITLE = "Keeping air's volume: pressure solvers"
MAIN_ERROR = "residual"
ERROR_MEANS = "divergence left, relative to that before (rms)"
MANUFACTURED = "known pressure"
PANEL_ERRORS = {MANUFACTURED: ("relative_l2", "relative L2 error of the pressure")}

_CLOSED = ("closed",) * 6
_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4)
_SWEEPS = (16, 64, 256)
_MOST_ITERATIONS = 1000  # plain conjugate gradients take more than 400 on 128³
_RELAXATIONS = ("red_black", "jacobi")
# Only these problems run on large grids: on the largest with the fastest solvers alone, and from 128³ on with plain
# conjugate gradients, whose iterations grow with the cells along a side.
_LARGE, _LARGE_PROBLEMS = 256, ("empty box", "sphere")
_LARGE_SOLVERS = ("spectral", "multigrid", "spectral_conjugate_gradient")
_SLOW, _SLOW_FROM = "conjugate_gradient", 128
# Measured at 256³: 238 bytes for each cell, with the float64 fields of the residual.
_BYTES_PER_CELL = 256
# Far below the discretization error, so that only that is seen.
_TIGHT = 1e-6
_ORDER, _ORDER_MARGIN = 2.0, 0.15
# Pressures in float32 cannot reach much smaller residuals; solvers then stop at what they can reach.
_ROUND_OFF = 1e-3
_THOUSANDTH = 1e-3


def _plates(lower: tuple[float, ...], upper: tuple[float, ...], thickness: float) -> list[Mesh]:
    """Returns the six walls of a hollow box."""
    plates = []
    for axis in range(3):
        for side in (lower[axis], upper[axis] - thickness):
            corner, size = list(lower), [high - low for low, high in zip(lower, upper, strict=True)]
            corner[axis], size[axis] = side, thickness
            plates.append(Mesh.box(size, corner))
    return plates


# Meshes in the unit cube; the thin walls are thinner than any cell.
_SOLIDS: dict[str, Callable[[], list[Mesh]]] = {
    "empty box": list,
    "sphere": lambda: [_moved(Mesh.sphere(0.2), 0.5)],
    "thin walls": lambda: [
        Mesh.box((0.7, 0.004, 1.0), (0.0, 0.33, 0.0)),
        Mesh.box((0.7, 0.004, 1.0), (0.3, 0.66, 0.0)),
    ],
    "pockets": lambda: [
        *_plates((0.1, 0.1, 0.1), (0.4, 0.5, 0.4), 0.05),
        *_plates((0.55, 0.4, 0.5), (0.9, 0.8, 0.9), 0.05),
    ],
}


def _moved(mesh: Mesh, by: float) -> Mesh:
    return Mesh(mesh.points + np.float32(by), mesh.triangles)


def cases(full: bool) -> list[Case]:
    """Returns every solver on each problem, by tolerance or sweeps; `full`: also on 256³, with the fastest."""
    exact = [solver for solver in PRESSURE_SOLVERS if solver not in _RELAXATIONS]
    made = []
    for n in (32, 64, 128) if full else (64,):
        made += _projecting_cases(_SOLIDS, PRESSURE_SOLVERS, n)
    for n in (16, 32, 64, 128) if full else (16, 32, 64):
        made += [_manufactured_case(solver, n) for solver in exact]
    if full:
        made += _projecting_cases(_LARGE_PROBLEMS, _LARGE_SOLVERS, _LARGE)
        made += [_manufactured_case(solver, _LARGE) for solver in _LARGE_SOLVERS]
    return made


def _projecting_cases(problems: Iterable[str], solvers: Iterable[str], n: int) -> list[Case]:
    """Returns each problem with each solver that can solve it, at each tolerance or number of sweeps."""
    made = []
    for problem, solver in product(problems, solvers):
        if solver == _SLOW and n >= _SLOW_FROM and problem not in _LARGE_PROBLEMS:
            continue
        if solver == "spectral":
            choices = [{}] if problem == "empty box" else []
        elif solver in _RELAXATIONS:
            choices = [{"sweeps": sweeps} for sweeps in _SWEEPS]
        else:
            choices = [{"tolerance": tolerance} for tolerance in _TOLERANCES]
        made += [projecting_case(problem, solver, n, choice) for choice in choices]
    return made


def projecting_case(problem: str, solver: str, n: int, choice: dict[str, float]) -> Case:
    """Projects the gust around the solids of a problem, in a closed box of n³ cells.

    Args:
        problem: name of the solids.
        solver: name of the solver.
        n: cells along each side.
        choice: tolerance or sweeps.
    """

    def measure(launcher: Launcher, repeats: int) -> Measured:
        _check_memory(launcher, n)
        solids = _solids(launcher, problem, n)
        divergence = _divergence_of_gust(launcher, solids, n)
        pressure_problem = PressureProblem(
            shape=(n, n, n),
            sides=_CLOSED,
            solids=solids,
            tolerance=choice.get("tolerance", 0.0),
            max_iterations=int(choice.get("sweeps", _MOST_ITERATIONS)),
        )
        return _solve(launcher, solver, pressure_problem, divergence, repeats)[0]

    return Case("pressure", f"{problem}, {n}³", solver, choice, n, None, measure)


def _manufactured_case(solver: str, n: int) -> Case:
    """Solves for a pressure known everywhere, from its Laplacian."""

    def measure(launcher: Launcher, repeats: int) -> Measured:
        _check_memory(launcher, n)
        exact, laplacian = manufactured((np.arange(n) + 0.5) / n)
        divergence = launcher.array((laplacian / n**2).astype(np.float32), "divergence")
        problem = PressureProblem(shape=(n, n, n), sides=_CLOSED, tolerance=_TIGHT, max_iterations=_MOST_ITERATIONS)
        measured, pressure = _solve(launcher, solver, problem, divergence, repeats)
        found, exact = pressure - pressure.mean(), exact - exact.mean()
        errors = {"relative_l2": float(np.linalg.norm(found - exact) / np.linalg.norm(exact))}
        return Measured(errors | measured.errors, measured.seconds, measured.cells)

    tolerance = {} if solver == "spectral" else {"tolerance": _TIGHT}
    return Case("pressure", MANUFACTURED, solver, tolerance, n, None, measure)


def _check_memory(launcher: Launcher, n: int) -> None:
    """Raises MemoryError if n³ cells do not fit, so that their row says so."""
    needed, free = _BYTES_PER_CELL * n**3, launcher.available_bytes()
    if needed > free:
        raise MemoryError(f"{n}³ cells need {needed / 2**30:.1f} GiB; {free / 2**30:.1f} GiB are free")


def manufactured(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the pressure exp(cos πx cos 2πy cos πz) and its Laplacian on the grid x × x × x, [n, n, n] float64."""
    waves = np.pi * np.array([1.0, 2.0, 1.0])
    cosines = [np.cos(k * x).reshape(shape) for k, shape in zip(waves, _AXES, strict=True)]
    sines = [np.sin(k * x).reshape(shape) for k, shape in zip(waves, _AXES, strict=True)]
    product = cosines[0] * cosines[1] * cosines[2]
    slope = [-waves[axis] * sines[axis] * cosines[(axis + 1) % 3] * cosines[(axis + 2) % 3] for axis in range(3)]
    pressure = np.exp(product)
    return pressure, pressure * (sum(each**2 for each in slope) - (waves**2).sum() * product)


_AXES = ((-1, 1, 1), (1, -1, 1), (1, 1, -1))


def _solids(launcher: Launcher, problem: str, n: int) -> Solids | None:
    meshes = _SOLIDS[problem]()
    if not meshes:
        return None
    lattice = Lattice(
        shape=(n, n, n), voxel_size=1 / n, to_world=np.eye(4), meters_per_unit=1.0, sides=_CLOSED, up=(0.0, 1.0, 0.0)
    )
    colliders = [Collider(path=f"/Solid{index}", mesh=mesh) for index, mesh in enumerate(meshes)]
    solids = Solids(launcher, lattice, colliders)
    solids.update(1, 1, 0.0)
    return solids


def _divergence_of_gust(launcher: Launcher, solids: Solids | None, n: int) -> wp.array:
    """Net flow out of each cell for a round upward gust, with no flow through solids and sides."""
    shape = (n, n, n)
    velocity = tuple(launcher.zeros(face_shape(shape, axis), "velocity") for axis in range(3))
    x = (np.indices(face_shape(shape, 1)) + np.array([0.5, 0.0, 0.5]).reshape(3, 1, 1, 1)) / n
    distance = sum((each - middle) ** 2 for each, middle in zip(x, (0.45, 0.3, 0.55), strict=True))
    velocity[1].assign(np.exp(-distance / 0.15**2).astype(np.float32))
    divergence = launcher.zeros(shape, "divergence")
    if solids:
        solids.apply(velocity)
        measure_fluid_divergence(launcher, velocity, solids, divergence)
    else:
        close_sides(launcher, _CLOSED, velocity)
        measure_divergence(launcher, velocity, divergence)
    return divergence


def _solve(
    launcher: Launcher, name: str, problem: PressureProblem, divergence: wp.array, repeats: int
) -> tuple[Measured, np.ndarray]:
    """Solves from a pressure of 0; returns the measurement, and the pressure [nx, ny, nz] float64."""
    solver = PRESSURE_SOLVERS[name](launcher, problem)
    pressure, status = launcher.zeros(problem.shape, "pressure"), None

    def solve() -> None:
        nonlocal status
        pressure.zero_()
        status = solver.solve(divergence, pressure)

    seconds = time_repeats(launcher, solve, repeats)
    found = pressure.numpy().astype(float)
    residual, largest = residual_of(found, divergence.numpy(), problem.solids)
    errors = {"residual": residual, "linf": largest, "iterations": float(status.iterations)}
    return Measured(errors, seconds, found.size), found


def residual_of(pressure: np.ndarray, divergence: np.ndarray, solids: Solids | None) -> tuple[float, float]:
    """Returns the rms and largest residual r = d − Σ w (q_neighbour − q) in a closed box, relative to d's, in float64.

    In a box without solids, the mean of d, which no pressure can change, is left out.
    """
    left = divergence.astype(float)
    if solids is None:
        left -= left.mean()
    size, most = np.linalg.norm(left), np.abs(left).max()
    shares = (solids.wx, solids.wy, solids.wz) if solids else (None,) * 3
    for axis, share in enumerate(shares):
        flow = np.diff(pressure, axis=axis)
        if share is not None:
            flow *= np.moveaxis(np.moveaxis(share.numpy(), axis, 0)[1:-1], 0, axis)
        left -= np.diff(flow, axis=axis, prepend=0.0, append=0.0)
    return float(np.linalg.norm(left) / size), float(np.abs(left).max() / most)


def order(rows: Sequence[Row]) -> dict[tuple[str, str], float]:
    """Returns the slope of each solver's log error against the known pressure over log cell size."""
    return fit_orders([row for row in rows if row.problem == MANUFACTURED], "relative_l2")


def unexpected(rows: Sequence[Row]) -> list[str]:
    """Returns a line for each solver whose order is not 2, or that stops before its tolerance."""
    lines = [
        f"{problem}: {method} has order {slope:.2f}; expected {_ORDER:g} ± {_ORDER_MARGIN:g}"
        for (problem, method), slope in order(rows).items()
        if abs(slope - _ORDER) > _ORDER_MARGIN
    ]
    for row in rows:
        tolerance = row.parameters.get("tolerance", 0.0)
        if row.failure is None and tolerance >= _ROUND_OFF and row.errors["residual"] > tolerance:
            found = f"{row.method} asked for {tolerance:g} stops at {row.errors['residual']:.1e}"
            lines.append(f"{row.problem}: {found}; expected at most what was asked for")
    return lines


def explain(rows: Sequence[Row]) -> str:
    """Explains how to read the diagram, and which solver first leaves a thousandth on each problem's finest grid."""
    read = (
        "Each line is a solver that is asked for less and less divergence (its tolerance, or its number of sweeps, is "
        "written at the points): take the one whose line lies farthest to the left."
    )
    if any(row.resolution == _LARGE for row in rows):
        read += f" At {_LARGE}³ only the fastest solvers are measured, and around fewer solids."
    projected = [row for row in rows if row.problem != MANUFACTURED]
    finest = {row.problem.partition(",")[0]: row.problem for row in sorted(projected, key=lambda row: row.resolution)}
    says = []
    for problem in finest.values():
        done = {}
        for method, points in by_method(row for row in projected if row.problem == problem).items():
            within = [row.median for row in points if row.errors["residual"] <= _THOUSANDTH]
            if within:
                done[method] = min(within)
        if len(done) > 1:
            fastest, slowest = min(done, key=done.get), max(done, key=done.get)
            says.append(
                f"{fastest} in {problem} ({duration(done[fastest])}; {slowest} takes {duration(done[slowest])})"
            )
    if not says:
        return read
    text = f"{read} Here a thousandth is left first by {', '.join(says)}"
    relaxed = [row for row in projected if row.method == "jacobi"]
    if relaxed:
        worst = max(relaxed, key=lambda row: row.median)
        text += (
            f"; {worst.parameters['sweeps']:g} sweeps of jacobi still leave {percent(worst.errors['residual'])} after "
            f"{duration(worst.median)} ({worst.problem})"
        )
    return f"{text}."
