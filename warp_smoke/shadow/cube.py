"""Shadows of a point light by a depth cube map, ray-cast (after LearnOpenGL, *Point Shadows*).

Faces in OpenGL's order and orientation: +X −X +Y −Y +Z −Z along the world's axes, row 0 at the top (t = 0), column 0
at the left (s = 0). A texel stores the distance from the light to the nearest surface along the ray through its
centre, divided by the far distance; 1 where there is none.
"""

from itertools import product

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import PointLight, SpotLight
from warp_smoke.shadow.bias import Bias, fixed_bias, light_bias, round_off, tangent
from warp_smoke.shadow.casters import Casters

wp.set_module_options({"enable_backward": False})

FACE_AXES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
_FACE_IN_CROSS = ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (1, 3))  # row and column of each face in the picture
_CORNER_ANGLE = np.arccos(3**-0.5)  # from a face's axis to its corners
# Rays of a tile of 8 × 8 texels pass through the same part of the hierarchy.
_TILE = wp.constant(8)


@wp.struct
class CubeMap:
    """A depth cube map.

    Attributes:
        depth: distance / far, [6, size, size] by face, row and column.
        position: the light in set space.
        far: [stage units]; points beyond are lit.
        bias: how much deeper than the stored depth a point must lie to be in shadow.
    """

    depth: wp.array3d[float]
    position: wp.vec3
    far: float
    bias: Bias


@wp.func
def cube_direction(face: int, s: float, t: float):
    """The direction, 1 along the face's axis, for s to the right and t down on it, both in [−1, 1]."""
    r = wp.vec3(1.0, -t, -s)
    if face == 1:
        r = wp.vec3(-1.0, -t, s)
    if face == 2:
        r = wp.vec3(s, 1.0, t)
    if face == 3:
        r = wp.vec3(s, -1.0, -t)
    if face == 4:
        r = wp.vec3(s, -t, 1.0)
    if face == 5:
        r = wp.vec3(-s, -t, -1.0)
    return r


@wp.func
def cube_depth(cube: CubeMap, r: wp.vec3):
    """The stored depth in the direction r: the texel that r falls in."""
    a = wp.vec3(wp.abs(r[0]), wp.abs(r[1]), wp.abs(r[2]))
    face = 0
    s = 0.0
    t = 0.0
    m = 0.0
    if a[0] >= a[1] and a[0] >= a[2]:
        face = wp.where(r[0] < 0.0, 1, 0)
        s = wp.where(r[0] < 0.0, r[2], -r[2])
        t = -r[1]
        m = a[0]
    elif a[1] >= a[2]:
        face = wp.where(r[1] < 0.0, 3, 2)
        s = r[0]
        t = wp.where(r[1] < 0.0, -r[2], r[2])
        m = a[1]
    else:
        face = wp.where(r[2] < 0.0, 5, 4)
        s = wp.where(r[2] < 0.0, -r[0], r[0])
        t = -r[1]
        m = a[2]
    size = cube.depth.shape[1]
    half = 0.5 * float(size)
    row = wp.min(int(half * (t / m + 1.0)), size - 1)
    column = wp.min(int(half * (s / m + 1.0)), size - 1)
    return cube.depth[face, row, column]


@wp.func
def cube_visibility(cube: CubeMap, point: wp.vec3, normal: wp.vec3):
    """1 where the light reaches the point's front, else 0: d − bias > stored · far is in shadow.

    With x = spread · tan θ, the plane through the point is nowhere in its texel nearer than d / (1 + x): the bias
    d x / (1 + x) is the least without acne, for any θ.
    """
    r = point - cube.position
    d = wp.length(r)
    cosine = -wp.dot(r, normal) / wp.max(d, 1.0e-30)
    visible = 0.0
    if cosine > 0.0:
        x = cube.bias.spread * tangent(cosine)
        nearest = d / (1.0 + x) - fixed_bias(cube.bias, cosine)
        if d > cube.far or nearest <= cube_depth(cube, r) * cube.far:
            visible = 1.0
    return visible


@wp.kernel
def _trace_cube(
    rows: Rows,
    mesh: wp.uint64,
    position: wp.vec3,
    start: float,
    far: float,
    faces: wp.array[int],
    count: int,
    depth_out: wp.array3d[float],
):
    """depth[f,t,s] = |hit − light| / far, nearest hit from `start` on, for the first `count` faces, tile by tile."""
    n = rows.first + wp.tid()
    size = depth_out.shape[1]
    tiles = (size + _TILE - 1) // _TILE
    within = n % (_TILE * _TILE)
    n = n // (_TILE * _TILE)
    face = faces[n % count]
    n = n // count
    row = (n // tiles) * _TILE + within // _TILE
    column = (n % tiles) * _TILE + within % _TILE
    if row < size and column < size:
        texel = 2.0 / float(size)
        direction = cube_direction(face, texel * (float(column) + 0.5) - 1.0, texel * (float(row) + 0.5) - 1.0)
        length = wp.length(direction)
        hit = wp.mesh_query_ray(mesh, position + (start / length) * direction, direction, (far - start) / length)
        depth = 1.0
        if hit.result:
            depth = (start + hit.t * length) / far
        depth_out[face, row, column] = depth


@wp.kernel
def _look_up_cube(
    rows: Rows, cube: CubeMap, points: wp.array[wp.vec3], normals: wp.array[wp.vec3], visibility_out: wp.array[float]
):
    """visibility[n] = cube_visibility(points[n], normals[n])."""
    n = rows.first + wp.tid()
    visibility_out[n] = cube_visibility(cube, points[n], normals[n])


class CubeShadow:
    """Which points a point light reaches, by a depth cube map.

    Points that face away from the light are in their own shadow. Surfaces nearer to the light than `shadow_near`
    cast none, nor does a surface that the light itself lies on; a light inside a closed mesh reaches only its inside.
    A spot light's map has only the faces that its cone touches.

    Attributes:
        map: the map, for kernels that use `cube_visibility`.
    """

    def __init__(self, launcher: Launcher, light: PointLight, casters: Casters, receiver_bounds: np.ndarray):
        """Makes the map; `update` traces it.

        Args:
            launcher: launches the kernels.
            light: a point or spot light.
            casters: what casts shadows.
            receiver_bounds: lower and upper corner, in set space, of all that is ever looked up, [2, 3].
        """
        self._launcher, self._light, self._casters = launcher, light, casters
        self._receiver_corners = np.array(list(product(*np.asarray(receiver_bounds, np.float64).T)))
        size = light.shadow_map_size
        self._depth = launcher.zeros((6, size, size), "cube_map")
        self._faces = launcher.zeros(6, "cube_map", dtype=int)
        self._traced = None

    def update(self, time: float) -> None:
        """Traces the map for a time code, unless it is the same as before."""
        light, casters = self._light, self._casters
        state = casters.version, light.transform_at(time).tobytes()
        if state == self._traced:
            return
        self._traced = state
        position = light.position_at(time) - casters.origin
        # Rays begin where the casters do, so that a far light loses no digits, and off the surface a light lies on.
        extent = float(np.abs(self._receiver_corners).max())
        radius = 0.5 * np.linalg.norm(casters.upper - casters.lower)
        distance = np.linalg.norm(position - 0.5 * (casters.lower + casters.upper))
        start = max(light.shadow_near or 0.0, round_off(extent), distance - 1.001 * radius)
        far = light.shadow_far
        if far is None:
            far = 1.00001 * float(np.linalg.norm(self._receiver_corners - position, axis=1).max())
        faces = touched_faces(light, time) if isinstance(light, SpotLight) else np.arange(6)

        size = light.shadow_map_size
        self.map = CubeMap()
        self.map.depth, self.map.position, self.map.far = self._depth, wp.vec3(*position.tolist()), far
        self.map.bias = light_bias(light, spread=2**0.5 / size, extent=max(far, extent))
        self._faces.assign(np.resize(faces, 6).astype(np.int32))
        if len(faces) < 6:
            self._depth.fill_(1.0)
        tiles = (-(-size // _TILE)) ** 2
        self._launcher.launch_each(
            _trace_cube,
            len(faces) * tiles * _TILE**2,
            casters.mesh.id,
            self.map.position,
            float(start),
            far,
            self._faces,
            len(faces),
            self._depth,
        )

    def visibility(self, points: wp.array, normals: wp.array, visibility_out: wp.array) -> None:
        """Writes 1 where the light reaches a point and 0 where it does not.

        Args:
            points: in set space, [n] vec3.
            normals: unit surface normals, [n] vec3.
            visibility_out: [n].
        """
        self._launcher.launch_each(_look_up_cube, len(points), self.map, points, normals, visibility_out)

    def depth_picture(self) -> np.ndarray:
        """The stored depths as a cross, +Z in the middle and +Y above it, [3 size, 4 size] uint8 (white = far)."""
        depth = np.round(255.0 * self._depth.numpy()).astype(np.uint8)
        size = depth.shape[1]
        picture = np.zeros((3 * size, 4 * size), np.uint8)
        for face, (row, column) in zip(depth, _FACE_IN_CROSS, strict=True):
            picture[row * size : (row + 1) * size, column * size : (column + 1) * size] = face
        return picture


def touched_faces(light: SpotLight, time: float) -> np.ndarray:
    """The cube faces that a spot light's cone may touch."""
    angle = np.arccos(np.clip(FACE_AXES @ light.direction_at(time), -1.0, 1.0))
    return np.flatnonzero(angle <= np.radians(light.cone_angle) + _CORNER_ANGLE + 1e-6)
