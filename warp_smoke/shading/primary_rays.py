"""Rays from the camera to the surfaces that they hit, and the picture composed from the light of these surfaces."""

import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.shading.looks import Looks, opacity_at
from warp_smoke.shading.shadow_terminator import Facet, lifted_point
from warp_smoke.shading.srgb import SrgbTable, encode_srgb
from warp_smoke.shading.surface_points import SurfacePoints
from warp_smoke.shading.triangle_table import TriangleTable
from warp_smoke.shading.view import View, pixel_ray

wp.set_module_options({"enable_backward": False})

# The most holes that a ray passes, and how far beyond a hole or a see-through surface it continues, as a share of its
# length.
_MOST_HOLES = wp.constant(64)
_ONWARD = wp.constant(1.0e-5)


@wp.struct
class Hits:
    """Where the rays of a picture end, [pixels] each.

    Attributes:
        triangle: index, −1 for none.
        weights: of the triangle's second and third corner.
        distance: along the ray, to the surface or the far distance.
        opacity: share of the light from behind that the surface hides; one element where no material is see-through.
    """

    triangle: wp.array[int]
    weights: wp.array[wp.vec2]
    distance: wp.array[float]
    opacity: wp.array[float]


def allocate_hits(launcher: Launcher, count: int, is_blended: bool) -> Hits:
    """Allocates the hits of `count` rays."""
    hits = Hits()
    hits.triangle = launcher.zeros(count, "picture", dtype=int)
    hits.weights = launcher.zeros(count, "picture", dtype=wp.vec2)
    hits.distance = launcher.zeros(count, "picture")
    hits.opacity = launcher.zeros(count if is_blended else 1, "picture")
    return hits


@wp.func
def corner_weights(query: wp.MeshQueryRay):
    """Weights of the first, second and third corner of the triangle that was hit."""
    return wp.vec3(query.u, query.v, 1.0 - query.u - query.v)


@wp.func
def hit_opacity(looks: Looks, table: TriangleTable, i: int, w: wp.vec3):
    """Opacity of triangle i at the point with corner weights w."""
    m = looks.materials[table.material[i]]
    if m.opacity >= 1.0 and m.opacity_texture < 0:
        return 1.0
    uv = wp.vec2(0.0)
    if m.opacity_texture >= 0:
        uv = w[0] * table.uvs[i, 0] + w[1] * table.uvs[i, 1] + w[2] * table.uvs[i, 2]
    return opacity_at(looks, m, uv)


@wp.func
def turned_facet(mesh: wp.uint64, table: TriangleTable, i: int, turned: float):
    """Triangle i with its normals times `turned`, 1 or −1."""
    return Facet(
        wp.mesh_get_point(mesh, 3 * i),
        wp.mesh_get_point(mesh, 3 * i + 1),
        wp.mesh_get_point(mesh, 3 * i + 2),
        turned * table.normals[i, 0],
        turned * table.normals[i, 1],
        turned * table.normals[i, 2],
    )


@wp.func
def _first_hit(
    mesh: wp.uint64, looks: Looks, table: TriangleTable, eye: wp.vec3, direction: wp.vec3, start: float, end: float
):
    """The first hit of a ray from the eye between two distances that is not a hole; its distance and opacity."""
    begin = start
    opacity = wp.float32(0.0)
    query = wp.mesh_query_ray(mesh, eye + begin * direction, direction, end - begin)
    holes = wp.int32(0)
    while query.result and holes < _MOST_HOLES:
        opacity = hit_opacity(looks, table, query.face, corner_weights(query))
        if opacity > 0.0:
            break
        begin = (begin + query.t) * (1.0 + _ONWARD)
        query = wp.mesh_query_ray(mesh, eye + begin * direction, direction, end - begin)
        holes += 1
    return query, begin + query.t, opacity


@wp.kernel
def _cast_rays(
    rows: Rows,
    mesh: wp.uint64,
    looks: Looks,
    view: View,
    x: float,
    y: float,
    table: TriangleTable,
    passed: wp.array[float],
    points_out: SurfacePoints,
    hits_out: Hits,
):
    """Pixel p's ray through (column + x, row + y): the first triangle it hits that has no hole there, and the point.

    It starts at the near distance, or beyond the distance passed[p]; none is cast where that is negative. Surfaces are
    seen from both sides: where the eye is behind, the normal is flipped.
    """
    p = rows.first + wp.tid()
    direction = pixel_ray(view, p, x, y)
    lengthening = 1.0 / wp.max(wp.dot(direction, view.axis), 1.0e-6)
    end = view.far * lengthening
    hits_out.triangle[p] = -1
    hits_out.distance[p] = end
    points_out.positions[p] = view.eye
    points_out.normals[p] = wp.vec3(0.0)
    points_out.material[p] = 0
    if passed[p] < 0.0:
        hits_out.distance[p] = 0.0
        return
    start = wp.max(view.near * lengthening, passed[p] * (1.0 + _ONWARD))
    query, distance, opacity = _first_hit(mesh, looks, table, view.eye, direction, start, end)
    if query.result:
        i = query.face
        w = corner_weights(query)
        n = wp.normalize(w[0] * table.normals[i, 0] + w[1] * table.normals[i, 1] + w[2] * table.normals[i, 2])
        face = query.normal
        if wp.length(n) < 0.5:
            n = wp.normalize(face)
        turned = 1.0
        if wp.dot(face, direction) > 0.0:
            n = -n
            turned = -1.0
        hits_out.triangle[p] = i
        hits_out.weights[p] = wp.vec2(w[1], w[2])
        hits_out.distance[p] = distance
        if hits_out.opacity.shape[0] > p:
            hits_out.opacity[p] = opacity
        position = wp.mesh_eval_position(mesh, i, query.u, query.v)
        points_out.positions[p] = position
        points_out.shadow_points[p] = lifted_point(turned_facet(mesh, table, i, turned), position, w)
        points_out.normals[p] = n
        points_out.material[p] = table.material[i]
        if points_out.uvs.shape[0] > p:
            points_out.uvs[p] = w[0] * table.uvs[i, 0] + w[1] * table.uvs[i, 1] + w[2] * table.uvs[i, 2]
        if points_out.tangents.shape[0] > p and table.tangents.shape[0] > i:
            t = w[0] * table.tangents[i, 0] + w[1] * table.tangents[i, 1] + w[2] * table.tangents[i, 2]
            points_out.tangents[p] = wp.vec4(t[0], t[1], t[2], turned * t[3])


@wp.kernel
def _pass_surfaces(rows: Rows, hits: Hits, passed_out: wp.array[float]):
    """passed[p] = distance of a see-through surface; −1 where the ray ends."""
    p = rows.first + wp.tid()
    passes = hits.triangle[p] >= 0 and hits.opacity[p] < 1.0
    passed_out[p] = wp.where(passes, hits.distance[p], -1.0)


@wp.kernel
def _blend_behind(
    rows: Rows, hits: Hits, passed: wp.array[float], behind: wp.array[wp.vec3], color_inout: wp.array[wp.vec3]
):
    """color[p] = α color[p] + (1 − α) behind[p] where the ray passes."""
    p = rows.first + wp.tid()
    if passed[p] >= 0.0:
        color_inout[p] = hits.opacity[p] * color_inout[p] + (1.0 - hits.opacity[p]) * behind[p]


@wp.kernel
def _receive_light(
    rows: Rows,
    triangle: wp.array[int],
    surface: wp.array[int],
    takes: wp.array[wp.vec3],
    visibility_inout: wp.array[float],
):
    """visibility[p] = 1 on surfaces that take no shadows of surfaces, 0 on those that do not take the light."""
    p = rows.first + wp.tid()
    i = triangle[p]
    if i >= 0:
        take = takes[surface[i]]
        seen = wp.where(take[1] > 0.0, visibility_inout[p], 1.0)
        visibility_inout[p] = take[0] * seen


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
    """color[p] += V T ⊗ radiance[p] on surfaces, without T on those that take no shadows of smoke."""
    p = rows.first + wp.tid()
    i = triangle[p]
    if i >= 0:
        light = visibility[p] * radiance[p]
        if takes[surface[i]][2] > 0.0:
            last = transmittance.shape[0] - 1
            through = wp.vec3(transmittance[0, p], transmittance[wp.min(1, last), p], transmittance[wp.min(2, last), p])
            light = wp.cw_mul(light, through)
        color_inout[p] = color_inout[p] + light


@wp.kernel
def _interpolate(
    rows: Rows, hits: Hits, at_corners: wp.array[wp.vec3], missing: wp.vec3, at_pixels_out: wp.array[wp.vec3]
):
    """Gouraud: at_pixels[p] = (1 − w₁ − w₂) c₀ + w₁ c₁ + w₂ c₂ of the triangle hit, or `missing` for none."""
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
    """mean[p] += share · color[p] where that is finite."""
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


def cast_rays(
    launcher: Launcher,
    count: int,
    mesh: wp.Mesh,
    looks: Looks,
    view: View,
    place: tuple[float, float],
    table: TriangleTable,
    passed: wp.array,
    points_out: SurfacePoints,
    hits_out: Hits,
) -> None:
    """Casts a ray for each pixel.

    Args:
        launcher: where to compute.
        count: number of pixels n.
        mesh: the triangles in set space.
        looks: their materials.
        view: the camera.
        place: of the ray in the pixel, (x, y).
        table: what is interpolated over the triangles.
        passed: distance beyond which each ray begins, negative for no ray, [n].
        points_out: the points that the rays hit.
        hits_out: the hits.
    """
    args = (mesh.id, looks, view, *place, table, passed, points_out, hits_out)
    launcher.launch_each(_cast_rays, count, *args)


def pass_surfaces(launcher: Launcher, count: int, hits: Hits, passed_out: wp.array) -> None:
    """Writes the distance of the hit for rays that continue behind it, −1 for the others, [n]."""
    launcher.launch_each(_pass_surfaces, count, hits, passed_out)


def blend_behind(
    launcher: Launcher, count: int, hits: Hits, passed: wp.array, behind: wp.array, color_inout: wp.array
) -> None:
    """Blends what rays see behind see-through surfaces, [n] vec3, into the surfaces' colour, [n] vec3."""
    launcher.launch_each(_blend_behind, count, hits, passed, behind, color_inout)


def receive_light(
    launcher: Launcher, count: int, hits: Hits, table: TriangleTable, takes: wp.array, visibility_inout: wp.array
) -> None:
    """Lets surfaces ignore a light or its surface shadows in visibility [n]; `takes` as in `PictureLight`."""
    launcher.launch_each(_receive_light, count, hits.triangle, table.surface, takes, visibility_inout)


def add_light(
    launcher: Launcher,
    count: int,
    radiance: wp.array,
    visibility: wp.array,
    transmittance: wp.array,
    hits: Hits,
    table: TriangleTable,
    takes: wp.array,
    color_inout: wp.array,
) -> None:
    """Adds one light.

    Args:
        launcher: where to compute.
        count: number of pixels n.
        radiance: of the light without shadows, linear RGB [n] vec3.
        visibility: share that passes surfaces, [n].
        transmittance: share that passes smoke, [1 or 3, n].
        hits: what the pixels show.
        table: of the triangles.
        takes: which shadows count on each surface, as in `PictureLight`.
        color_inout: the sum, [n] vec3.
    """
    args = (radiance, visibility, transmittance, hits.triangle, table.surface, takes, color_inout)
    launcher.launch_each(_add_light, count, *args)


def interpolate_corners(
    launcher: Launcher, count: int, hits: Hits, at_corners: wp.array, missing: wp.vec3, at_pixels_out: wp.array
) -> None:
    """Interpolates values at triangle corners, [3 m] vec3, to the pixels, [n] vec3; `missing` where nothing was hit."""
    launcher.launch_each(_interpolate, count, hits, at_corners, missing, at_pixels_out)


def show_background(launcher: Launcher, count: int, hits: Hits, background: wp.vec3, color_inout: wp.array) -> None:
    """Writes the background where nothing was hit."""
    launcher.launch_each(_show_background, count, hits.triangle, background, color_inout)


def add_sample(launcher: Launcher, count: int, color: wp.array, share: float, mean_inout: wp.array) -> None:
    """Adds a share of a sample's colours [n] to their mean."""
    launcher.launch_each(_add_sample, count, color, share, mean_inout)


def encode_picture(launcher: Launcher, count: int, mean: wp.array, srgb: SrgbTable, codes_out: wp.array) -> None:
    """Writes the sRGB codes of linear colours, [n, 3] uint8."""
    launcher.launch_each(_encode, count, mean, srgb, codes_out)
