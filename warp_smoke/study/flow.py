"""Flow: full solver steps against a decaying vortex, a lid-driven cavity, and air that has to stay at rest."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from warp_smoke.fluid.diffusion import diffusion_number
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.fluid.solver import SmokeSolver
from warp_smoke.geometry import Mesh
from warp_smoke.launch import Launcher
from warp_smoke.plan import make_plan
from warp_smoke.scene import Emitter, Scene, SmokeDomain
from warp_smoke.study.answers import GHIA_U, GHIA_V, GHIA_X, GHIA_Y, taylor_green
from warp_smoke.study.case import Case, Measured, Row, fit_orders, time_steps
from warp_smoke.study.words import by_problem, duration, percent
from warp_smoke.timing import Timings

TITLE = "Moving air: whole steps"
MAIN_ERROR = "relative_l2"
ERROR_MEANS = "relative L2 error of the velocity"
VORTEX, REST = "decaying vortex", "air at rest under even heat"

_CLOSED = ("closed",) * 6
_VISCOSITY, _VORTEX_SECONDS = 0.1, 0.5
# Seconds until the cavity's flow no longer changes, by Reynolds number.
_CAVITY_SECONDS = {100: 15, 400: 40, 1000: 80}
PANEL_ERRORS = {REST: ("speed", "speed that is left, relative to the push")}
_HALF_STEPS = "cavity, Re 1000, half steps"  # where the error in time exceeds that in space
for _cavity in (*(f"cavity, Re {_reynolds}" for _reynolds in _CAVITY_SECONDS), _HALF_STEPS):
    PANEL_ERRORS[_cavity] = ("linf", "largest error of the velocity, relative to the lid's")
_PUSH, _REST_STEPS = 0.3, 20
_REST_CELLS = 32
_REST_TOLERANCES = (1e-1, 1e-3, 1e-5)
_PASSES = ("emit_density", "diffuse_velocity", "project_pressure", "advect_velocity", "advect_density")
# The vortex is smooth, and steps shrink with the square of the cell size; the first-order scheme then takes so many
# steps that it loses part of its order.
_ORDERS = {"semi_lagrangian": 0.75, "maccormack": 2.0, "semi_lagrangian_cubic": 2.0, "bfecc": 2.0}
_ORDER_MARGIN = 0.25
# Ghia's figures are accurate to about a hundredth, and 64² cells are enough to match them at Re 100; the thinner layers
# of faster flows need more, so there the error has to fall at least in proportion to the cell size.
_CAVITY_LIMIT, _CAVITY_CELLS = 0.02, 64


def cases(full: bool) -> list[Case]:
    """Returns every advection scheme on the vortex, two in the cavity, and all pressure solvers but Jacobi at rest."""
    made = []
    for scheme in ADVECTION_SCHEMES:
        made += [vortex_case(scheme, n) for n in ((8, 16, 32, 64, 128) if full else (8, 16, 32, 64))]
    cavities = {100: (32, 64, 128), 400: (32, 64, 128), 1000: (64, 128)} if full else {100: (16, 32, 64), 400: (32, 64)}
    for reynolds, sizes in cavities.items():
        made += [cavity_case(scheme, n, reynolds) for scheme in ("semi_lagrangian", "maccormack") for n in sizes]
    if full:
        made += [fine_cavity_case(n) for n in (64, 128)]
    made.append(_rest_case("spectral", {}))
    for solver in ("multigrid", "spectral_conjugate_gradient", "conjugate_gradient", "red_black"):
        made += [_rest_case(solver, {"tolerance": tolerance}) for tolerance in _REST_TOLERANCES]
    return made


def _square(n: int, solver: type[SmokeSolver], launcher: Launcher, **domain) -> SmokeSolver:
    """Returns a solver of a unit square of 1 × n × n cells that hold only air; its x and y run along j and k."""
    box = SmokeDomain(path="/Air", lower=(0, 0, 0), upper=(1 / n, 1, 1), resolution=n, active_box=False, **domain)
    emitter = Emitter(path="/Source", mesh=Mesh.box(4.0))
    (plan,) = make_plan(Scene(domains=[box], emitters=[emitter])).domains
    return solver(launcher, replace(plan, passes=_PASSES, emitters=()), Timings(launcher))


def vortex_case(scheme: str, n: int) -> Case:
    """The Taylor–Green vortex at ν = 0.1 m²/s for half a second, with time steps proportional to h²."""
    steps = 5 * (n // 8) ** 2
    dt = _VORTEX_SECONDS / steps

    def measure(launcher: Launcher, repeats: int) -> Measured:
        solver = _square(n, SmokeSolver, launcher, boundary=_CLOSED, viscosity=_VISCOSITY, advection=scheme)

        def start() -> None:
            for component, exact in zip(solver.state.velocity[1:], _vortex(n, 0.0), strict=True):
                component.assign(exact[None].astype(np.float32))

        start()
        solver.step(1, 2, dt)  # warms up
        start()
        solver.state.pressure.zero_()
        seconds = time_steps(launcher, lambda _: solver.step(1, 2, dt), steps, repeats)
        found = np.concatenate([component.numpy()[0].ravel() for component in solver.state.velocity[1:]]).astype(float)
        exact = np.concatenate([component.ravel() for component in _vortex(n, _VORTEX_SECONDS)])
        difference = found - exact
        errors = {
            "relative_l2": float(np.linalg.norm(difference) / np.linalg.norm(exact)),
            "l2": float(np.sqrt((difference**2).mean())),
            "l1": float(np.abs(difference).mean()),
            "linf": float(np.abs(difference).max()),
        }
        return Measured(errors, seconds, n * n, steps, repeats)

    return Case("flow", VORTEX, scheme, {"viscosity": _VISCOSITY}, n, dt, measure)


def _vortex(n: int, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns the exact velocity along j on [n + 1, n] faces, and along k on [n, n + 1]."""
    face, cell = np.arange(n + 1) / n, (np.arange(n) + 0.5) / n
    u = taylor_green(face[:, None], cell[None], _VISCOSITY, time)[0]
    v = taylor_green(cell[:, None], face[None], _VISCOSITY, time)[1]
    return u, v


class _Cavity(SmokeSolver):
    """A box whose upper side moves along +j with speed 1 and drags viscous air along."""

    def _diffuse_velocity(self, dt: float) -> float:
        pull = 2.0 * diffusion_number(self._domain.viscosity, dt, self._lattice.h)
        component = self.state.velocity[1]
        values = component.numpy().copy()
        values[:, 1:-1, -1] += pull
        component.assign(values)
        return super()._diffuse_velocity(dt)


def cavity_case(scheme: str, n: int, reynolds: int) -> Case:
    """Ghia's cavity from rest until nothing changes, at Courant number 1."""
    return _cavity_case(f"cavity, Re {reynolds}", scheme, n, reynolds, 1 / n)


def fine_cavity_case(n: int) -> Case:
    """The cavity at Re 1000 by MacCormack at Courant number ½."""
    return _cavity_case(_HALF_STEPS, "maccormack", n, 1000, 0.5 / n)


def _cavity_case(problem: str, scheme: str, n: int, reynolds: int, dt: float) -> Case:
    steps = round(_CAVITY_SECONDS[reynolds] / dt)

    def measure(launcher: Launcher, repeats: int) -> Measured:
        boundary = ("closed",) * 2 + ("no_slip",) * 4
        solver = _square(n, _Cavity, launcher, boundary=boundary, viscosity=1 / reynolds, advection=scheme)
        solver.step(1, 2, dt)  # warms up, and is the first step towards the steady state
        seconds = time_steps(launcher, lambda _: solver.step(1, 2, dt), steps, repeats)
        u, v = (component.numpy()[0].astype(float) for component in solver.state.velocity[1:])
        cell = (np.arange(n) + 0.5) / n
        along_y = np.interp(GHIA_Y, cell, u[n // 2]) - GHIA_U[reynolds]
        along_x = np.interp(GHIA_X, cell, v[:, n // 2]) - GHIA_V[reynolds]
        off = np.concatenate([along_y, along_x[np.isfinite(along_x)]])
        errors = {"linf": float(np.abs(off).max()), "l2": float(np.sqrt((off**2).mean()))}
        return Measured(errors, seconds, n * n, steps, repeats)

    return Case("flow", problem, scheme, {"viscosity": 1 / reynolds}, n, dt, measure)


def _rest_case(solver_name: str, choice: dict[str, float]) -> Case:
    """A closed box of hot air on which buoyancy pushes uniformly: pressure has to balance all of it."""
    n, dt = _REST_CELLS, 0.1

    def measure(launcher: Launcher, repeats: int) -> Measured:
        domain = SmokeDomain(
            path="/Air",
            resolution=n,
            boundary=_CLOSED,
            buoyancy_temperature=_PUSH / dt,
            pressure_solver=solver_name,
            pressure_tolerance=choice.get("tolerance"),
            active_box=False,
        )
        emitter = Emitter(path="/Source", mesh=Mesh.box(4.0))
        (plan,) = make_plan(Scene(domains=[domain], emitters=[emitter])).domains
        solver = SmokeSolver(launcher, plan, Timings(launcher))
        solver.begin(1)
        solver.step(1, 2, dt)  # warms up
        for field in (*solver.state.velocity, solver.state.pressure):
            field.zero_()

        def step(number: int) -> None:
            solver.state.pressure.zero_()  # else the first step's pressure would already solve the others
            solver.step(number + 1, number + 2, dt)

        seconds = time_steps(launcher, step, _REST_STEPS, repeats)
        fastest = max(float(np.abs(component.numpy()).max()) for component in solver.state.velocity)
        return Measured({"speed": fastest / _PUSH}, seconds, n**3, _REST_STEPS, repeats)

    return Case("flow", REST, solver_name, choice, n, dt, measure)


def order(rows: Sequence[Row]) -> dict[tuple[str, str], float]:
    """Returns the slope of the vortex's log error over log cell size for each scheme."""
    return fit_orders([row for row in rows if row.problem == VORTEX], MAIN_ERROR)


def unexpected(rows: Sequence[Row]) -> list[str]:
    """Returns a line for each scheme off its order, each cavity far from Ghia's, and each solver that lets air move."""
    lines = [
        f"{problem}: {method} has order {slope:.2f}; expected {_ORDERS[method]:g} ± {_ORDER_MARGIN:g}"
        for (problem, method), slope in order(rows).items()
        if method in _ORDERS and abs(slope - _ORDERS[method]) > _ORDER_MARGIN
    ]
    cavities = {}
    for row in rows:
        if row.failure is not None:
            continue
        if row.problem.startswith("cavity") and row.method == "maccormack":
            cavities.setdefault(row.problem, []).append((row.resolution, row.errors["linf"]))
        if row.problem == "cavity, Re 100" and row.method == "maccormack" and row.resolution >= _CAVITY_CELLS:
            if row.errors["linf"] > _CAVITY_LIMIT:
                lines.append(
                    f"{row.problem}: off Ghia's velocity by {row.errors['linf']:.3f}; expected {_CAVITY_LIMIT:g}"
                )
        elif row.problem == REST and row.errors["speed"] > _still(row):
            lines.append(f"{REST}: {row.method} leaves {row.errors['speed']:.1e}; expected at most {_still(row):.0e}")
    for problem, found in cavities.items():
        for (coarse, before), (fine, after) in pairwise(sorted(found)):
            if after > max(_CAVITY_LIMIT, before * coarse / fine):
                fell = f"from {before:.3f} on {coarse}² to {after:.3f} on {fine}² cells"
                lines.append(f"{problem}: the error goes {fell}; expected to fall like the cells' size")
    return lines


def _still(row: Row) -> float:
    """Returns the relative speed that round-off or the solver's tolerance may leave, summed over all steps."""
    return max(1e-4, _REST_STEPS * float(row.parameters.get("tolerance", 0.0)))


def explain(rows: Sequence[Row]) -> str:
    """Explains how to read the diagram, and what the orders and the cavity show."""
    read = (
        "Each line is a way to step the air on finer and finer grids (in the last panel, with a smaller and smaller "
        "tolerance), against flows whose velocity is known: the lower and the further left, the better."
    )
    slopes = {method: slope for (_, method), slope in order(rows).items()}
    vortex = by_problem(rows).get(VORTEX, [])
    if len(slopes) < 2 or not vortex:
        return read
    finest = max(row.resolution for row in vortex)
    there = sorted((row for row in vortex if row.resolution == finest), key=lambda row: row.errors[MAIN_ERROR])
    best, worst = there[0], there[-1]
    says = (
        f"Here {best.method} has order {slopes[best.method]:.1f} and {worst.method} {slopes[worst.method]:.1f}: on "
        f"{finest}² cells their vortices are off by {percent(best.errors[MAIN_ERROR])} ({duration(best.median)}) and "
        f"{percent(worst.errors[MAIN_ERROR])} ({duration(worst.median)})"
    )
    within = []
    for problem, found in by_problem(rows).items():
        if problem.startswith("cavity"):
            nearest = min(found, key=lambda row: row.errors["linf"])
            where = f"{problem.removeprefix('cavity, ')}, {nearest.method}, {nearest.resolution}²"
            within.append(f"{percent(nearest.errors['linf'])} ({where})")
    if within:
        says += f"; the velocity in the cavity is off Ghia's by at most {', '.join(within)}"
    return f"{read} {says}."
