"""Which surfaces may shadow what is lit, by which method, and which faces of a cube map nothing needs."""

import numpy as np

from warp_smoke.plan.passes import Ledger, When
from warp_smoke.plan.reach import is_moving, may_shadow, over, swept_corners
from warp_smoke.record import Samples
from warp_smoke.scene import DistantLight, Light, Scene, SpotLight, Surface
from warp_smoke.shadow.coverage import FACE_NAMES, WIDEST_CONE, cube_rectangles


def casters_between(scene: Scene, light: Light, corners: np.ndarray) -> list[Surface]:
    """The surfaces that may stand between a light and what has these world corners [n, 3], at any frame."""
    frames = scene.frames
    return [
        surface
        for surface in scene.surfaces
        if light.may_be_shadowed_by(surface.path)
        and np.any(over(surface.visible, frames))
        and may_shadow(light, swept_corners(surface, frames), corners, frames)
    ]


def casters_change(casters: list[Surface]) -> bool:
    """Whether the casters are not the same at every frame."""
    return any(is_moving(caster) or isinstance(caster.visible, Samples) for caster in casters)


def depth_map_of(light: Light) -> str:
    """The kind of depth map that serves a light."""
    if isinstance(light, DistantLight):
        return "directional"
    return "spot" if isinstance(light, SpotLight) and light.cone_angle <= WIDEST_CONE else "cube"


class SurfaceShadows:
    """The shadows of surfaces, as receivers and smoke ask for them."""

    def __init__(self, ledger: Ledger, scene: Scene):
        self._ledger, self._scene = ledger, scene
        self._cubes: dict[str, tuple[Light, list[np.ndarray], list[np.ndarray]]] = {}

    def plan(self, light: Light, casters: list[Surface], path: str, corners: np.ndarray, when: When) -> str:
        """Notes the shadow of casters on what is at a path, and returns the method: a depth map's kind, or rays.

        Args:
            light: whose light they stop.
            casters: those that may stand between.
            path: of the receiver or the smoke.
            corners: of its bounds over all frames, world, [n, 3].
            when: how often it is computed.
        """
        names = ", ".join(c.path for c in casters[:3]) + (f" and {len(casters) - 3} more" if len(casters) > 3 else "")
        if light.shadow_filter in ("exact", "area"):
            method = light.shadow_filter
        else:
            method = depth_map_of(light)
            traced = When.FRAME if casters_change(casters) or is_moving(light) else When.ONCE
            why = f"{names} may shadow {path}"
            self._ledger.keep("trace_shadow_map", (light.path,), traced, "depth map", why, method)
            if method == "cube":
                _, casting, receiving = self._cubes.setdefault(light.path, (light, [], []))
                casting += [swept_corners(caster, self._scene.frames) for caster in casters]
                receiving.append(corners)
        why = f"{names} may stand between the light and it"
        self._ledger.keep("surface_visibility", (path, light.path), when, "share of light past surfaces", why, method)
        return method

    def note_faces_left_out(self) -> None:
        """Notes the cubes' faces over which no caster and receiver lie at any frame, for lights that stand still."""
        for light, casting, receiving in self._cubes.values():
            if is_moving(light):
                continue
            position = light.position_at(self._scene.start)
            casts, receives = (_faces_with(corners, position) for corners in (casting, receiving))
            for index in np.flatnonzero(~(casts & receives)):
                why = f"its frustum holds no {'caster' if receives[index] else 'receiver'}"
                self._ledger.omit("trace_shadow_map", (light.path, FACE_NAMES[index]), why)


def _faces_with(corners: list[np.ndarray], position: np.ndarray) -> np.ndarray:
    """Whether the bounds of any of the sets of corners [n, 3] meet the frustum of each cube face, [6]."""
    boxes = np.array([[c.min(axis=0), c.max(axis=0)] for c in corners if len(c)]).reshape(-1, 2, 3)
    left, right, top, bottom = np.moveaxis(cube_rectangles(boxes, position), -1, 0)
    return np.any((left <= 1.0) & (right >= -1.0) & (top <= 1.0) & (bottom >= -1.0) & (left <= right), axis=0)
