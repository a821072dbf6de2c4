"""Shadows of smoke: closed forms, a plume against fine rays, and energy diffusion against diffusion itself.

Receivers are some ten thousand points behind the smoke; a repeat fills the light buffer and looks all of them up, and
its time is divided by the smoke's cells, or by the texels where only a buffer is diffused.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import warp as wp

from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher
from warp_smoke.scene import DistantLight, Light
from warp_smoke.shadow.diffusion import Diffusion
from warp_smoke.shadow.methods import SMOKE_SHADOWS
from warp_smoke.shadow.splats import SPLATS
from warp_smoke.study.case import Case, Measured, Row, fit_orders, time_repeats
from warp_smoke.study.known_smoke import KNOWN_SMOKE, known_density
from warp_smoke.study.light_answers import difference, implicit_step, spread_gaussian, variance
from warp_smoke.study.smoke_plume import EXTINCTION, ORIGIN, RESOLUTION, plume_frame
from warp_smoke.study.words import duration, percent

SUITE = "smoke_shadow"
TITLE = "Shadows of smoke"
MAIN_ERROR = "relative_l2"
ERROR_MEANS = "error of the light let through, as a share of the shadow (root mean square)"

# Fields of the light by the name of the method.
_BUFFERS = {name: {"smoke_shadow": name} for name in ("march", *SPLATS)}
METHODS = {
    **_BUFFERS,
    "dpd": {"smoke_shadow": "dpd"},
    "dpd, true rays, transmittance": {
        "smoke_shadow": "dpd",
        "smoke_projection": "rays",
        "smoke_compositing": "transmittance",
    },
    "ray_traced": {"smoke_shadow": "ray_traced"},
}
_DIFFUSERS = ("paper", "sweeps", "exact")
_DIFFUSION = 1.0  # r of the diffused plume
# The diffused Gaussian: variance and νt in a unit square.
_VARIANCE, _SPREAD = 0.0064, 1.0 / 1024.0
_SQUARES = 129
_CLOSE = 0.05  # an error that explanations call close
# For each r of equation (3), the implicit step is compared after 1, 2, 4, … sweeps, up to this power of two.
_SWEEPS = {0.05: 2, 0.25: 4, 1.0: 6, 10.0: 9}
GAUSSIAN = "Gaussian, diffused"


def _step(r: float) -> str:
    return f"implicit step, r = {r:g}"


PANEL_ERRORS = {GAUSSIAN: (MAIN_ERROR, "relative L2 error of the buffer")} | {
    _step(r): ("l1_distance", "sum of the kernel's absolute errors") for r in _SWEEPS
}


def cases(full: bool) -> list[Case]:
    """Returns closed forms and buffers on 16³ to 64³ cells (`full`: 128³), buffers of 24² to 96² texels (192²)."""
    found = []
    for problem in KNOWN_SMOKE:
        for method in METHODS:
            for cells in (16, 32, 64, *[128] * full):
                found.append(_case(problem, method, {}, cells, partial(_measure_known, problem, method, cells)))
    texels = (24, 48, 96, *[192] * full)
    for method, fields in METHODS.items():
        if method != "ray_traced":
            found += [_plume_case("plume", method, fields, size) for size in texels]
    for cells_a_step in (2.0, 1.0, 0.5):
        measure = partial(_measure_plume, METHODS["ray_traced"], None, {"step": cells_a_step})
        found.append(_case("plume", "ray_traced", {"step": cells_a_step}, RESOLUTION, measure))
    for method, fields in _BUFFERS.items():
        for diffuser in _DIFFUSERS:
            spread = fields | {"smoke_diffusion": _DIFFUSION, "smoke_diffuser": diffuser}
            problem = f"plume, diffused by r = {_DIFFUSION:g}, {diffuser}"
            found += [_plume_case(problem, method, spread, size) for size in texels]
    for diffuser in _DIFFUSERS:
        for size in (16, 32, 64, 128, *[256] * full):
            measure = partial(_measure_gaussian, diffuser, size)
            found.append(_case(GAUSSIAN, diffuser, {}, size, measure))
    for r, most in _SWEEPS.items():
        for sweeps in [2**n for n in range(most + 1)]:
            found.append(_case(_step(r), "sweeps", {"sweeps": sweeps}, _SQUARES, partial(_measure_point, r, sweeps)))
        found.append(_case(_step(r), "paper", {}, _SQUARES, partial(_measure_point, r, None)))
    return found


def _case(problem: str, method: str, parameters: dict, resolution: int, measure: Callable) -> Case:
    return Case(SUITE, problem, method, parameters, resolution, None, measure)


def _plume_case(problem: str, name: str, fields: dict, size: int) -> Case:
    return _case(problem, name, {}, size, partial(_measure_plume, fields, size, {}))


def _look_up(
    launcher: Launcher,
    lattice: Lattice,
    light: Light,
    extinction: float,
    density: np.ndarray,
    points: np.ndarray,
    repeats: int,
    options: Mapping[str, float],
) -> tuple[object, np.ndarray, tuple[float, ...]]:
    """Returns the shadow, the share of light at each point, and the seconds of each repeat."""
    shadow = SMOKE_SHADOWS[light.smoke_shadow](launcher, lattice, light, ORIGIN, extinction, **options)
    smoke = launcher.array(density.astype(np.float32), "study")
    places = launcher.array(points.astype(np.float32), "study", dtype=wp.vec3)
    shares = launcher.zeros((1, len(points)), "study")

    def update_and_look_up() -> None:
        shares.fill_(1.0)
        shadow.update(smoke, 1.0)
        shadow.transmittance(places, shares)

    seconds = time_repeats(launcher, update_and_look_up, repeats)
    return shadow, shares.numpy()[0].astype(float), seconds


def _measure_known(problem: str, method: str, cells: int, launcher: Launcher, repeats: int) -> Measured:
    known = KNOWN_SMOKE[problem]()
    light, (lattice, density) = replace(known.light, **METHODS[method]), known_density(problem, cells)
    args = (launcher, lattice, light, known.extinction, density, known.points, repeats, {})
    shadow, found, seconds = _look_up(*args)
    truth = np.exp(-known.depth)
    errors = difference(found, truth, float(np.sqrt(np.mean((1.0 - truth) ** 2))))
    if method in _BUFFERS and isinstance(light, DistantLight):
        # For parallel rays Σ τ A over the buffer is σ times the mass.
        area = (shadow.buffer.texel * lattice.h) ** 2 * np.abs(light.direction_at(1.0)).max()
        total = shadow.optical_depth()[-1].sum(dtype=float) * area
        errors["mass"] = abs(total / (known.extinction * density.sum() * lattice.h**3) - 1.0)
    return Measured(errors, seconds, lattice.cells)


def _measure_plume(
    fields: Mapping[str, object], size: int | None, options: Mapping[str, float], launcher: Launcher, repeats: int
) -> Measured:
    plume = plume_frame(launcher.device.alias)
    light = replace(plume.lamp, smoke_shadow_size=size, **fields)
    args = (launcher, plume.lattice, light, EXTINCTION, plume.density, plume.floor, repeats, options)
    _, found, seconds = _look_up(*args)
    errors = difference(found, plume.truth, float(np.sqrt(np.mean((1.0 - plume.truth) ** 2))))
    return Measured(errors, seconds, plume.lattice.cells)


def _spread(
    launcher: Launcher, u: np.ndarray, r: float, diffuser: str, sweeps: int | None, repeats: int
) -> tuple[np.ndarray, tuple[float, ...]]:
    """Returns a buffer [w, h] after diffusion, and the seconds of each repeat."""
    buffer = launcher.array(u[None].astype(np.float32), "study")
    diffusion = Diffusion(launcher, buffer.shape, r, diffuser, sweeps)
    seconds = time_repeats(launcher, lambda: diffusion.spread(buffer), repeats)
    return diffusion.spread(buffer).numpy()[0].astype(float), seconds


def _measure_gaussian(diffuser: str, size: int, launcher: Launcher, repeats: int) -> Measured:
    x = (np.arange(size) + 0.5) / size - 0.5
    squares, r = np.add.outer(x**2, x**2), _SPREAD * size**2
    u = spread_gaussian(squares, _VARIANCE, 0.0)
    found, seconds = _spread(launcher, u, r, diffuser, None, repeats)
    errors = difference(found, spread_gaussian(squares, _VARIANCE, 2.0 * _SPREAD))
    errors["variance_kept"] = (variance(found) - variance(u)) / (2.0 * r)
    return Measured(errors, seconds, size**2)


def _measure_point(r: float, sweeps: int | None, launcher: Launcher, repeats: int) -> Measured:
    u = np.zeros((_SQUARES, _SQUARES))
    u[_SQUARES // 2, _SQUARES // 2] = 1.0
    found, seconds = _spread(launcher, u, r, "paper" if sweeps is None else "sweeps", sweeps, repeats)
    truth = implicit_step(u, r)
    errors = difference(found, truth)
    errors["l1_distance"] = float(np.abs(found - truth).sum())
    errors["variance_kept"] = variance(found) / (2.0 * r)
    return Measured(errors, seconds, _SQUARES**2)


def order(rows: Sequence[Row]) -> Mapping[tuple[str, str], float]:
    """Returns the orders on the problems with smooth answers in closed form."""
    fitted = fit_orders(rows, MAIN_ERROR)
    return {line: slope for line, slope in fitted.items() if line[0] in ("Gaussian blob", GAUSSIAN)}


def unexpected(rows: Sequence[Row]) -> list[str]:
    """Returns a line for each closed form that the rows contradict."""
    found, slopes = [], order(rows)
    for method in ("march", "gaussian", "footprint", "ray_traced"):
        slope = slopes.get(("Gaussian blob", method), 2.0)
        if not 1.8 <= slope <= 2.2:
            found.append(f"Gaussian blob, {method}: order {slope:.2f}; it is 2")
    for diffuser in ("sweeps", "exact"):
        slope = slopes.get((GAUSSIAN, diffuser), 2.0)
        if not 1.8 <= slope <= 2.2:
            found.append(f"{GAUSSIAN}, {diffuser}: order {slope:.2f}; it is 2")
    for row in rows:
        if row.failure is not None:
            continue
        place = f"{row.problem}, {row.method}, {row.resolution}"
        if row.errors.get("mass", 0.0) > 1e-5:
            found.append(f"{place}: Σ τ A is {row.errors['mass']:.1e} off σ times the mass; it is equal to round-off")
        if row.problem == "slab" and row.method in ("march", "footprint") and row.errors["linf"] > 1e-5:
            found.append(f"{place}: {row.errors['linf']:.1e} off; it is exact to round-off")
        if row.method == "paper":
            r = _SPREAD * row.resolution**2 if row.problem == GAUSSIAN else float(row.problem.partition("r = ")[2])
            if abs(row.errors["variance_kept"] * (1.0 + 4.0 * r) - 1.0) > 2e-3:
                found.append(f"{place}: keeps {row.errors['variance_kept']:.3f} of the variance; it is 1/(1 + 4 r)")
    return found


def explain(rows: Sequence[Row]) -> str:
    """Explains how to read the diagram, and what it shows."""
    text = (
        "Each line is a way to find how much light smoke lets through, and each point a size of its grid or buffer: "
        "lower is nearer to the closed form or to fine rays, further left is faster."
    )
    plume = [row for row in rows if row.problem == "plume" and row.failure is None]
    if not plume:
        return text
    best = min(plume, key=lambda row: row.errors[MAIN_ERROR])
    close = [row for row in plume if row.errors[MAIN_ERROR] <= max(_CLOSE, best.errors[MAIN_ERROR])]
    quick = min(close, key=lambda row: row.median)
    paper = min((row for row in plume if row.method == "dpd"), key=lambda row: row.errors[MAIN_ERROR], default=None)
    said = f" On the plume {best.method} comes closest ({_in_words(best)})"
    if quick is not best:
        said += (
            f", and the cheapest within {100 * _CLOSE:g} % is {quick.method} with {quick.resolution} texels "
            f"({_in_words(quick)}), {best.median / quick.median:.0f} times faster"
        )
    if paper is not None:
        said += f"; the published dpd is never nearer than {_in_words(paper)}"
    return text + said + "."


def _in_words(row: Row) -> str:
    return f"{percent(row.errors[MAIN_ERROR])} of the shadow, {duration(row.median)}"
