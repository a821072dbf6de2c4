"""Shadows by a depth map: what the maps of all lights have in common, and when they are retraced."""

from abc import ABC, abstractmethod

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.scene import Camera, Light
from warp_smoke.shadow import filters
from warp_smoke.shadow.caster_mask import CasterTiles
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.depth_map import DepthMap


class MapShadow(ABC):
    """Which points a light reaches, by a depth map.

    Points that face away from the light are in their own shadow. Only tiles that may hold both a caster and a receiver
    are traced.

    Attributes:
        faces: number of the map's faces.
        map: the depth map, for look-ups.
    """

    faces: int

    def __init__(
        self,
        launcher: Launcher,
        light: Light,
        casters: Casters,
        receiver_bounds: np.ndarray,
        camera: Camera | None = None,
    ):
        """Allocates the map; `update` traces it.

        Args:
            launcher: launches the kernels.
            light: of the kind that the map is for.
            casters: what casts shadows.
            receiver_bounds: lower and upper corner, in set space, of all points ever looked up: a box [2, 3], or one
                per receiver [n, 2, 3].
            camera: the camera whose distance widens the filter `pcf_disk_view`.
        """
        self._launcher, self._light, self._casters, self._camera = launcher, light, casters, camera
        self._receivers = np.asarray(receiver_bounds, np.float64).reshape(-1, 2, 3)
        self._depths = DepthMap(launcher, self.faces, light.shadow_map_size, casters.most_triangles)
        self._mask = CasterTiles(launcher, self.faces, light.shadow_map_size)
        self._traced, self._looked = None, None

    @property
    def rays(self) -> int:
        """Number of rays at the last trace."""
        return self._depths.rays

    def update(self, time: float) -> None:
        """Places and traces the map for a time code, unless nothing has changed."""
        light, casters = self._light, self._casters
        state = casters.version, light.transform_at(time).tobytes()
        eye = filters.eye_at(self._camera, time, casters.origin)
        looked = state, None if eye is None else eye.tobytes()
        if state != self._traced:
            self.trace(self._place(time))
        if looked != self._looked:
            offsets, texels = self._filter()
            far = float(self.map.far)
            self._taps = filters.filter_taps(self._launcher, light, offsets, texels, eye, far)
        self._traced, self._looked = state, looked

    @abstractmethod
    def _place(self, time: float) -> np.ndarray:
        """Places the map for a time code, and returns the tiles to be traced, [faces, rows, columns] bool."""

    @abstractmethod
    def trace(self, covered: np.ndarray) -> None:
        """Traces these tiles of the map, [faces, rows, columns] bool, as it was last placed."""

    @abstractmethod
    def _filter(self) -> tuple[np.ndarray, float]:
        """Returns offsets of the filter's taps, [n, 3], and its half-width in texels where no softness is set."""

    @abstractmethod
    def visibility(
        self, points: wp.array, normals: wp.array, visibility_out: wp.array, facets: wp.array | None = None
    ) -> None:
        """Writes the share of light from 0 to 1 that reaches each point.

        Args:
            points: in set space, [n] vec3.
            normals: unit surface normals, [n] vec3.
            visibility_out: [n].
            facets: unit normals of the planes that the points' neighbours lie on, [n] vec3; `normals` unless given.
        """
