"""Rays from the camera to the first surface, and the light of surfaces put together into a picture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_smoke.geometry import winding_flips
from warp_smoke.launch import Launcher, Rows
from warp_smoke.material import Material
from warp_smoke.scene import Camera, Surface
from warp_smoke.shading.looks import Looks, opacity_at
from warp_smoke.shading.placement import place_normals, place_points
from warp_smoke.shading.srgb import SrgbTable, encode_srgb
from warp_smoke.shading.surface_points import SurfacePoints
from warp_smoke.shading.tangents import corner_tangents

wp.set_module_options({"enable_backward": False})

# Holes that a ray passes at most, and how far beyond one it goes on, as a share of its length.
_MOST_HOLES = wp.constant(64)
_PAST_A_HOLE = wp.constant(1.0e-5)


@wp.struct
class View:
    """A pinhole camera in set space; what lies from near to far along its axis is seen.

    The ray through (x, y) pixels from the top left has the direction first + x · across + y · down, of any length.
    """

    eye: wp.vec3
    axis: wp.vec3
    first: wp.vec3
    across: wp.vec3
    down: wp.vec3
    near: float
    far: float
    width: int


def camera_view(camera: Camera, origin: np.ndarray, time: float, width: int, height: int) -> View:
    """What a camera sees; the whole of its aperture is in the picture, whose other side may show more.

    Args:
        camera: the camera.
        origin: world position of set space's origin, [3] float64.
        time: time code.
        width: of the picture [pixels].
        height: of the picture [pixels].
    """
    matrix = camera.transform_at(time)
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=1, keepdims=True)
    pixel = max(camera.vertical_aperture / height, camera.horizontal_aperture / width) / camera.focal_length
    offset = np.array([camera.horizontal_offset, camera.vertical_offset]) / camera.focal_length
    view = View()
    view.eye = wp.vec3(*(matrix[3, :3] - origin))
    view.axis = wp.vec3(*-axes[2])
    corner = (offset[0] - 0.5 * width * pixel) * axes[0] + (offset[1] + 0.5 * height * pixel) * axes[1] - axes[2]
    view.first, view.across, view.down = wp.vec3(*corner), wp.vec3(*(pixel * axes[0])), wp.vec3(*(-pixel * axes[1]))
    view.near, view.far, view.width = max(camera.near, 0.0), camera.far, width
    return view


@wp.struct
class TriangleTable:
    """What is interpolated over triangles, in the order of the rays' mesh.

    Attributes:
        normals, tangents, uvs: at each corner, [m, 3]; one row of tangents or uvs where no material needs them.
        material: index into `Looks.materials`, [m].
        surface: index into the scene's surfaces, [m].
    """

    normals: wp.array2d[wp.vec3]
    tangents: wp.array2d[wp.vec4]
    uvs: wp.array2d[wp.vec2]
    material: wp.array[int]
    surface: wp.array[int]


@dataclass(frozen=True)
class Dressing:
    """Materials as surfaces can show them, and for each surface the index of each triangle's material, [m] int32."""

    materials: tuple[Material, ...]
    index: tuple[np.ndarray, ...]

    @property
    def needs_tangents(self) -> bool:
        """Whether any has directions in tangent space."""
        return any(material.needs_tangents for material in self.materials)


def triangle_table(
    launcher: Launcher,
    surfaces: Sequence[Surface],
    surface_of_triangle: np.ndarray,
    dressing: Dressing,
    origin: np.ndarray,
    time: float,
) -> TriangleTable:
    """The table of the visible surfaces at a time code.

    Args:
        launcher: where to allocate.
        surfaces: all of the scene's.
        surface_of_triangle: index of the surface of each of the mesh's triangles, [m]; whole surfaces one by one.
        dressing: the surfaces' materials.
        origin: world position of set space's origin, [3] float64.
        time: time code.
    """
    normals, tangents, uvs, material = [], [], [], []
    for index in dict.fromkeys(surface_of_triangle.tolist()):
        surface, mesh = surfaces[index], surfaces[index].mesh
        order = slice(None, None, -1 if winding_flips(surface.transform_at(time)) else 1)
        corner_normals = place_normals(surface, time)
        corner_uvs = np.zeros((len(mesh.triangles), 3, 2), np.float32) if mesh.uvs is None else mesh.uvs
        material.append(dressing.index[index])
        normals.append(corner_normals[:, order])
        uvs.append(corner_uvs[:, order])
        if any(dressing.materials[n].needs_tangents for n in np.unique(dressing.index[index])):
            points = place_points(surface, origin, time)
            tangents.append(corner_tangents(points, mesh.triangles, corner_normals, corner_uvs)[:, order])
        elif dressing.needs_tangents:
            tangents.append(np.zeros((len(mesh.triangles), 3, 4), np.float32))
    table = TriangleTable()

    def put(parts: list, width: int, dtype: type) -> wp.array:
        values = np.concatenate(parts) if parts else np.zeros((1, 3, width))
        return launcher.array(np.ascontiguousarray(values, np.float32), "picture", dtype=dtype)

    table.normals, table.uvs = put(normals, 3, wp.vec3), put(uvs, 2, wp.vec2)
    table.tangents = put(tangents, 4, wp.vec4)
    surface_index = surface_of_triangle if len(surface_of_triangle) else np.zeros(1, np.int32)
    table.surface = launcher.array(surface_index.astype(np.int32), "picture")
    table.material = launcher.array(np.concatenate(material or [np.zeros(1, np.int32)]), "picture")
    return table


@wp.struct
class Hits:
    """Where the rays of a picture end, [pixels] each.

    Attributes:
        triangle: index, −1 for none.
        weights: of the triangle's second and third corner.
        distance: along the ray, to the surface or the end of sight.
    """

    triangle: wp.array[int]
    weights: wp.array[wp.vec2]
    distance: wp.array[float]


@wp.func
def ray_direction(view: View, x: float, y: float):
    """Unit direction through a place in the picture."""
    return wp.normalize(view.first + x * view.across + y * view.down)


@wp.func
def corner_weights(query: wp.MeshQueryRay):
    """Of the first, second and third corner of the triangle that was hit."""
    return wp.vec3(query.u, query.v, 1.0 - query.u - query.v)


@wp.func
def is_hole(looks: Looks, table: TriangleTable, i: int, w: wp.vec3):
    """Whether triangle i has a hole at a place."""
    m = looks.materials[table.material[i]]
    if m.opacity >= 1.0 and m.opacity_texture < 0:
        return False
    uv = wp.vec2(0.0)
    if m.opacity_texture >= 0:
        uv = w[0] * table.uvs[i, 0] + w[1] * table.uvs[i, 1] + w[2] * table.uvs[i, 2]
    return opacity_at(looks, m, uv) <= 0.0


@wp.kernel
def _cast_rays(
    rows: Rows,
    mesh: wp.uint64,
    looks: Looks,
    view: View,
    x: float,
    y: float,
    table: TriangleTable,
    points: SurfacePoints,
    hits: Hits,
):
    """Pixel p's ray through (column + x, row + y): the first triangle it meets that has no hole there, and the point.

    Surfaces are seen from both sides: where the eye is behind, the normal is turned around.
    """
    p = rows.first + wp.tid()
    row = p // view.width
    column = p - row * view.width
    direction = ray_direction(view, float(column) + x, float(row) + y)
    lengthening = 1.0 / wp.max(wp.dot(direction, view.axis), 1.0e-6)
    near = view.near * lengthening
    end = view.far * lengthening
    hits.triangle[p] = -1
    hits.distance[p] = end
    points.positions[p] = view.eye
    points.normals[p] = wp.vec3(0.0)
    points.material[p] = 0
    start = wp.float32(near)
    query = wp.mesh_query_ray(mesh, view.eye + start * direction, direction, end - start)
    holes = wp.int32(0)
    while query.result and holes < _MOST_HOLES:
        if not is_hole(looks, table, query.face, corner_weights(query)):
            break
        start = (start + query.t) * (1.0 + _PAST_A_HOLE)
        query = wp.mesh_query_ray(mesh, view.eye + start * direction, direction, end - start)
        holes += 1
    if query.result:
        i = query.face
        w = corner_weights(query)
        w0 = w[0]
        w1 = w[1]
        w2 = w[2]
        n = wp.normalize(w0 * table.normals[i, 0] + w1 * table.normals[i, 1] + w2 * table.normals[i, 2])
        face = query.normal
        if wp.length(n) < 0.5:
            n = wp.normalize(face)
        turned = 1.0
        if wp.dot(face, direction) > 0.0:
            n = -n
            turned = -1.0
        hits.triangle[p] = i
        hits.weights[p] = wp.vec2(w1, w2)
        hits.distance[p] = start + query.t
        points.positions[p] = wp.mesh_eval_position(mesh, i, query.u, query.v)
        points.normals[p] = n
        points.material[p] = table.material[i]
        if points.uvs.shape[0] > p:
            points.uvs[p] = w0 * table.uvs[i, 0] + w1 * table.uvs[i, 1] + w2 * table.uvs[i, 2]
        if points.tangents.shape[0] > p and table.tangents.shape[0] > i:
            t = w0 * table.tangents[i, 0] + w1 * table.tangents[i, 1] + w2 * table.tangents[i, 2]
            points.tangents[p] = wp.vec4(t[0], t[1], t[2], turned * t[3])


@wp.kernel
def _add_light(
    rows: Rows,
    radiance: wp.array[wp.vec3],
    visibility: wp.array[float],
    transmittance: wp.array2d[float],
    triangle: wp.array[int],
    surface: wp.array[int],
    takes: wp.array[wp.vec3],
    color_inout: wp.array[wp.vec3],
):
    """color[p] += V ⊗ T ⊗ radiance[p] on the surfaces that take the light, its shadows and its smoke's shadows."""
    p = rows.first + wp.tid()
    i = triangle[p]
    if i >= 0:
        take = takes[surface[i]]
        light = take[0] * radiance[p]
        if take[1] > 0.0:
            light *= visibility[p]
        if take[2] > 0.0:
            last = transmittance.shape[0] - 1
            through = wp.vec3(transmittance[0, p], transmittance[wp.min(1, last), p], transmittance[wp.min(2, last), p])
            light = wp.cw_mul(light, through)
        color_inout[p] = color_inout[p] + light


@wp.kernel
def _interpolate(
    rows: Rows, hits: Hits, at_corners: wp.array[wp.vec3], missing: wp.vec3, at_pixels_out: wp.array[wp.vec3]
):
    """Gouraud: at_pixels[p] = (1 − w₁ − w₂) c₀ + w₁ c₁ + w₂ c₂ of the triangle hit, or what stands for none."""
    p = rows.first + wp.tid()
    i = hits.triangle[p]
    value = missing
    if i >= 0:
        w = hits.weights[p]
        value = (1.0 - w[0] - w[1]) * at_corners[3 * i]
        value += w[0] * at_corners[3 * i + 1] + w[1] * at_corners[3 * i + 2]
    at_pixels_out[p] = value


@wp.kernel
def _show_background(rows: Rows, triangle: wp.array[int], background: wp.vec3, color_inout: wp.array[wp.vec3]):
    """color[p] = background where nothing was hit."""
    p = rows.first + wp.tid()
    if triangle[p] < 0:
        color_inout[p] = background


@wp.kernel
def _add_sample(rows: Rows, color: wp.array[wp.vec3], share: float, mean_inout: wp.array[wp.vec3]):
    """mean[p] += share · color[p], without what is not finite."""
    p = rows.first + wp.tid()
    c = color[p]
    if wp.isfinite(c):
        mean_inout[p] = mean_inout[p] + share * c


@wp.kernel
def _encode(rows: Rows, mean: wp.array[wp.vec3], srgb: SrgbTable, codes_out: wp.array2d[wp.uint8]):
    """codes[p] = sRGB(mean[p])."""
    p = rows.first + wp.tid()
    for channel in range(3):
        codes_out[p, channel] = wp.uint8(encode_srgb(srgb, mean[p][channel]))


def cast_rays(launcher: Launcher, count: int, *args) -> None:
    """Casts a ray for each pixel: mesh id, looks, view, place in the pixel (x, y), table, points and hits to fill."""
    launcher.launch_each(_cast_rays, count, *args)


def add_light(launcher: Launcher, count: int, *args) -> None:
    """Adds one light: radiance, visibility, transmittance, triangle, surface, takes, and the colour it adds to."""
    launcher.launch_each(_add_light, count, *args)


def interpolate_corners(launcher: Launcher, count: int, *args) -> None:
    """Brings values at the triangles' corners to the pixels: hits, values, value of a miss, out."""
    launcher.launch_each(_interpolate, count, *args)


def show_background(launcher: Launcher, count: int, *args) -> None:
    """Writes the background where nothing was hit: triangle, background, colour."""
    launcher.launch_each(_show_background, count, *args)


def add_sample(launcher: Launcher, count: int, *args) -> None:
    """Adds a sample to the mean: colour, its share, mean."""
    launcher.launch_each(_add_sample, count, *args)


def encode_picture(launcher: Launcher, count: int, *args) -> None:
    """Writes sRGB codes: mean, table, codes."""
    launcher.launch_each(_encode, count, *args)
