"""Shadows of surfaces on surfaces: a ball's disk, the bunny against exact rays, and penumbras.

A repeat traces the shadow map again and looks up all points, some 37,000 on the floor and 20,000 on the bunny; its
time is divided by their number.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from warp_smoke.launch import Launcher
from warp_smoke.scene import DistantLight
from warp_smoke.shadow.methods import SURFACE_SHADOWS
from warp_smoke.shadow.ray_traced import RayTracedShadow
from warp_smoke.study.case import Case, Measured, Row, fit_orders, time_repeats
from warp_smoke.study.shadow_scenes import FLOOR_POINTS, ShadowScene, bunny_scene, edge_scene, sphere_scene
from warp_smoke.study.words import duration, percent

SUITE = "surface_shadow"
TITLE = "Shadows of surfaces"
MAIN_ERROR = "misclassified_area"
ERROR_MEANS = "area wrongly lit or shadowed, as a share of the shadow's"

BALL, BIAS, FILTERS, DISTANT, EDGE, SOFT = (
    "ball above a plane",
    "bunny, biases",
    "bunny, filters",
    "bunny, distant light",
    "penumbra of an edge",
    "bunny, soft shadow",
)
_SCENES = {
    BALL: sphere_scene,
    BIAS: partial(bunny_scene, kind="point"),
    FILTERS: partial(bunny_scene, kind="point"),
    DISTANT: partial(bunny_scene, kind="distant"),
    EDGE: edge_scene,
    SOFT: partial(bunny_scene, kind="soft"),
}
# LearnOpenGL's constants: 0.05 for cube maps, 0.005 for directional ones, and both combined in a slope bias.
_BIASES = {
    "auto": {},
    "constant 0.05": {"shadow_bias": 0.05},
    "constant 0.005": {"shadow_bias": 0.005},
    "slope 0.05, at least 0.005": {"shadow_bias": 0.005, "shadow_slope_bias": 0.05},
    "none": {"shadow_bias": 0.0},
}
_SHARP = ("hard", "pcf_grid", "pcf_disk", "pcss")
# Half-widths of the penumbras on the floor, R (d − b)/b, for filters whose softness is set.
_SOFTNESS = {EDGE: 0.2, SOFT: 0.08}
_RAYS = (16, 64)


def cases(full: bool) -> list[Case]:
    """Maps of 64² to 1024² texels (`full`: 2048²), and rays."""
    found = []

    def add(problem: str, method: str, sizes: Sequence[int], **fields: object) -> None:
        for size in sizes:
            chosen = {"shadow_filter": "hard", "shadow_map_size": size} | fields
            found.append(Case(SUITE, problem, method, {}, size, None, partial(_measure, problem, chosen, None)))

    def add_rays(problem: str, soft: bool) -> None:
        for rays in _RAYS if soft else (1,):
            chosen = {"shadow_filter": "area" if soft else "exact"}
            method = "area" if soft else "exact"
            measure = partial(_measure, problem, chosen, rays)
            found.append(Case(SUITE, problem, method, {"rays": rays}, FLOOR_POINTS, None, measure))

    sizes = (64, 128, 256, 512, 1024, *[2048] * full)
    for name in _SHARP[:3]:
        add(BALL, name, sizes, shadow_filter=name)
    add_rays(BALL, soft=False)
    for name, fields in _BIASES.items():
        add(BIAS, f"hard, {name}", sizes[1:], **fields)
    for name in _SHARP:
        add(FILTERS, name, sizes[1:], shadow_filter=name)
    add_rays(FILTERS, soft=False)
    for name, fields in _BIASES.items():
        add(DISTANT, f"hard, {name}", (*sizes[2:], *[4096] * full), **fields)
    add_rays(DISTANT, soft=False)
    for problem in (EDGE, SOFT):
        add(problem, "hard", sizes[1:4])
        add(problem, "pcss", sizes[1:], shadow_filter="pcss")
        for name in ("pcf_grid", "pcf_disk"):
            add(problem, name, sizes[1:4], shadow_filter=name, shadow_softness=_SOFTNESS[problem])
        add_rays(problem, soft=False)
        add_rays(problem, soft=True)
    return found


def _measure(
    problem: str, fields: Mapping[str, object], rays: int | None, launcher: Launcher, repeats: int
) -> Measured:
    scene: ShadowScene = _SCENES[problem](launcher.device.alias)
    light = replace(scene.light, **fields)
    if rays is None:
        kind = "directional" if isinstance(light, DistantLight) else "cube"
        shadow = SURFACE_SHADOWS[kind](launcher, light, scene.casters, scene.bounds)
    else:
        shadow = RayTracedShadow(launcher, light, scene.casters, scene.bounds, area_rays=rays)
    out = launcher.zeros(len(scene.points), "study")

    def trace_and_look_up() -> None:
        scene.casters.version += 1  # so that the map counts as out of date
        shadow.update(1.0)
        shadow.visibility(scene.points, scene.normals, out)

    seconds = time_repeats(launcher, trace_and_look_up, repeats)
    return Measured(shadow_errors(scene, out.numpy().astype(float)), seconds, len(scene.points))


def shadow_errors(scene: ShadowScene, visible: np.ndarray) -> dict[str, float]:
    """Returns the area wrongly lit or shadowed, acne, light beneath the caster (detached shadow), and error norms.

    Args:
        scene: what was shadowed.
        visible: share of the light that was computed, [n].
    """
    areas, wrong = scene.areas, np.abs(visible - scene.truth)
    shadow = np.sum(areas * (1.0 - scene.truth))
    lit, shadowed = (np.sum(areas * where) for where in (scene.lit, scene.shadowed))
    return {
        "misclassified_area": float(np.sum(areas * wrong) / shadow),
        "acne_area": float(np.sum(areas * (scene.lit & (visible < 0.5))) / max(lit, 1e-30)),
        "detached_area": float(np.sum(areas * (scene.shadowed & (visible > 0.5))) / max(shadowed, 1e-30)),
        "l1": float(np.sum(areas * wrong) / areas.sum()),
        "l2": float(np.sqrt(np.sum(areas * wrong**2) / areas.sum())),
        "linf": float(wrong[areas > 0.0].max()),
    }


def order(rows: Sequence[Row]) -> Mapping[tuple[str, str], float]:
    """Returns the order of the area that hard shadows of the ball get wrong."""
    return {line: slope for line, slope in fit_orders(rows, MAIN_ERROR).items() if line == (BALL, "hard")}


def unexpected(rows: Sequence[Row]) -> list[str]:
    """Returns a line for each known property of sharp and soft shadows that the rows contradict."""
    found = [
        f"{problem}, {method}: the area wrongly classified falls at order {slope:.2f}; it is 1"
        for (problem, method), slope in order(rows).items()
        if not 0.8 <= slope <= 1.3
    ]
    good = [row for row in rows if row.failure is None]
    for row in good:
        place, wrong = f"{row.problem}, {row.method}, {row.resolution}", row.errors[MAIN_ERROR]
        # The ball is a polyhedron of 256 segments, which is smaller than the true ball by a share of 1.5e-4.
        if row.problem == BALL and row.method == "exact" and wrong > 2e-3:
            found.append(f"{place}: {wrong:.1e} of the area is wrong; rays are exact")
        if row.problem in (FILTERS, DISTANT) and row.method == "exact" and wrong > 0.0:
            found.append(f"{place}: {wrong:.1e} of the area differs; the rays are the truth")
        if row.problem == EDGE and row.method == "area" and row.errors["linf"] > 3.0 / row.parameters["rays"]:
            rays = row.parameters["rays"]
            found.append(f"{place}: {row.errors['linf']:.2f} of the light; at most 3 rays in {rays} differ")
        # Planes are free of acne at any map size; creases of the bunny that a texel straddles are not.
        if row.method == "hard, auto" and row.resolution >= 256 and row.errors["acne_area"] > 0.01:
            found.append(f"{place}: {row.errors['acne_area']:.1e} of the lit area is in shadow; auto is free of acne")
    return found


def explain(rows: Sequence[Row]) -> str:
    """Explains how to read the diagram, and what it shows."""
    text = (
        "Each line is a filter or a bias, and each point a map twice as wide as the one before: lower is nearer to the "
        "closed form or to rays, further left is faster."
    )
    good = [row for row in rows if row.failure is None]
    said = []
    slope = order(rows).get((BALL, "hard"))
    if slope is not None:
        said.append(f"the area that hard shadows of the ball get wrong falls at order {slope:.2f} with the map's size")
    exact = next((row for row in good if row.problem == FILTERS and row.method == "exact"), None)
    hard = [row for row in good if row.problem == FILTERS and row.method == "hard"]
    if exact is not None and hard:
        largest = max(hard, key=lambda row: row.resolution)
        said.append(
            f"on the bunny a map of {largest.resolution} texels is {percent(largest.errors[MAIN_ERROR])} of the "
            f"shadow off in {duration(largest.median)}, where exact rays take {duration(exact.median)}"
        )
    soft = [row for row in good if row.problem == SOFT]
    if soft:
        best = min((row for row in soft if row.method != "area"), key=lambda row: row.errors[MAIN_ERROR])
        said.append(f"soft shadows come closest by {best.method} ({percent(best.errors[MAIN_ERROR])})")
    return text + (f" Here {'; '.join(said)}." if said else "")
