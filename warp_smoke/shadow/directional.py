"""Shadows of a distant light by an orthographic depth map, ray-cast (after LearnOpenGL, *Shadow Mapping*)."""

from itertools import product

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import DistantLight
from warp_smoke.shadow.bias import Bias, fixed_bias, light_bias, round_off, tangent
from warp_smoke.shadow.casters import Casters

wp.set_module_options({"enable_backward": False})

_TILE = wp.constant(8)


@wp.struct
class DirectionalMap:
    """An orthographic depth map; set space · (s_axis, t_axis, direction) gives (s, t, depth) [stage units].

    Attributes:
        depth: (depth of the nearest surface − near) / (far − near) at texel centres, 1 where there is none, [t, s].
        s_axis, t_axis, direction: unit vectors: to the right and down in the map, and the way the light shines.
        s, t: of the map's upper left corner.
        texel: side of a texel.
        near, far: depth range.
        bias: how much deeper than the stored depth a point must lie to be in shadow.
    """

    depth: wp.array2d[float]
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
def directional_visibility(m: DirectionalMap, point: wp.vec3, normal: wp.vec3):
    """1 where the light reaches the point's front, else 0; lit outside the map.

    The bias is spread · tan θ, spread being half a texel's diagonal.
    """
    cosine = -wp.dot(m.direction, normal)
    visible = 0.0
    if cosine > 0.0:
        visible = 1.0
        s = (wp.dot(point, m.s_axis) - m.s) / m.texel
        t = (wp.dot(point, m.t_axis) - m.t) / m.texel
        if s >= 0.0 and t >= 0.0 and s < float(m.depth.shape[1]) and t < float(m.depth.shape[0]):
            bias = fixed_bias(m.bias, cosine) + m.bias.spread * tangent(cosine)
            d = wp.dot(point, m.direction) - m.near - bias
            if d <= m.far - m.near and d > m.depth[int(t), int(s)] * (m.far - m.near):
                visible = 0.0
    return visible


@wp.kernel
def _trace_directional(rows: Rows, mesh: wp.uint64, m: DirectionalMap, depth_out: wp.array2d[float]):
    """depth[t,s] = (nearest hit − near) / (far − near) along the direction; tile by tile."""
    n = rows.first + wp.tid()
    size = depth_out.shape[0]
    tiles = (size + _TILE - 1) // _TILE
    within = n % (_TILE * _TILE)
    n = n // (_TILE * _TILE)
    row = (n // tiles) * _TILE + within // _TILE
    column = (n % tiles) * _TILE + within % _TILE
    if row < size and column < size:
        s = m.s + m.texel * (float(column) + 0.5)
        t = m.t + m.texel * (float(row) + 0.5)
        start = s * m.s_axis + t * m.t_axis + m.near * m.direction
        hit = wp.mesh_query_ray(mesh, start, m.direction, m.far - m.near)
        depth = 1.0
        if hit.result:
            depth = hit.t / (m.far - m.near)
        depth_out[row, column] = depth


@wp.kernel
def _look_up_directional(
    rows: Rows,
    m: DirectionalMap,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """visibility[n] = directional_visibility(points[n], normals[n])."""
    n = rows.first + wp.tid()
    visibility_out[n] = directional_visibility(m, points[n], normals[n])


class DirectionalShadow:
    """Which points a distant light reaches, by an orthographic depth map.

    The map covers what both casts and receives: beyond the casters nothing is in shadow, beyond the receivers nobody
    asks. Its texels keep their size and place while things move a little, so that shadow edges do not shimmer.
    Points that face away from the light are in their own shadow. `shadow_near` and `shadow_far` do not apply: a
    distant light has no place to measure them from.

    Attributes:
        map: the map, for kernels that use `directional_visibility`.
    """

    def __init__(self, launcher: Launcher, light: DistantLight, casters: Casters, receiver_bounds: np.ndarray):
        """Makes the map; `update` traces it.

        Args:
            launcher: launches the kernels.
            light: the distant light.
            casters: what casts shadows.
            receiver_bounds: lower and upper corner, in set space, of all that is ever looked up, [2, 3].
        """
        self._launcher, self._light, self._casters = launcher, light, casters
        self._receiver_corners = np.array(list(product(*np.asarray(receiver_bounds, np.float64).T)))
        size = light.shadow_map_size
        self._depth = launcher.zeros((size, size), "directional_map")
        self._traced = None

    def update(self, time: float) -> None:
        """Fits and traces the map for a time code, unless it is the same as before."""
        light, casters = self._light, self._casters
        state = casters.version, light.transform_at(time).tobytes()
        if state == self._traced:
            return
        self._traced = state
        size = light.shadow_map_size
        frame = _frame(light.direction_at(time))
        cast = casters.mesh.points.numpy().astype(np.float64) @ frame.T
        received = self._receiver_corners @ frame.T
        extent = float(np.abs(self._receiver_corners).max())
        margin = round_off(max(casters.extent, extent))
        lower = np.maximum(cast.min(axis=0), received.min(axis=0)) - margin
        upper = np.minimum(cast.max(axis=0), received.max(axis=0)) + margin
        # The size of a texel is one of a fixed ladder, its place a whole number of texels from the set's origin.
        span = max(float((upper - lower)[:2].max()), margin)
        texel = 2.0 ** (np.ceil(8.0 * np.log2(span / max(size - 1, 1))) / 8.0)
        corner = np.floor(0.5 * (lower + upper)[:2] / texel - 0.5 * (size - 1)) * texel
        near = cast[:, 2].min() - margin
        far = max(received[:, 2].max(), near) + 2.0 * margin

        self.map = DirectionalMap()
        self.map.depth = self._depth
        self.map.s_axis, self.map.t_axis, self.map.direction = (wp.vec3(*axis.tolist()) for axis in frame)
        self.map.s, self.map.t = corner.tolist()
        self.map.texel, self.map.near, self.map.far = float(texel), float(near), float(far)
        self.map.bias = light_bias(light, spread=float(texel) * 0.5**0.5, extent=max(extent, float(far - near)))
        self._launcher.launch_each(
            _trace_directional, (-(-size // _TILE) * _TILE) ** 2, casters.mesh.id, self.map, self._depth
        )

    def visibility(self, points: wp.array, normals: wp.array, visibility_out: wp.array) -> None:
        """Writes 1 where the light reaches a point and 0 where it does not.

        Args:
            points: in set space, [n] vec3.
            normals: unit surface normals, [n] vec3.
            visibility_out: [n].
        """
        self._launcher.launch_each(_look_up_directional, len(points), self.map, points, normals, visibility_out)

    def depth_picture(self) -> np.ndarray:
        """The stored depths, [size, size] uint8 (white = far)."""
        return np.round(255.0 * self._depth.numpy()).astype(np.uint8)


def _frame(direction: np.ndarray) -> np.ndarray:
    """Right-handed unit axes s, t and the direction itself, one a row, [3, 3]."""
    s_axis = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    s_axis /= np.linalg.norm(s_axis)
    return np.stack([s_axis, np.cross(direction, s_axis), direction])
