"""Planning of the shadow maps written as pictures: those of lights that reach a receiver that bakes `depth`."""

import numpy as np

from warp_smoke.plan.passes import DepthPlan, Ledger, LightPlan
from warp_smoke.plan.reach import in_range, swept_corners
from warp_smoke.plan.shading import lights_that_shine, why_unseen
from warp_smoke.plan.surface_shadow import SurfaceShadows, casters_on, depth_map_of
from warp_smoke.scene import MAP_FILTERS, Light, Scene, Surface


def plan_depth_maps(ledger: Ledger, scene: Scene, shadows: SurfaceShadows) -> tuple[DepthPlan, ...]:
    """Plans the pictures of shadow maps, once everything else that needs the maps is planned."""
    receivers = [each for each in scene.surfaces if each.receiver and "depth" in each.receiver.bake]
    receivers = [each for each in receivers if not why_unseen(scene, each)]
    shining = lights_that_shine(ledger, scene) if receivers else []
    found: list[tuple[Surface, list[Light]]] = []
    missing: dict[tuple[str, str], list[str]] = {}
    for surface in receivers:
        corners = swept_corners(surface, scene.frames)
        reaching = [light for light in shining if _reaches(ledger, scene, light, surface, corners)]
        if not reaching:
            dome = "; a dome light has none" * any(scene.ambient)
            ledger.omit("write_depth_map", (surface.path,), f"no light that can have a shadow map reaches it{dome}")
        found.append((surface, []))
        for light in reaching:
            casters = casters_on(scene, light, surface, corners)
            if why := _why_no_map(light, surface, casters):
                missing.setdefault((light.path, why), []).append(surface.path)
            else:
                shadows.trace(light, casters, corners, f"{surface.path} bakes depth")
                found[-1][1].append(light)
    for (path, why), paths in missing.items():
        ledger.omit("write_depth_map", (path, *paths), why)
    _note_written(ledger, found, shadows)
    return tuple(
        DepthPlan(surface, tuple(LightPlan(each, depth_map_of(each), (), shadows.when_traced(each)) for each in lights))
        for surface, lights in found
        if lights
    )


def _note_written(ledger: Ledger, found: list[tuple[Surface, list[Light]]], shadows: SurfaceShadows) -> None:
    """Records each light's picture once, with all the surfaces that ask for it."""
    for light in {light.path: light for _, lights in found for light in lights}.values():
        paths = [surface.path for surface, lights in found if any(each is light for each in lights)]
        why = f"{', '.join(paths)} bake{'s' * (len(paths) == 1)} depth"
        ledger.keep("write_depth_map", (light.path,), shadows.when_traced(light), "depth map as a picture", why)


def _reaches(ledger: Ledger, scene: Scene, light: Light, surface: Surface, corners: np.ndarray) -> bool:
    pair = (light.path, surface.path)
    if not light.lights(surface.path):
        ledger.omit("trace_shadow_map", pair, "its lightLink leaves the surface out")
    elif not in_range(light, corners, scene.frames):
        ledger.omit("trace_shadow_map", pair, f"{surface.path} lies beyond its falloffEnd")
    else:
        return True
    return False


def _why_no_map(light: Light, surface: Surface, casters: list[Surface]) -> str:
    """Returns why a light that reaches a surface has no map for it; empty if it has one."""
    if not light.shadow_enable:
        return "its inputs:shadow:enable is false; allowed: true"
    if light.shadow_filter not in MAP_FILTERS:
        return f"its smoke:shadowFilter is {light.shadow_filter}, by rays; allowed: {', '.join(MAP_FILTERS)}"
    if not surface.receiver.receive_shadow:
        return "smoke:receiveShadow is false; allowed: true"
    return "" if casters else "nothing casts a shadow there"
