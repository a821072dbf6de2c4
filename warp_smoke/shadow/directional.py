"""Shadows of a distant light by an orthographic depth map: its placement, and which tiles are traced."""

import numpy as np
import warp as wp

from warp_smoke.shadow import coverage, filters
from warp_smoke.shadow.bias import light_bias, round_off
from warp_smoke.shadow.depth_map import MapRays
from warp_smoke.shadow.directional_map import DirectionalMap, filter_map, filter_penumbra
from warp_smoke.shadow.map_shadow import MapShadow
from warp_smoke.shadow.seen_triangles import planes_from_afar


class DirectionalShadow(MapShadow):
    """Which points a distant light reaches, by an orthographic depth map.

    The map covers the overlap of casters and receivers: beyond the casters nothing is in shadow, beyond the receivers
    nothing is looked up. Its texels keep their size and place while things move a little, so that shadow edges do not
    shimmer. `shadow_near` and `shadow_far` do not apply: a distant light has no position to measure them from.
    """

    faces = 1

    def _place(self, time: float) -> np.ndarray:
        light, casters = self._light, self._casters
        size = light.shadow_map_size
        frame = self._frame = coverage.frame_along(light.direction_at(time))
        corners = coverage.box_corners(self._receivers).reshape(-1, 3)
        extent = float(np.abs(corners).max())
        found = casters.boxes_behind_which(self._receivers, np.append(-frame[2], 0.0), round_off(extent))
        received = corners @ frame.T
        margin = round_off(max(casters.extent, extent))
        cast = coverage.box_corners(found).reshape(-1, 3) @ frame.T if len(found) else received.max(axis=0)[None]
        lower = np.maximum(cast.min(axis=0), received.min(axis=0)) - margin
        upper = np.minimum(cast.max(axis=0), received.max(axis=0)) + margin
        # A texel's size is one of a fixed series, its place an integer number of texels from the set's origin.
        span = max(float((upper - lower)[:2].max()), margin)
        texel = float(2.0 ** (np.ceil(8.0 * np.log2(span / max(size - 1, 1))) / 8.0))
        corner = np.floor(0.5 * (lower + upper)[:2] / texel - 0.5 * (size - 1)) * texel
        near = float(cast[:, 2].min() - margin)
        far = float(max(received[:, 2].max(), near) + 2.0 * margin)
        self._set_map(corner, texel, near, far)
        self.map.bias = light_bias(light, spread=texel * 0.5**0.5, extent=max(extent, far - near))
        # Places on the map lie between its corners.
        self._rounding = round_off(float(np.abs([corner, corner + size * texel]).max()))

        width = texel * size
        reach = self._reach(texel, far - near)
        around = reach * np.array([[-1.0], [1.0]])
        casting, receiving = (
            coverage.covered_tiles(coverage.flat_rectangles(boxes, frame, corner, width), size)
            for boxes in (found, self._receivers + around)
        )
        # Points outside the map may still have taps on it.
        whole = coverage.flat_rectangles(found + around, frame, corner - reach, width + 2.0 * reach)
        middle = np.append(corner + 0.5 * width, 0.0) @ frame
        self._mask.place(coverage.covered_tiles(whole, size), frame[None], middle, 0.5 * width + reach, False)
        return casting & receiving

    def _set_map(self, corner: np.ndarray, texel: float, near: float, far: float) -> None:
        m = self.map = DirectionalMap()
        m.depth, m.deepest = self._depths.depth, self._depths.deepest
        m.s_axis, m.t_axis, m.direction = (wp.vec3(*axis.tolist()) for axis in self._frame)
        m.s, m.t = corner.tolist()
        m.texel, m.near, m.far = texel, near, far
        rays = self._rays = MapRays()
        frame = self._frame[None].astype(np.float32)
        rays.frames, rays.perspective = self._launcher.array(frame, "shadow_map", dtype=wp.mat33), 0
        rays.s, rays.t, rays.depth, rays.texel = m.s, m.t, near, texel
        rays.start, rays.far = 0.0, far - near
        rays.cull = 1.0 if self._light.shadow_cull_front else 0.0

    def trace(self, covered: np.ndarray) -> None:
        """Traces these tiles of the map, [faces, rows, columns] bool, as it was last placed."""
        triangles = self._casters.triangles if self._depths.lists_triangles else np.zeros((0, 3, 3))
        near, far = float(self.map.near), float(self.map.far)
        planes = planes_from_afar(triangles, self._frame, near, far, self._light.shadow_cull_front)
        self._depths.trace(self._casters, self._rays, covered, planes, self._rounding)

    @property
    def _spread(self) -> float:
        """Tangent of half the light's width in the sky."""
        return float(np.tan(np.radians(min(0.5 * self._light.angle, 80.0))))

    def _reach(self, texel: float, depth: float) -> float:
        """Returns how far from a receiver the filter looks, at most [stage units]."""
        light = self._light
        if light.shadow_filter == "hard":
            return 0.0
        if light.shadow_filter == "pcss":
            return self._spread * depth + texel
        if light.shadow_filter == "pcf_disk_view":
            return depth  # the camera may be anywhere
        return 3**0.5 * ((light.shadow_softness or 0.0) + filters.DEFAULT_TEXELS * texel)

    def _filter(self) -> tuple[np.ndarray, float]:
        if self._light.shadow_filter == "hard":
            return np.zeros((1, 3)), filters.DEFAULT_TEXELS
        if self._light.shadow_filter == "pcf_grid":
            return filters.grid_of_plane() @ self._frame, 1.0
        if self._light.shadow_filter == "pcss":
            return filters.spiral() @ self._frame, 0.5
        return filters.edges_and_corners(), filters.DEFAULT_TEXELS

    def visibility(
        self, points: wp.array, normals: wp.array, visibility_out: wp.array, facets: wp.array | None = None
    ) -> None:
        """Writes the share of light from 0 to 1 that reaches each point; see `MapShadow.visibility`."""
        args = (self._launcher, self.map, self._mask.mask, self._taps)
        look = (points, normals, normals if facets is None else facets, visibility_out)
        if self._light.shadow_filter == "pcss":
            filter_penumbra(*args, self._spread, *look)
        else:
            filter_map(*args, *look)

    def depth_picture(self) -> np.ndarray:
        """Returns the stored depths, [size, size] uint8 (white = far)."""
        return np.round(255.0 * self._depths.depth.numpy()[0]).astype(np.uint8)
