"""Shadows of a point or spot light by depth maps: their placement, and which tiles are traced."""

from abc import abstractmethod

import numpy as np
import warp as wp

from warp_smoke.shadow import coverage, filters
from warp_smoke.shadow.bias import light_bias, round_off
from warp_smoke.shadow.depth_map import MapRays
from warp_smoke.shadow.map_shadow import MapShadow
from warp_smoke.shadow.point_map import PointMap, filter_map, filter_penumbra
from warp_smoke.shadow.seen_triangles import planes_from_point


class PointMapShadow(MapShadow):
    """Which points a point or spot light reaches, by a depth map; `CubeShadow` and `SpotShadow` set its shape.

    Surfaces nearer to the light than `shadow_near` cast no shadow, nor does a surface that the light itself lies on; a
    light inside a closed mesh reaches only its inside.

    Attributes:
        slope: tangent of the angle between a face's viewing direction and the middle of its side.
    """

    slope: float

    @abstractmethod
    def _frames(self, time: float) -> np.ndarray:
        """Returns the axes of each face, [faces, 3, 3]."""

    @abstractmethod
    def _rectangles(self, boxes: np.ndarray, position: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """Returns the rectangles of boxes on the faces, [n, faces, 4]."""

    def _place(self, time: float) -> np.ndarray:
        light, casters = self._light, self._casters
        position = self._position = light.position_at(time) - casters.origin
        # Rays begin where the casters do, so that a far light loses no digits, and clear of a surface that it lies on.
        corners = coverage.box_corners(_union(self._receivers))[0]
        extent = float(np.abs(corners).max())
        self._slack = round_off(extent)
        radius = 0.5 * np.linalg.norm(casters.upper - casters.lower)
        distance = np.linalg.norm(position - 0.5 * (casters.lower + casters.upper))
        start = float(max(light.shadow_near or 0.0, self._slack, distance - 1.001 * radius))
        far = light.shadow_far
        if far is None:
            far = 1.00001 * float(np.linalg.norm(corners - position, axis=1).max())
        far = max(far, 2.0 * start)

        size = light.shadow_map_size
        self._axes = self._frames(time)
        self._point_map(far, max(far, extent))
        self._set_rays(start)

        found = casters.boxes_behind_which(self._receivers, np.append(position, 1.0), self._slack)
        found = found[coverage.nearest_distance(found, position) < far]
        self._closest = float(max(coverage.nearest_distance(found, position).min(initial=far), start, 1e-3 * far))
        casting = coverage.covered_tiles(self._rectangles(found, position, self._axes), size)
        reach = self._reach(self._receivers, position)
        grown = self._receivers + reach[:, None, None] * np.array([[-1.0], [1.0]])
        receiving = coverage.covered_tiles(self._rectangles(grown, position, self._axes), size)
        # The same reach at the casters' distance: points beyond it have no tap on them.
        grown = found + self._reach(found, position)[:, None, None] * np.array([[-1.0], [1.0]])
        near = coverage.covered_tiles(self._rectangles(grown, position, self._axes), size)
        self._mask.place(near, self._axes, position, self.slope, True)
        return casting & receiving

    def _point_map(self, far: float, extent: float) -> None:
        light, m = self._light, PointMap()
        m.depth, m.deepest = self._depths.depth, self._depths.deepest
        m.position, m.far = wp.vec3(*self._position.tolist()), far
        m.slope = self.slope
        m.frames = self._launcher.array(self._axes.astype(np.float32), "shadow_map", dtype=wp.mat33)
        m.bias = light_bias(light, spread=2**0.5 * self.slope / light.shadow_map_size, extent=extent)
        self.map = m

    def _set_rays(self, start: float) -> None:
        rays = self._rays = MapRays()
        rays.frames, rays.perspective = self.map.frames, 1
        rays.origin, rays.depth = self.map.position, 1.0
        rays.s = rays.t = -self.slope
        rays.texel = 2.0 * self.slope / self._light.shadow_map_size
        rays.start, rays.far = start, self.map.far
        rays.cull = 1.0 if self._light.shadow_cull_front else 0.0

    def trace(self, covered: np.ndarray) -> None:
        """Traces these tiles of the map, [faces, rows, columns] bool, as it was last placed."""
        triangles = self._casters.triangles if self._depths.lists_triangles else np.zeros((0, 3, 3))
        planes = planes_from_point(triangles, self._position, self._slack, self._light.shadow_cull_front)
        self._depths.trace(self._casters, self._rays, covered, planes, round_off(1.0))

    def _reach(self, boxes: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Returns how far from boxes the filter looks, at most, measured at each box's farthest corner, [n]."""
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
        # For receivers near the light the filter spans a wide angle.
        nearest = max(coverage.nearest_distance(self._receivers, position).min(), self._closest)
        return 3**0.5 * light.shadow_softness * np.maximum(1.0, farthest / nearest)

    def _filter(self) -> tuple[np.ndarray, float]:
        if self._light.shadow_filter == "hard":
            return np.zeros((1, 3)), filters.DEFAULT_TEXELS
        if self._light.shadow_filter == "pcf_grid":
            offsets = filters.grid_of_cube() if self.faces == 6 else filters.grid_of_plane() @ self._axes[0]
            return offsets, filters.DEFAULT_TEXELS
        if self._light.shadow_filter == "pcss":
            return filters.spiral(), 0.5
        return filters.edges_and_corners(), filters.DEFAULT_TEXELS

    def visibility(
        self, points: wp.array, normals: wp.array, visibility_out: wp.array, facets: wp.array | None = None
    ) -> None:
        """Writes the share of light from 0 to 1 that reaches each point; see `MapShadow.visibility`."""
        args = (self._launcher, self.map, self._mask.mask, self._taps)
        look = (points, normals, normals if facets is None else facets, visibility_out)
        if self._light.shadow_filter == "pcss":
            filter_penumbra(*args, float(self._light.radius), self._closest, *look)
        else:
            filter_map(*args, *look)


def _union(boxes: np.ndarray) -> np.ndarray:
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])[None]
