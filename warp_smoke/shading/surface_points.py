"""Surface points ready to be lit: parallax first, then normal, base colour and gloss at the shifted coordinates."""

from collections.abc import Sequence

import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.material import GLOSS_ROLES, PARALLAXES, REFLECTIONS, Material
from warp_smoke.shading.blinn_phong import blinn_phong_exponent
from warp_smoke.shading.looks import Looks, MaterialLook, color_at, opacity_at, sample_texture, share_of
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
        positions, normals: positions, and unit surface normals.
        shadow_points: where shadows of surfaces are looked up (see `shadow_terminator`); unset where none are.
        tangents: tangents and signs (see `tangents`); one element where no material needs any.
        uvs: texture coordinates; one element where no material has a picture.
        material: index into `Looks.materials`.
    """

    positions: wp.array[wp.vec3]
    normals: wp.array[wp.vec3]
    shadow_points: wp.array[wp.vec3]
    tangents: wp.array[wp.vec4]
    uvs: wp.array[wp.vec2]
    material: wp.array[int]


def allocate_points(launcher: Launcher, count: int, label: str, needs_tangents: bool) -> SurfacePoints:
    """Allocates `count` points with texture coordinates."""
    points = SurfacePoints()
    points.positions = launcher.zeros(count, label, dtype=wp.vec3)
    points.normals = launcher.zeros(count, label, dtype=wp.vec3)
    points.tangents = launcher.zeros(count if needs_tangents else 1, label, dtype=wp.vec4)
    points.uvs = launcher.zeros(count, label, dtype=wp.vec2)
    points.material = launcher.zeros(count, label, dtype=int)
    return points


@wp.struct
class SurfaceDetail:
    """What the materials and their pictures give at each point, [n] each.

    Attributes:
        normals: unit shading normals.
        diffuse: diffuse albedo, without metal, linear RGB.
        r0: reflectance at normal incidence, linear RGB.
        gloss: factor on highlights, and their exponent.
        unlit: light without any of the lights: emission and reflected ambient light, linear RGB.
        relief: (u, v, z) on the relief; one element where no material is marched.
        opacity: one element where no material is see-through.
    """

    normals: wp.array[wp.vec3]
    diffuse: wp.array[wp.vec3]
    r0: wp.array[wp.vec3]
    gloss: wp.array[wp.vec2]
    unlit: wp.array[wp.vec3]
    relief: wp.array[wp.vec3]
    opacity: wp.array[float]


def allocate_detail(launcher: Launcher, count: int, label: str, materials: Sequence[Material]) -> SurfaceDetail:
    """Allocates the detail of `count` points of some materials."""
    detail = SurfaceDetail()
    for name in ("normals", "diffuse", "r0", "unlit"):
        setattr(detail, name, launcher.zeros(count, label, dtype=wp.vec3))
    detail.gloss = launcher.zeros(count, label, dtype=wp.vec2)
    marched = any(material.is_marched for material in materials)
    detail.relief = launcher.zeros(count if marched else 1, label, dtype=wp.vec3)
    see_through = any(material.is_see_through for material in materials)
    detail.opacity = launcher.zeros(count if see_through else 1, label)
    return detail


def look_up_detail(
    launcher: Launcher,
    count: int,
    looks: Looks,
    points: SurfacePoints,
    eye: wp.vec4,
    ambient: wp.vec3,
    detail: SurfaceDetail,
) -> None:
    """Fills the detail of each point.

    Args:
        launcher: where to compute.
        count: number of points.
        looks: their materials.
        points: the points.
        eye: position in set space and 1, or zeros for no parallax.
        ambient: light from everywhere, linear RGB.
        detail: the detail to fill.
    """
    launcher.launch_each(_look_up_detail, count, looks, points, eye, ambient, detail)


@wp.func
def gloss_of(looks: Looks, m: MaterialLook, uv: wp.vec2):
    """Factor on highlights, and their exponent."""
    factor = wp.float32(1.0)
    exponent = blinn_phong_exponent(m.roughness)
    if m.roughness_texture >= 0:
        roughness = share_of(looks, m.roughness_texture, uv, m.roughness)
        if m.gloss == _FACTOR:
            factor = 1.0 - roughness
        else:
            exponent = blinn_phong_exponent(roughness)
    if m.reflection == _CLASSIC:
        exponent = _CLASSIC_EXPONENT
    return wp.vec2(factor, exponent)


@wp.func
def has_pictures(m: MaterialLook):
    """Whether anything of a material is looked up at texture coordinates."""
    colors = m.diffuse_texture >= 0 or m.specular_texture >= 0 or m.emissive_texture >= 0
    relief = m.normal_texture >= 0 or m.height_texture >= 0
    numbers = m.roughness_texture >= 0 or m.metallic_texture >= 0 or m.occlusion_texture >= 0 or m.opacity_texture >= 0
    return colors or relief or numbers


@wp.kernel
def _look_up_detail(
    rows: Rows, looks: Looks, points: SurfacePoints, eye: wp.vec4, ambient: wp.vec3, detail_out: SurfaceDetail
):
    """First uv ← parallax(uv), then everything else at uv; c is the base colour and k the share of metal.

    m_d = (1 − k) c, r₀ = (1 − k) r₀ + k c, unlit = emissive + occlusion · ambient ⊗ c: metal is a mirror, in which a
    light from everywhere looks the same all around.
    """
    s = rows.first + wp.tid()
    m = looks.materials[points.material[s]]
    n = points.normals[s]
    uv = wp.vec2(0.0, 0.0)
    if has_pictures(m):
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
                detail_out.relief[s] = place
        if m.normal_texture >= 0:
            c = sample_texture(looks, m.normal_texture, uv)
            n = mapped_normal(frame, wp.vec3(c[0], c[1], c[2]))
    detail_out.normals[s] = n
    base = color_at(looks, m.diffuse_texture, uv, m.diffuse)
    metal = share_of(looks, m.metallic_texture, uv, m.metallic)
    detail_out.diffuse[s] = (1.0 - metal) * base
    detail_out.r0[s] = (1.0 - metal) * color_at(looks, m.specular_texture, uv, m.r0) + metal * base
    detail_out.gloss[s] = gloss_of(looks, m, uv)
    occlusion = share_of(looks, m.occlusion_texture, uv, m.occlusion)
    emissive = color_at(looks, m.emissive_texture, uv, m.emissive)
    detail_out.unlit[s] = emissive + occlusion * wp.cw_mul(ambient, base)
    if detail_out.opacity.shape[0] > s:
        detail_out.opacity[s] = opacity_at(looks, m, uv)
