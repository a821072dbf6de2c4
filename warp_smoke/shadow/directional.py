"""Shadows of a distant light by an orthographic depth map, ray-cast (after LearnOpenGL, *Shadow Mapping*)."""

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Camera, DistantLight
from warp_smoke.shadow import coverage, filters
from warp_smoke.shadow.bias import Bias, fixed_bias, light_bias, round_off, tangent
from warp_smoke.shadow.caster_mask import CasterMask, CasterTiles, may_be_shadowed
from warp_smoke.shadow.casters import Casters, nearest_hit
from warp_smoke.shadow.filters import Taps
from warp_smoke.shadow.umbra import deepest_of_tile, deepest_within

wp.set_module_options({"enable_backward": False})

_TILE = wp.constant(coverage.TILE)
_FARTHEST_TAP = wp.constant(3.0**0.5)  # of the offsets of fixed filters, in half-widths


@wp.struct
class DirectionalMap:
    """An orthographic depth map; set space · (s_axis, t_axis, direction) gives (s, t, depth) [stage units].

    Attributes:
        depth: (depth of the nearest surface − near) / (far − near) at texel centres, 1 where there is none, [t, s].
        deepest: largest `depth` in each tile, [1, rows, columns]; 1 where nothing was traced.
        s_axis, t_axis, direction: unit vectors: to the right and down in the map, and the way the light shines.
        s, t: of the map's upper left corner.
        texel: side of a texel.
        near, far: depth range.
        bias: how much deeper than the stored depth a point must lie to be in shadow.
    """

    depth: wp.array2d[float]
    deepest: wp.array3d[float]
    s_axis: wp.vec3
    t_axis: wp.vec3
    direction: wp.vec3
    s: float
    t: float
    texel: float
    near: float
    far: float
    bias: Bias


@wp.func
def stored_depth(m: DirectionalMap, point: wp.vec3):
    """The depth from `near` on that is stored where a point falls; infinite beside the map and where nothing is."""
    s = (wp.dot(point, m.s_axis) - m.s) / m.texel
    t = (wp.dot(point, m.t_axis) - m.t) / m.texel
    stored = wp.float32(1.0)
    if s >= 0.0 and t >= 0.0 and s < float(m.depth.shape[1]) and t < float(m.depth.shape[0]):
        stored = m.depth[int(t), int(s)]
    return wp.where(stored < 1.0, stored * (m.far - m.near), 1.0e30)


@wp.func
def nearest_of_texel(m: DirectionalMap, point: wp.vec3, normal: wp.vec3, cosine: float, offset: wp.vec3):
    """The least depth from `near` on, less the bias, of the plane through a point in the texel at an offset.

    The bias is spread · tan θ, spread being half a texel's diagonal. A light's own bias is taken off the point's depth.
    """
    d = wp.dot(point, m.direction) - m.near - fixed_bias(m.bias, cosine)
    if m.bias.spread > 0.0:
        along = wp.dot(offset, m.s_axis) * wp.dot(normal, m.s_axis)
        along += wp.dot(offset, m.t_axis) * wp.dot(normal, m.t_axis)
        d += along / wp.max(cosine, 1.0e-6) - m.bias.spread * tangent(cosine)
    return d


@wp.func
def in_umbra(m: DirectionalMap, point: wp.vec3, normal: wp.vec3, cosine: float, reach: float):
    """Whether all within `reach` of a point lies deeper than what is stored there; if unsure, it is false."""
    s = (wp.dot(point, m.s_axis) - m.s) / m.texel
    t = (wp.dot(point, m.t_axis) - m.t) / m.texel
    deepest = deepest_within(m.deepest, m.depth.shape[0], 0, s, t, reach / m.texel)
    found = wp.bool(False)
    if deepest < 1.0:
        least = nearest_of_texel(m, point, normal, cosine, wp.vec3())
        if m.bias.spread > 0.0:
            least -= reach * tangent(cosine)
        found = least > deepest * (m.far - m.near)
    return found


@wp.kernel
def _bound_tiles(
    rows: Rows, depth: wp.array3d[float], tiles: wp.array[int], count: int, deepest_out: wp.array3d[float]
):
    """deepest[0,t,s] = max depth in the tile, for the first `count` tiles."""
    n = rows.first + wp.tid()
    if n < count:
        row = tiles[n] // deepest_out.shape[1]
        column = tiles[n] % deepest_out.shape[1]
        deepest_out[0, row, column] = deepest_of_tile(depth, 0, row, column)


@wp.kernel
def _trace_directional(
    rows: Rows,
    mesh: wp.uint64,
    m: DirectionalMap,
    cull: float,
    tiles: wp.array[int],
    count: int,
    depth_out: wp.array2d[float],
):
    """depth[t,s] = (nearest hit − near) / (far − near) along the direction, for the first `count` tiles."""
    n = rows.first + wp.tid()
    within = n % (_TILE * _TILE)
    n = n // (_TILE * _TILE)
    if n < count:
        size = depth_out.shape[0]
        across = (size + _TILE - 1) // _TILE
        row = tiles[n] // across * _TILE + within // _TILE
        column = tiles[n] % across * _TILE + within % _TILE
        if row < size and column < size:
            s = m.s + m.texel * (float(column) + 0.5)
            t = m.t + m.texel * (float(row) + 0.5)
            start = s * m.s_axis + t * m.t_axis + m.near * m.direction
            hit = nearest_hit(mesh, start, m.direction, m.far - m.near, cull)
            depth_out[row, column] = wp.where(hit < 0.0, 1.0, hit / (m.far - m.near))


@wp.kernel
def _filter_taps(
    rows: Rows,
    m: DirectionalMap,
    mask: CasterMask,
    taps: Taps,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """visibility[n] = share of taps that are lit."""
    n = rows.first + wp.tid()
    p = points[n]
    cosine = -wp.dot(m.direction, normals[n])
    visible = wp.float32(0.0)
    if cosine > 0.0:
        visible = wp.float32(1.0)
        if wp.dot(p, m.direction) <= m.far and may_be_shadowed(mask, p):
            reach = taps.radius * (1.0 + taps.growth * wp.length(p - taps.eye)) + taps.texels * m.texel
            lit = wp.float32(0.0)
            if not in_umbra(m, p, normals[n], cosine, _FARTHEST_TAP * reach):
                for k in range(taps.offsets.shape[0]):
                    o = reach * taps.offsets[k]
                    if nearest_of_texel(m, p, normals[n], cosine, o) <= stored_depth(m, p + o):
                        lit += 1.0
            visible = lit / float(taps.offsets.shape[0])
    visibility_out[n] = visible


@wp.kernel
def _filter_penumbra(
    rows: Rows,
    m: DirectionalMap,
    mask: CasterMask,
    taps: Taps,
    spread: float,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """Percentage-closer soft shadows (Fernando, 2005): blockers at mean depth b widen the filter to spread (d − b)."""
    n = rows.first + wp.tid()
    p = points[n]
    cosine = -wp.dot(m.direction, normals[n])
    visible = wp.float32(0.0)
    if cosine > 0.0:
        visible = wp.float32(1.0)
        d = wp.dot(p, m.direction) - m.near
        if d <= m.far - m.near and may_be_shadowed(mask, p):
            smallest = taps.texels * m.texel
            reach = wp.max(spread * d, smallest)
            total = wp.float32(0.0)
            blockers = wp.float32(0.0)
            if in_umbra(m, p, normals[n], cosine, reach):
                visible = wp.float32(0.0)
            else:
                for k in range(taps.offsets.shape[0]):
                    o = reach * taps.offsets[k]
                    stored = stored_depth(m, p + o)
                    if nearest_of_texel(m, p, normals[n], cosine, o) > stored:
                        blockers += 1.0
                        total += stored
            if blockers > 0.0:
                reach = wp.max(spread * (d - total / blockers), smallest)
                lit = wp.float32(0.0)
                for k in range(taps.offsets.shape[0]):
                    o = reach * taps.offsets[k]
                    if nearest_of_texel(m, p, normals[n], cosine, o) <= stored_depth(m, p + o):
                        lit += 1.0
                visible = lit / float(taps.offsets.shape[0])
    visibility_out[n] = visible


class DirectionalShadow:
    """Which points a distant light reaches, by an orthographic depth map.

    The map covers what both casts and receives: beyond the casters nothing is in shadow, beyond the receivers nobody
    asks. Its texels keep their size and place while things move a little, so that shadow edges do not shimmer.
    Points that face away from the light are in their own shadow. `shadow_near` and `shadow_far` do not apply: a
    distant light has no place to measure them from. Only tiles over which a caster and a receiver may lie are traced.

    Attributes:
        map: the depth map.
        rays: how many texels were traced at the last change.
    """

    def __init__(
        self,
        launcher: Launcher,
        light: DistantLight,
        casters: Casters,
        receiver_bounds: np.ndarray,
        camera: Camera | None = None,
    ):
        """Makes the map; `update` traces it.

        Args:
            launcher: launches the kernels.
            light: the distant light.
            casters: what casts shadows.
            receiver_bounds: lower and upper corner, in set space, of all that is ever looked up: a box [2, 3], or one
                for each receiver [n, 2, 3].
            camera: whose distance widens the filter `pcf_disk_view`.
        """
        self._launcher, self._light, self._casters, self._camera = launcher, light, casters, camera
        self._receivers = np.asarray(receiver_bounds, np.float64).reshape(-1, 2, 3)
        size = light.shadow_map_size
        self._depth = launcher.zeros((size, size), "shadow_map")
        across = -(-size // coverage.TILE)
        self._deepest = launcher.zeros((1, across, across), "shadow_map")
        self._clear()
        self._tiles = launcher.zeros(across**2, "shadow_map", dtype=int)
        self._mask = CasterTiles(launcher, 1, size)
        self._traced, self._looked, self._covered = None, None, None
        self.rays = 0

    def update(self, time: float) -> None:
        """Fits and traces the map for a time code, unless it is the same as before."""
        light, casters = self._light, self._casters
        state = casters.version, light.transform_at(time).tobytes()
        eye = filters.eye_at(self._camera, time, casters.origin)
        looked = state, None if eye is None else eye.tobytes()
        if state != self._traced:
            self._trace(time)
        if looked != self._looked:
            texels = {"pcf_grid": 1.0, "pcss": 0.5}.get(light.shadow_filter, filters.DEFAULT_TEXELS)
            far = float(self.map.far - self.map.near)
            self._taps = filters.filter_taps(self._launcher, light, self._offsets(), texels, eye, far)
        self._traced, self._looked = state, looked

    def _trace(self, time: float) -> None:
        light, casters = self._light, self._casters
        size = light.shadow_map_size
        self._frame = frame = coverage.frame_along(light.direction_at(time))
        corners = coverage.box_corners(self._receivers).reshape(-1, 3)
        extent = float(np.abs(corners).max())
        found = casters.boxes_behind_which(self._receivers, np.append(-frame[2], 0.0), round_off(extent))
        received = corners @ frame.T
        margin = round_off(max(casters.extent, extent))
        cast = coverage.box_corners(found).reshape(-1, 3) @ frame.T if len(found) else received.max(axis=0)[None]
        lower = np.maximum(cast.min(axis=0), received.min(axis=0)) - margin
        upper = np.minimum(cast.max(axis=0), received.max(axis=0)) + margin
        # The size of a texel is one of a fixed ladder, its place a whole number of texels from the set's origin.
        span = max(float((upper - lower)[:2].max()), margin)
        texel = 2.0 ** (np.ceil(8.0 * np.log2(span / max(size - 1, 1))) / 8.0)
        corner = np.floor(0.5 * (lower + upper)[:2] / texel - 0.5 * (size - 1)) * texel
        near = cast[:, 2].min() - margin
        far = max(received[:, 2].max(), near) + 2.0 * margin

        self.map = DirectionalMap()
        self.map.depth, self.map.deepest = self._depth, self._deepest
        self.map.s_axis, self.map.t_axis, self.map.direction = (wp.vec3(*axis.tolist()) for axis in frame)
        self.map.s, self.map.t = corner.tolist()
        self.map.texel, self.map.near, self.map.far = float(texel), float(near), float(far)
        self.map.bias = light_bias(light, spread=float(texel) * 0.5**0.5, extent=max(extent, float(far - near)))

        width = float(texel) * size
        reach = self._reach(float(texel), float(far - near))
        around = reach * np.array([[-1.0], [1.0]])
        casting, receiving = (
            coverage.covered_tiles(coverage.flat_rectangles(boxes, frame, corner, width), size)
            for boxes in (found, self._receivers + around)
        )
        # Points beside the map may still have taps on it.
        whole = coverage.flat_rectangles(found + around, frame, corner - reach, width + 2.0 * reach)
        middle = np.append(corner + 0.5 * width, 0.0) @ frame
        near_caster = coverage.covered_tiles(whole, size)
        self._mask.place(near_caster, frame[None], middle, 0.5 * width + reach, False)
        covered = casting & receiving
        if self._covered is not None and np.any(self._covered & ~covered):
            self._clear()
        self._covered = covered
        tiles = np.flatnonzero(covered).astype(np.int32)
        self.rays = len(tiles) * coverage.TILE**2
        if len(tiles):
            self._tiles[: len(tiles)].assign(tiles)
            cull = 1.0 if light.shadow_cull_front else 0.0
            size = coverage.launch_size(len(tiles))
            args = (casters.mesh.id, self.map, cull, self._tiles, len(tiles), self._depth)
            self._launcher.launch_each(_trace_directional, size * coverage.TILE**2, *args)
            faces = self._depth.reshape((1, *self._depth.shape))
            self._launcher.launch_each(_bound_tiles, size, faces, self._tiles, len(tiles), self._deepest)

    def _clear(self) -> None:
        self._depth.fill_(1.0)
        self._deepest.fill_(1.0)

    @property
    def _spread(self) -> float:
        """Tangent of half the light's width in the sky."""
        return float(np.tan(np.radians(min(0.5 * self._light.angle, 80.0))))

    def _reach(self, texel: float, depth: float) -> float:
        """How far beside a receiver the filter looks, at most [stage units]."""
        light = self._light
        if light.shadow_filter == "hard":
            return 0.0
        if light.shadow_filter == "pcss":
            return self._spread * depth + texel
        if light.shadow_filter == "pcf_disk_view":
            return depth  # the camera may be anywhere
        return 3**0.5 * ((light.shadow_softness or 0.0) + filters.DEFAULT_TEXELS * texel)

    def _offsets(self) -> np.ndarray:
        if self._light.shadow_filter == "hard":
            return np.zeros((1, 3))
        if self._light.shadow_filter == "pcf_grid":
            return filters.grid_of_plane() @ self._frame
        if self._light.shadow_filter == "pcss":
            return filters.spiral() @ self._frame
        return filters.edges_and_corners()

    def visibility(self, points: wp.array, normals: wp.array, visibility_out: wp.array) -> None:
        """Writes the share of light from 0 to 1 that reaches each point.

        Args:
            points: in set space, [n] vec3.
            normals: unit surface normals, [n] vec3.
            visibility_out: [n].
        """
        args, look = (self.map, self._mask.mask, self._taps), (points, normals, visibility_out)
        if self._light.shadow_filter == "pcss":
            self._launcher.launch_each(_filter_penumbra, len(points), *args, self._spread, *look)
        else:
            self._launcher.launch_each(_filter_taps, len(points), *args, *look)

    def depth_picture(self) -> np.ndarray:
        """The stored depths, [size, size] uint8 (white = far)."""
        return np.round(255.0 * self._depth.numpy()).astype(np.uint8)
