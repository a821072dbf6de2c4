"""Points of surfaces ready to be lit: parallax first, then normal, base colour and gloss at the shifted coordinates."""

import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.material import GLOSS_ROLES, PARALLAXES, REFLECTIONS
from warp_smoke.shading.blinn_phong import blinn_phong_exponent
from warp_smoke.shading.looks import Looks, MaterialLook, sample_number, sample_texture
from warp_smoke.shading.relief import mapped_normal, march_relief, offset_parallax, tangent_frame, to_tangent

wp.set_module_options({"enable_backward": False})

_FACTOR = wp.constant(GLOSS_ROLES.index("factor"))
_CLASSIC = wp.constant(REFLECTIONS.index("classic"))
_OFFSET, _OCCLUSION = (wp.constant(PARALLAXES.index(name)) for name in ("offset", "occlusion"))
_CLASSIC_EXPONENT = wp.constant(64.0)


@wp.struct
class SurfacePoints:
    """Points on surfaces in set space, [n] each.

    Attributes:
        positions, normals: with unit surface normals.
        tangents: and signs (see `tangents`); one element where no material needs any.
        uvs: texture coordinates; one element where no material has a picture.
        material: index into `Looks.materials`.
    """

    positions: wp.array[wp.vec3]
    normals: wp.array[wp.vec3]
    tangents: wp.array[wp.vec4]
    uvs: wp.array[wp.vec2]
    material: wp.array[int]


@wp.struct
class SurfaceDetail:
    """What the pictures say at each point, [n] each.

    Attributes:
        normals: unit normals that light is reflected by.
        diffuse: linear RGB.
        gloss: factor on highlights, and their exponent.
        relief: (u, v, z) on the relief; one element where no material is marched.
    """

    normals: wp.array[wp.vec3]
    diffuse: wp.array[wp.vec3]
    gloss: wp.array[wp.vec2]
    relief: wp.array[wp.vec3]


def allocate_detail(launcher: Launcher, count: int, label: str, marched: int) -> SurfaceDetail:
    """Room for `count` points, `marched` of which may lie on a relief (all or none)."""
    detail = SurfaceDetail()
    detail.normals = launcher.zeros(count, label, dtype=wp.vec3)
    detail.diffuse = launcher.zeros(count, label, dtype=wp.vec3)
    detail.gloss = launcher.zeros(count, label, dtype=wp.vec2)
    detail.relief = launcher.zeros(max(marched, 1), label, dtype=wp.vec3)
    return detail


def look_up_detail(
    launcher: Launcher, count: int, looks: Looks, points: SurfacePoints, eye: wp.vec4, detail: SurfaceDetail
) -> None:
    """Fills the detail of each point.

    Args:
        launcher: where to compute.
        count: number of points.
        looks: their materials.
        points: the points.
        eye: position in set space and 1, or zeros, by which there is no parallax.
        detail: what is filled.
    """
    args = (looks, points, eye, detail.normals, detail.diffuse, detail.gloss, detail.relief)
    launcher.launch_each(_look_up_detail, count, *args)


@wp.func
def gloss_of(looks: Looks, m: MaterialLook, uv: wp.vec2):
    """Factor on highlights, and their exponent."""
    factor = wp.float32(1.0)
    exponent = blinn_phong_exponent(m.roughness)
    if m.roughness_texture >= 0:
        roughness = wp.clamp(sample_number(looks, m.roughness_texture, uv), 0.0, 1.0)
        if m.gloss == _FACTOR:
            factor = 1.0 - roughness
        else:
            exponent = blinn_phong_exponent(roughness)
    if m.reflection == _CLASSIC:
        exponent = _CLASSIC_EXPONENT
    return wp.vec2(factor, exponent)


@wp.kernel
def _look_up_detail(
    rows: Rows,
    looks: Looks,
    points: SurfacePoints,
    eye: wp.vec4,
    normals_out: wp.array[wp.vec3],
    diffuse_out: wp.array[wp.vec3],
    gloss_out: wp.array[wp.vec2],
    relief_out: wp.array[wp.vec3],
):
    """First uv ← parallax(uv), then n, m_d and gloss at uv."""
    s = rows.first + wp.tid()
    m = looks.materials[points.material[s]]
    n = points.normals[s]
    uv = wp.vec2(0.0, 0.0)
    if m.diffuse_texture >= 0 or m.normal_texture >= 0 or m.height_texture >= 0 or m.roughness_texture >= 0:
        uv = points.uvs[s]
    if m.normal_texture >= 0 or m.parallax <= _OCCLUSION:
        frame = tangent_frame(n, points.tangents[s])
        if eye[3] > 0.0 and m.parallax <= _OCCLUSION and wp.length(frame.t) > 0.5:
            to_eye = to_tangent(frame, wp.normalize(wp.vec3(eye[0], eye[1], eye[2]) - points.positions[s]))
            if m.parallax == _OFFSET:
                uv = offset_parallax(looks, m, uv, to_eye)
            else:
                place = march_relief(looks, m, uv, to_eye)
                uv = wp.vec2(place[0], place[1])
                relief_out[s] = place
        if m.normal_texture >= 0:
            c = sample_texture(looks, m.normal_texture, uv)
            n = mapped_normal(frame, wp.vec3(c[0], c[1], c[2]))
    normals_out[s] = n
    diffuse = m.diffuse
    if m.diffuse_texture >= 0:
        rgba = sample_texture(looks, m.diffuse_texture, uv)
        diffuse = wp.vec3(wp.max(rgba[0], 0.0), wp.max(rgba[1], 0.0), wp.max(rgba[2], 0.0))
    diffuse_out[s] = diffuse
    gloss_out[s] = gloss_of(looks, m, uv)
