"""Depth maps around a point: six faces of a cube, or one over a spot light's cone, ray-cast.

LearnOpenGL, *Point Shadows* and *Shadow Mapping*, describes the rasterised originals.
A texel stores the distance from the light to the nearest surface along the ray through its centre, divided by the far
distance; 1 where there is none. Row 0 is at the top (t = −1), column 0 at the left (s = −1).
"""

from itertools import product

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Camera, PointLight
from warp_smoke.shadow import coverage, filters
from warp_smoke.shadow.bias import Bias, fixed_bias, light_bias, round_off, tangent
from warp_smoke.shadow.casters import Casters, nearest_hit
from warp_smoke.shadow.filters import Taps

wp.set_module_options({"enable_backward": False})

_TILE = wp.constant(coverage.TILE)


@wp.struct
class PointMap:
    """A depth map.

    Attributes:
        depth: distance / far, [faces, size, size] by face, row and column.
        frames: axes s, t and the way it looks of each face, one a row, [faces].
        slope: tangent of the angle between the way a face looks and the middle of its side: 1 for a cube.
        position: the light in set space.
        far: [stage units]; points beyond are lit.
        bias: how much deeper than the stored depth a point must lie to be in shadow.
        near_caster: 1 for tiles from which the filter may reach a caster, [faces · rows · columns].
    """

    depth: wp.array3d[float]
    near_caster: wp.array[int]
    frames: wp.array[wp.mat33]
    slope: float
    position: wp.vec3
    far: float
    bias: Bias


@wp.func
def face_towards(r: wp.vec3):
    """The cube face that a direction passes through."""
    x = wp.abs(r[0])
    y = wp.abs(r[1])
    z = wp.abs(r[2])
    face = wp.where(r[2] < 0.0, 5, 4)
    if x >= y and x >= z:
        face = wp.where(r[0] < 0.0, 1, 0)
    elif y >= z:
        face = wp.where(r[1] < 0.0, 3, 2)
    return face


@wp.func
def map_coordinates(m: PointMap, r: wp.vec3):
    """(face, s, t) of a direction in texels and its depth along the face's axis, as a vec4 in that order."""
    face = 0
    if m.depth.shape[0] == 6:
        face = face_towards(r)
    v = m.frames[face] * r
    half = 0.5 * float(m.depth.shape[1])
    scale = half / (m.slope * wp.max(v[2], 1.0e-30))
    return wp.vec4(float(face), half + scale * v[0], half + scale * v[1], v[2])


@wp.func
def stored_depth(m: PointMap, c: wp.vec4):
    """The depth at map coordinates: the texel that they fall in; 1 beside the map."""
    size = m.depth.shape[1]
    limit = float(size)
    depth = wp.float32(1.0)
    if c[3] > 0.0 and c[1] >= 0.0 and c[2] >= 0.0 and c[1] <= limit and c[2] <= limit:
        depth = m.depth[int(c[0]), wp.min(int(c[2]), size - 1), wp.min(int(c[1]), size - 1)]
    return depth


@wp.func
def may_be_shadowed(m: PointMap, c: wp.vec4):
    """Whether the filter may reach a caster from map coordinates; never beside the map."""
    size = m.depth.shape[1]
    limit = float(size)
    found = wp.int32(0)
    if c[3] > 0.0 and c[1] >= 0.0 and c[2] >= 0.0 and c[1] <= limit and c[2] <= limit:
        across = (size + _TILE - 1) // _TILE
        row = wp.min(int(c[2]), size - 1) // _TILE
        found = m.near_caster[(int(c[0]) * across + row) * across + wp.min(int(c[1]), size - 1) // _TILE]
    return found != 0


@wp.func
def nearest_of_texel(m: PointMap, r: wp.vec3, normal: wp.vec3, u: wp.vec3):
    """The least distance, less the bias, at which the plane through the point r may lie in the texel around u; or −1.

    Along u the plane lies at e = |u| (n·r) / (n·u), taken to be |r| at most: that takes a third of the acne from a
    rough mesh's hollows. With x = spread · tan θ it is nowhere in the texel nearer than e / (1 + x): the least bias
    without acne on planes, for any θ. A light's own bias is taken off |r|. Where u passes over the plane's horizon,
    the result is −1.
    """
    length = wp.length(u)
    along = wp.dot(u, normal)
    cosine = -along / wp.max(length, 1.0e-30)
    nearest = wp.float32(-1.0)
    if m.bias.spread == 0.0:
        nearest = wp.max(wp.length(r) - fixed_bias(m.bias, -wp.dot(r, normal) / wp.max(wp.length(r), 1.0e-30)), 0.0)
    elif cosine > 0.0:
        e = wp.min(length * wp.dot(r, normal) / along, wp.length(r))
        nearest = wp.max(e / (1.0 + m.bias.spread * tangent(cosine)) - m.bias.constant, 0.0)
    return nearest


@wp.func
def look_up(m: PointMap, r: wp.vec3, normal: wp.vec3, u: wp.vec3):
    """(1, lit, stored distance of what shadows it or 0) of the texel around u; all 0 if u passes over the horizon."""
    nearest = nearest_of_texel(m, r, normal, u)
    stored = stored_depth(m, map_coordinates(m, u))
    counts = wp.where(nearest < 0.0, 0.0, 1.0)
    lit = wp.where(stored >= 1.0 or nearest <= stored * m.far, counts, 0.0)
    return wp.vec3(counts, lit, (counts - lit) * stored * m.far)


@wp.kernel
def _trace_tiles(
    rows: Rows,
    mesh: wp.uint64,
    m: PointMap,
    start: float,
    cull: float,
    tiles: wp.array[int],
    count: int,
    depth_out: wp.array3d[float],
):
    """depth[f,t,s] = |hit − light| / far, nearest hit from `start` on, for the first `count` tiles."""
    n = rows.first + wp.tid()
    within = n % (_TILE * _TILE)
    n = n // (_TILE * _TILE)
    if n < count:
        tile = tiles[n]
        size = depth_out.shape[1]
        across = (size + _TILE - 1) // _TILE
        row = (tile // across) % across * _TILE + within // _TILE
        column = tile % across * _TILE + within % _TILE
        face = tile // (across * across)
        if row < size and column < size:
            texel = 2.0 * m.slope / float(size)
            s = texel * (float(column) + 0.5) - m.slope
            t = texel * (float(row) + 0.5) - m.slope
            direction = wp.transpose(m.frames[face]) * wp.vec3(s, t, 1.0)
            length = wp.length(direction)
            first = m.position + (start / length) * direction
            hit = nearest_hit(mesh, first, direction, (m.far - start) / length, cull)
            depth_out[face, row, column] = wp.where(hit < 0.0, 1.0, (start + hit * length) / m.far)


@wp.kernel
def _filter_taps(
    rows: Rows,
    m: PointMap,
    taps: Taps,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """visibility[n] = share of taps that are lit, among those below the horizon of the point's plane."""
    n = rows.first + wp.tid()
    normal = normals[n]
    r = points[n] - m.position
    visible = wp.float32(0.0)
    if wp.dot(r, normal) < 0.0:
        visible = wp.float32(1.0)
        c = map_coordinates(m, r)
        if wp.length(r) <= m.far and may_be_shadowed(m, c):
            texel = 2.0 * m.slope * c[3] / float(m.depth.shape[1])
            reach = taps.radius * (1.0 + taps.growth * wp.length(points[n] - taps.eye)) + taps.texels * texel
            total = wp.vec3(0.0, 0.0, 0.0)
            for k in range(taps.offsets.shape[0]):
                total += look_up(m, r, normal, r + reach * taps.offsets[k])
            visible = total[1] / wp.max(total[0], 1.0)
    visibility_out[n] = visible


@wp.kernel
def _filter_penumbra(
    rows: Rows,
    m: PointMap,
    taps: Taps,
    light: float,
    closest: float,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """Percentage-closer soft shadows (Fernando, 2005): blockers at mean distance b widen the filter to R (d − b) / b.

    Blockers are searched for within R (d − b₀) / b₀, b₀ being the distance of the closest caster.
    """
    n = rows.first + wp.tid()
    normal = normals[n]
    r = points[n] - m.position
    visible = wp.float32(0.0)
    if wp.dot(r, normal) < 0.0:
        visible = wp.float32(1.0)
        d = wp.length(r)
        c = map_coordinates(m, r)
        if d <= m.far and may_be_shadowed(m, c):
            texel = 2.0 * m.slope * c[3] / float(m.depth.shape[1])
            toward = r / wp.max(d, 1.0e-30)
            side = wp.vec3(1.0, 0.0, 0.0)
            if wp.abs(toward[0]) > 0.7:
                side = wp.vec3(0.0, 1.0, 0.0)
            right = wp.normalize(wp.cross(side, toward))
            up = wp.cross(toward, right)
            smallest = taps.texels * texel
            reach = wp.clamp(light * (d - closest) / closest, smallest, d)
            total = wp.vec3(0.0, 0.0, 0.0)
            for k in range(taps.offsets.shape[0]):
                o = reach * taps.offsets[k]
                total += look_up(m, r, normal, r + o[0] * right + o[1] * up)
            if total[1] < total[0]:
                b = total[2] / (total[0] - total[1])
                width = wp.clamp(light * (d - b) / wp.max(b, 1.0e-30), smallest, d)
                filtered = wp.vec3(0.0, 0.0, 0.0)
                for k in range(taps.offsets.shape[0]):
                    o = width * taps.offsets[k]
                    filtered += look_up(m, r, normal, r + o[0] * right + o[1] * up)
                visible = filtered[1] / wp.max(filtered[0], 1.0)
    visibility_out[n] = visible


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
        self._depth.fill_(1.0)
        self._tiles, self._near_caster = (
            launcher.zeros(self.faces * (-(-size // coverage.TILE)) ** 2, "shadow_map", dtype=int) for _ in range(2)
        )
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
        self.map.depth, self.map.position, self.map.far = self._depth, wp.vec3(*position.tolist()), far
        self.map.slope, self.map.near_caster = self.slope, self._near_caster
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
        self._near_caster.assign(near.ravel().astype(np.int32))
        if self._covered is not None and np.any(self._covered & ~covered):
            self._depth.fill_(1.0)
        self._covered = covered
        tiles = np.flatnonzero(covered).astype(np.int32)
        self.rays = len(tiles) * coverage.TILE**2
        if len(tiles):
            self._tiles[: len(tiles)].assign(tiles)
            cull = 1.0 if light.shadow_cull_front else 0.0
            self._launcher.launch_each(
                _trace_tiles,
                coverage.launch_size(len(tiles)) * coverage.TILE**2,
                casters.mesh.id,
                self.map,
                start,
                cull,
                self._tiles,
                len(tiles),
                self._depth,
            )

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
        count, look = len(points), (points, normals, visibility_out)
        if self._light.shadow_filter == "pcss":
            args = (self.map, self._taps, float(self._light.radius), self._closest)
            self._launcher.launch_each(_filter_penumbra, count, *args, *look)
        else:
            self._launcher.launch_each(_filter_taps, count, self.map, self._taps, *look)


def _union(boxes: np.ndarray) -> np.ndarray:
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
