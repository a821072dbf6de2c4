"""Planning of surface shadows: the casters, the method, and the faces of cube maps that nothing needs."""

from dataclasses import dataclass, field

import numpy as np

from warp_smoke.plan.passes import Ledger, When
from warp_smoke.plan.reach import is_flat, is_moving, may_shadow, over, swept_corners
from warp_smoke.record import Samples
from warp_smoke.scene import MAP_FILTERS, DistantLight, Light, Scene, SpotLight, Surface
from warp_smoke.shadow.coverage import FACE_NAMES, WIDEST_CONE, cube_rectangles


def casters_between(scene: Scene, light: Light, corners: np.ndarray) -> list[Surface]:
    """Returns the surfaces that may stand between a light and these world corners [n, 3] at any frame."""
    frames = scene.frames
    return [
        surface
        for surface in scene.shadowing(light)
        if np.any(over(surface.visible, frames)) and may_shadow(light, swept_corners(surface, frames), corners, frames)
    ]


def casters_on(scene: Scene, light: Light, surface: Surface, corners: np.ndarray) -> list[Surface]:
    """Returns the surfaces that may shadow a surface with these world corners [n, 3], itself too unless it is flat."""
    casters = casters_between(scene, light, corners)
    return [caster for caster in casters if caster is not surface or not is_flat(caster)]


def casters_change(casters: list[Surface]) -> bool:
    """Returns whether any caster moves, deforms, or appears and disappears."""
    return any(is_moving(caster) or isinstance(caster.visible, Samples) for caster in casters)


def depth_map_of(light: Light) -> str:
    """Returns the kind of depth map for a light: directional, spot or cube."""
    if isinstance(light, DistantLight):
        return "directional"
    return "spot" if isinstance(light, SpotLight) and light.cone_angle <= WIDEST_CONE else "cube"


@dataclass
class _Map:
    """A light's depth map: why and how often it is traced, and the corners of its casters and receivers."""

    light: Light
    method: str
    why: str
    when: When = When.ONCE
    casting: list[np.ndarray] = field(default_factory=list)
    receiving: list[np.ndarray] = field(default_factory=list)


class SurfaceShadows:
    """Collects the surface shadows that receivers and smoke ask for."""

    def __init__(self, ledger: Ledger, scene: Scene):
        self._ledger, self._scene = ledger, scene
        self._maps: dict[str, _Map] = {}

    def plan(self, light: Light, casters: list[Surface], path: str, corners: np.ndarray, when: When) -> str:
        """Records the shadow of casters on a receiver or domain; returns the depth map's kind, or exact or area.

        Args:
            light: the light that they block.
            casters: the surfaces that may stand in between.
            path: prim path of the receiver or domain.
            corners: world corners of its bounds over all frames, [n, 3].
            when: how often the shadow is computed.
        """
        names = ", ".join(c.path for c in casters[:3]) + (f" and {len(casters) - 3} more" if len(casters) > 3 else "")
        method = light.shadow_filter
        if method in MAP_FILTERS:
            method = self.trace(light, casters, corners, f"{names} may shadow {path}")
        why = f"{names} may stand between the light and it"
        self._ledger.keep("surface_visibility", (path, light.path), when, "share of light past surfaces", why, method)
        return method

    def trace(self, light: Light, casters: list[Surface], corners: np.ndarray, why: str) -> str:
        """Requests a light's depth map, and returns its kind.

        Args:
            light: the light.
            casters: the surfaces to be traced in the map.
            corners: world corners of the bounds of what looks it up, over all frames, [n, 3].
            why: what it is for; the first of several reasons is kept.
        """
        found = self._maps.setdefault(light.path, _Map(light, depth_map_of(light), why))
        if casters_change(casters) or is_moving(light):
            found.when = When.FRAME
        found.casting += [swept_corners(caster, self._scene.frames) for caster in casters]
        found.receiving.append(corners)
        return found.method

    def when_traced(self, light: Light) -> When:
        """Returns how often a light's map changes, according to all requests so far."""
        return self._maps[light.path].when

    def note_maps(self) -> None:
        """Records the maps that were requested, and the faces of cube maps that are left out."""
        for path, each in self._maps.items():
            self._ledger.keep("trace_shadow_map", (path,), each.when, "depth map", each.why, each.method)
            if each.method == "cube":
                self._note_faces_left_out(each.light, each.casting, each.receiving)

    def _note_faces_left_out(self, light: Light, casting: list[np.ndarray], receiving: list[np.ndarray]) -> None:
        """Records the faces of a stationary light's cube map whose frusta never hold both a caster and a receiver."""
        if not is_moving(light):
            position = light.position_at(self._scene.start)
            casts, receives = (_faces_with(corners, position) for corners in (casting, receiving))
            for index in np.flatnonzero(~(casts & receives)):
                why = f"its frustum holds no {'caster' if receives[index] else 'receiver'}"
                self._ledger.omit("trace_shadow_map", (light.path, FACE_NAMES[index]), why)


def _faces_with(corners: list[np.ndarray], position: np.ndarray) -> np.ndarray:
    """Returns for each cube face whether the bounds of any set of corners [n, 3] meet its frustum, [6]."""
    boxes = np.array([[c.min(axis=0), c.max(axis=0)] for c in corners if len(c)]).reshape(-1, 2, 3)
    left, right, top, bottom = np.moveaxis(cube_rectangles(boxes, position), -1, 0)
    return np.any((left <= 1.0) & (right >= -1.0) & (top <= 1.0) & (bottom >= -1.0) & (left <= right), axis=0)
