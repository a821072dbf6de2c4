"""Planning of the lights and shadows for the light inside the smoke: the grid `light` of a domain's volume files."""

import numpy as np

from warp_smoke.plan.passes import DomainPlan, Ledger, LightPlan, SmokeShadowPlan, VolumePlan, When
from warp_smoke.plan.reach import box_corners, in_range, may_shadow, over
from warp_smoke.plan.shading import DEFAULT_LAYER
from warp_smoke.plan.surface_shadow import SurfaceShadows, casters_between
from warp_smoke.scene import Light, Scene
from warp_smoke.shadow.light_buffer import buffer_serves, light_times


def plan_volumes(
    ledger: Ledger, scene: Scene, domains: tuple[DomainPlan, ...], shadows: SurfaceShadows
) -> tuple[VolumePlan, ...]:
    """Plans the light grid of each domain that asks for one."""
    return tuple(_plan_volume(ledger, scene, each, domains, shadows) for each in domains if "light" in each.grids)


def _plan_volume(
    ledger: Ledger, scene: Scene, each: DomainPlan, domains: tuple[DomainPlan, ...], shadows: SurfaceShadows
) -> VolumePlan:
    path, corners = each.domain.path, box_corners(each.lattice)
    lights = []
    for light in scene.lights:
        pair = (path, light.path)
        if not light.shines or not np.any(over(light.enabled, scene.frames)):
            ledger.omit("light_volume", pair, "it is off or black at every frame")
        elif not light.lights(path):
            ledger.omit("light_volume", pair, "its lightLink leaves the domain out")
        elif not in_range(light, corners, scene.frames):
            ledger.omit("light_volume", pair, f"{path} lies beyond its falloffEnd")
        else:
            casters = casters_between(scene, light, corners) if light.shadow_enable else []
            method = shadows.plan(light, casters, path, corners, When.FRAME) if casters else None
            lights.append(LightPlan(light, method, _smoke(ledger, scene, light, each, domains), When.FRAME))
    ledger.keep("light_volume", (path,), When.FRAME, "light grid", "light is among the exported grids")
    return VolumePlan(each, tuple(lights))


def _smoke(
    ledger: Ledger, scene: Scene, light: Light, lit: DomainPlan, domains: tuple[DomainPlan, ...]
) -> tuple[SmokeShadowPlan, ...]:
    """Returns the smoke shadows of the domains that may lie between a light and one domain, including its own."""
    found = []
    for each in domains if light.shadow_enable else ():
        corners = box_corners(each.lattice)
        if not (each.domain.dims_light and light.may_be_shadowed_by(each.domain.path)):
            continue
        if not may_shadow(light, corners, box_corners(lit.lattice), scene.frames):
            continue
        # The paper's buffer has no depth, so it cannot tell how much smoke lies in front of a cell.
        method = "march" if light.smoke_shadow == "dpd" else light.smoke_shadow
        times = (*scene.frames, *light_times(light))  # the buffer has the largest size that any of them needs
        if method != "ray_traced" and not buffer_serves(light, each.lattice, times):
            method = "ray_traced"
        if method != "ray_traced":
            why = f"smoke in {each.domain.path} stands between the light and smoke"
            pair = (light.path, each.domain.path)
            ledger.keep("project_smoke", pair, When.FRAME, "light buffer", why, method)
        found.append(SmokeShadowPlan(each, method, light.smoke_shadow_layer or DEFAULT_LAYER))
    return tuple(found)
