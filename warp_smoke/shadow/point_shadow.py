"""Shadows of a light at a point by depth maps: which tiles are traced, and when."""

from itertools import product

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.scene import Camera, PointLight
from warp_smoke.shadow import coverage, filters
from warp_smoke.shadow.bias import light_bias, round_off
from warp_smoke.shadow.caster_mask import CasterTiles
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.point_map import PointMap, filter_map, filter_penumbra, trace_tiles


class PointMapShadow:
    """Which points a light at a point reaches, by a depth map; `CubeShadow` and `SpotShadow` say of what shape.

    Points that face away from the light are in their own shadow. Surfaces nearer to the light than `shadow_near`
    cast none, nor does a surface that the light itself lies on; a light inside a closed mesh reaches only its inside.
    Only tiles over which a caster and a receiver may lie are traced.

    Attributes:
        map: the depth map.
        rays: how many texels were traced at the last change.
    """

    faces: int
    slope: float

    def __init__(
        self,
        launcher: Launcher,
        light: PointLight,
        casters: Casters,
        receiver_bounds: np.ndarray,
        camera: Camera | None = None,
    ):
        """Makes the map; `update` traces it.

        Args:
            launcher: launches the kernels.
            light: a point or spot light.
            casters: what casts shadows.
            receiver_bounds: lower and upper corner, in set space, of all that is ever looked up: a box [2, 3], or one
                for each receiver [n, 2, 3].
            camera: whose distance widens the filter `pcf_disk_view`.
        """
        self._launcher, self._light, self._casters, self._camera = launcher, light, casters, camera
        self._receivers = np.asarray(receiver_bounds, np.float64).reshape(-1, 2, 3)
        self._receiver_corners = np.array(list(product(*_union(self._receivers).T)))
        size = light.shadow_map_size
        self._depth = launcher.zeros((self.faces, size, size), "shadow_map")
        across = -(-size // coverage.TILE)
        self._deepest = launcher.zeros((self.faces, across, across), "shadow_map")
        self._clear()
        self._tiles = launcher.zeros(self.faces * across**2, "shadow_map", dtype=int)
        self._mask = CasterTiles(launcher, self.faces, size)
        self._covered, self._traced, self._looked = None, None, None
        self.rays = 0

    def _frames(self, time: float) -> np.ndarray:
        """Axes of each face, [faces, 3, 3]."""
        raise NotImplementedError

    def _rectangles(self, boxes: np.ndarray, position: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """Rectangles of boxes on the faces, [n, faces, 4]."""
        raise NotImplementedError

    def update(self, time: float) -> None:
        """Traces the map for a time code, unless it is the same as before."""
        light, casters = self._light, self._casters
        state = casters.version, light.transform_at(time).tobytes()
        eye = filters.eye_at(self._camera, time, casters.origin)
        looked = state, None if eye is None else eye.tobytes()
        if state != self._traced:
            self._trace(time)
        if looked != self._looked:
            texels = filters.DEFAULT_TEXELS if light.shadow_filter != "pcss" else 0.5
            self._taps = filters.filter_taps(
                self._launcher, light, self._offsets(self._axes), texels, eye, float(self.map.far)
            )
        self._traced, self._looked = state, looked

    def _trace(self, time: float) -> None:
        light, casters = self._light, self._casters
        position = light.position_at(time) - casters.origin
        # Rays begin where the casters do, so that a far light loses no digits, and off the surface a light lies on.
        extent = float(np.abs(self._receiver_corners).max())
        radius = 0.5 * np.linalg.norm(casters.upper - casters.lower)
        distance = np.linalg.norm(position - 0.5 * (casters.lower + casters.upper))
        start = float(max(light.shadow_near or 0.0, round_off(extent), distance - 1.001 * radius))
        far = light.shadow_far
        if far is None:
            far = 1.00001 * float(np.linalg.norm(self._receiver_corners - position, axis=1).max())
        far = max(far, 2.0 * start)

        size = light.shadow_map_size
        self._axes = self._frames(time)
        self.map = PointMap()
        self.map.depth, self.map.deepest = self._depth, self._deepest
        self.map.position, self.map.far = wp.vec3(*position.tolist()), far
        self.map.slope = self.slope
        self.map.frames = self._launcher.array(self._axes.astype(np.float32), "shadow_map", dtype=wp.mat33)
        self.map.bias = light_bias(light, spread=2**0.5 * self.slope / size, extent=max(far, extent))

        found = casters.boxes_behind_which(self._receivers, np.append(position, 1.0), round_off(extent))
        found = found[coverage.nearest_distance(found, position) < far]
        self._closest = float(max(coverage.nearest_distance(found, position).min(initial=far), start, 1e-3 * far))
        casting = coverage.covered_tiles(self._rectangles(found, position, self._axes), size)
        reach = self._reach(self._receivers, position)
        grown = self._receivers + reach[:, None, None] * np.array([[-1.0], [1.0]])
        receiving = coverage.covered_tiles(self._rectangles(grown, position, self._axes), size)
        covered = casting & receiving
        # The same reach, at the casters' distance: what lies beyond has no tap on them.
        grown = found + self._reach(found, position)[:, None, None] * np.array([[-1.0], [1.0]])
        near = coverage.covered_tiles(self._rectangles(grown, position, self._axes), size)
        self._mask.place(near, self._axes, position, self.slope, True)
        if self._covered is not None and np.any(self._covered & ~covered):
            self._clear()
        self._covered = covered
        tiles = np.flatnonzero(covered).astype(np.int32)
        self.rays = len(tiles) * coverage.TILE**2
        if len(tiles):
            self._tiles[: len(tiles)].assign(tiles)
            cull = light.shadow_cull_front
            trace_tiles(self._launcher, casters.mesh, self.map, start, cull, self._tiles, len(tiles))

    def _clear(self) -> None:
        self._depth.fill_(1.0)
        self._deepest.fill_(1.0)

    def _reach(self, boxes: np.ndarray, position: np.ndarray) -> np.ndarray:
        """How far beside boxes the filter looks, at most, laid on the boxes at their farthest, [n]."""
        light, far = self._light, float(self.map.far)
        farthest = np.linalg.norm(coverage.box_corners(boxes) - position, axis=2).max(axis=1)
        texels = farthest * 2.0 * self.slope / light.shadow_map_size
        if light.shadow_filter == "hard":
            return np.zeros(len(boxes))
        if light.shadow_filter == "pcss":
            return light.radius * farthest / self._closest + texels
        if light.shadow_filter == "pcf_disk_view":
            return np.full(len(boxes), far)  # the camera may be anywhere
        if light.shadow_softness is None:
            return 3**0.5 * filters.DEFAULT_TEXELS * texels
        # Receivers near the light see the width of the filter under a wide angle.
        nearest = max(coverage.nearest_distance(self._receivers, position).min(), self._closest)
        return 3**0.5 * light.shadow_softness * np.maximum(1.0, farthest / nearest)

    def _offsets(self, frames: np.ndarray) -> np.ndarray:
        if self._light.shadow_filter == "hard":
            return np.zeros((1, 3))
        if self._light.shadow_filter == "pcf_grid":
            return filters.grid_of_cube() if self.faces == 6 else filters.grid_of_plane() @ frames[0]
        if self._light.shadow_filter == "pcss":
            return filters.spiral()
        return filters.edges_and_corners()

    def visibility(self, points: wp.array, normals: wp.array, visibility_out: wp.array) -> None:
        """Writes the share of light from 0 to 1 that reaches each point.

        Args:
            points: in set space, [n] vec3.
            normals: unit surface normals, [n] vec3.
            visibility_out: [n].
        """
        args = (self._launcher, self.map, self._mask.mask, self._taps)
        if self._light.shadow_filter == "pcss":
            filter_penumbra(*args, float(self._light.radius), self._closest, points, normals, visibility_out)
        else:
            filter_map(*args, points, normals, visibility_out)


def _union(boxes: np.ndarray) -> np.ndarray:
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
