"""Unshadowed light of one source that surface points reflect to the eye, for both bakes and pictures."""

import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.material import PARALLAXES
from warp_smoke.shading.blinn_phong import reflect, reflect_diffuse
from warp_smoke.shading.light_source import LightSource, incident_light
from warp_smoke.shading.looks import Looks
from warp_smoke.shading.relief import relief_visibility, tangent_frame, to_tangent
from warp_smoke.shading.surface_points import SurfaceDetail, SurfacePoints

wp.set_module_options({"enable_backward": False})

_LUMINANCE = wp.constant(wp.vec3(0.2126, 0.7152, 0.0722))  # of linear Rec. 709 RGB
_OCCLUSION = wp.constant(PARALLAXES.index("occlusion"))


def shade_light(
    launcher: Launcher,
    count: int,
    light: LightSource,
    looks: Looks,
    points: SurfacePoints,
    detail: SurfaceDetail,
    eye: wp.vec4,
    radiance_out: wp.array,
    reached: wp.array | None = None,
) -> None:
    """Writes the radiance that each point sends to the eye, linear RGB [n] vec3.

    Args:
        launcher: where to compute.
        count: number of points.
        light: the source.
        looks: materials.
        points: the points that are lit.
        detail: their material detail, as filled by `look_up_detail`.
        eye: position in set space and 1, or zeros for no highlights.
        radiance_out: [n] vec3.
        reached: 0 at points that the light does not reach, where radiance is set to 0, [n]; None = it reaches all.
    """
    launcher.launch_each(_shade_light, count, light, looks, points, detail, eye, reached, radiance_out)


def shade_irradiance(
    launcher: Launcher, count: int, light: LightSource, points: SurfacePoints, detail: SurfaceDetail, out: wp.array
) -> None:
    """Writes the radiance of a white matte surface at each point, linear RGB [n] vec3: irradiance/π."""
    launcher.launch_each(_shade_irradiance, count, light, points, detail, out)


def weigh_light(
    launcher: Launcher, count: int, light: LightSource, points: SurfacePoints, detail: SurfaceDetail, out: wp.array
) -> None:
    """Writes the luminance of the light that arrives at each point, [n]."""
    launcher.launch_each(_weigh_light, count, light, points, detail, out)


@wp.func
def is_unreached(reached: wp.array[float], s: int):
    """Whether a light is known not to reach point s."""
    if reached.shape[0] <= s:
        return False
    return reached[s] == 0.0


@wp.kernel
def _shade_light(
    rows: Rows,
    light: LightSource,
    looks: Looks,
    points: SurfacePoints,
    detail: SurfaceDetail,
    eye: wp.vec4,
    reached: wp.array[float],
    radiance_out: wp.array[wp.vec3],
):
    """radiance[s] = V_relief B ⊗ (m_d + g f) max(l·n, 0), or B ⊗ m_d max(l·n, 0) without an eye."""
    s = rows.first + wp.tid()
    radiance_out[s] = wp.vec3(0.0)
    if is_unreached(reached, s):
        return
    p = points.positions[s]
    to_light, b = incident_light(light, p)
    n = detail.normals[s]
    # A bump receives no light from behind the surface.
    if wp.max(b) > 0.0 and wp.dot(to_light, n) > 0.0 and wp.dot(to_light, points.normals[s]) > 0.0:
        radiance = wp.vec3(0.0)
        m = looks.materials[points.material[s]]
        if eye[3] > 0.0:
            to_eye = wp.normalize(wp.vec3(eye[0], eye[1], eye[2]) - p)
            radiance = reflect(b, to_light, to_eye, n, detail.diffuse[s], detail.r0[s], detail.gloss[s], m.reflection)
            if m.parallax == _OCCLUSION:
                frame = tangent_frame(points.normals[s], points.tangents[s])
                if wp.length(frame.t) > 0.5:
                    radiance *= relief_visibility(looks, m, detail.relief[s], to_tangent(frame, to_light))
        else:
            radiance = reflect_diffuse(b, to_light, n, detail.diffuse[s])
        radiance_out[s] = radiance


@wp.kernel
def _shade_irradiance(
    rows: Rows, light: LightSource, points: SurfacePoints, detail: SurfaceDetail, irradiance_out: wp.array[wp.vec3]
):
    """irradiance[s] = B max(l·n, 0)."""
    s = rows.first + wp.tid()
    to_light, b = incident_light(light, points.positions[s])
    facing = wp.where(wp.dot(to_light, points.normals[s]) > 0.0, wp.dot(to_light, detail.normals[s]), 0.0)
    irradiance_out[s] = b * wp.max(facing, 0.0)


@wp.kernel
def _weigh_light(
    rows: Rows, light: LightSource, points: SurfacePoints, detail: SurfaceDetail, weights_out: wp.array[float]
):
    """weights[s] = Y(B) max(l·n, 0)."""
    s = rows.first + wp.tid()
    to_light, b = incident_light(light, points.positions[s])
    facing = wp.where(wp.dot(to_light, points.normals[s]) > 0.0, wp.dot(to_light, detail.normals[s]), 0.0)
    weights_out[s] = wp.dot(b, _LUMINANCE) * wp.max(facing, 0.0)
