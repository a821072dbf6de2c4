"""Blinn-Phong reflection with Schlick's Fresnel term and its variants, one function per formula.

Source: F. Luna, *Introduction to 3D Game Programming with DirectX 12*, chapter 8; R. Schlick, "An Inexpensive BRDF
Model for Physically-based Rendering", 1994. Vectors are unit length and point away from the surface.
"""

import warp as wp

from warp_smoke.material import REFLECTIONS

wp.set_module_options({"enable_backward": False})

_LDR, _CONSERVING, _CLASSIC = (wp.constant(REFLECTIONS.index(name)) for name in REFLECTIONS[1:])


@wp.func
def blinn_phong_exponent(roughness: float):
    """The exponent m = 256 · shininess, shininess = 1 − roughness."""
    return 256.0 * (1.0 - wp.clamp(roughness, 0.0, 1.0))


@wp.func
def schlick_fresnel(r0: wp.vec3, h_dot_l: float):
    """R_F = R₀ + (1 − R₀)(1 − h·l)⁵."""
    c = 1.0 - wp.clamp(h_dot_l, 0.0, 1.0)
    c2 = c * c
    return r0 + (wp.vec3(1.0) - r0) * (c2 * c2 * c)


@wp.func
def power_lobe(n_dot_h: float, m: float):
    """(n·h)ᵐ."""
    return wp.pow(wp.max(n_dot_h, 0.0), m)


@wp.func
def blinn_phong_lobe(n_dot_h: float, m: float):
    """(m + 8)/8 · (n·h)ᵐ, which nearly keeps the reflected energy the same for every m.

    At normal incidence it reflects (m + 8)(m + 2^(−m/2)) / ((m + 2)(m + 4)) of the light.
    """
    return (m + 8.0) / 8.0 * power_lobe(n_dot_h, m)


@wp.func
def conserving_lobe(n_dot_h: float, m: float):
    """(m + 2)(m + 4) / (8 (m + 2^(−m/2))) · (n·h)ᵐ, which reflects all light of normal incidence, for every m."""
    return (m + 2.0) * (m + 4.0) / (8.0 * (m + wp.pow(2.0, -0.5 * m))) * power_lobe(n_dot_h, m)


@wp.func
def compress_highlight(specular: wp.vec3):
    """s/(s + 1), which keeps highlights within 0…1 (LDR)."""
    return wp.cw_div(specular, specular + wp.vec3(1.0))


@wp.func
def reflect_diffuse(light: wp.vec3, to_light: wp.vec3, normal: wp.vec3, diffuse: wp.vec3):
    """B ⊗ m_d max(l·n, 0): the radiance that a matte surface reflects, B = irradiance/π of the light."""
    return wp.cw_mul(light, diffuse) * wp.max(wp.dot(to_light, normal), 0.0)


@wp.func
def reflect(
    light: wp.vec3,
    to_light: wp.vec3,
    to_eye: wp.vec3,
    normal: wp.vec3,
    diffuse: wp.vec3,
    r0: wp.vec3,
    gloss: wp.vec2,
    model: int,
):
    """B ⊗ (m_d + g f) max(l·n, 0), with h = (l + v)/|l + v|, gloss = (g, m) and f of the model.

    blinnPhong f = R_F (m + 8)/8 (n·h)ᵐ; blinnPhongLdr f/(f + 1) of that; energyConserving R_F times the exact lobe, and
    (1 − R_F) m_d; classic R₀ (n·h)ᵐ.
    """
    h = wp.normalize(to_light + to_eye)
    n_dot_h = wp.dot(normal, h)
    fresnel = schlick_fresnel(r0, wp.dot(h, to_light))
    base = diffuse
    specular = fresnel * blinn_phong_lobe(n_dot_h, gloss[1])
    if model == _LDR:
        specular = compress_highlight(specular)
    elif model == _CONSERVING:
        base = wp.cw_mul(diffuse, wp.vec3(1.0) - fresnel)
        specular = fresnel * conserving_lobe(n_dot_h, gloss[1])
    elif model == _CLASSIC:
        specular = r0 * power_lobe(n_dot_h, gloss[1])
    return wp.cw_mul(light, base + gloss[0] * specular) * wp.max(wp.dot(to_light, normal), 0.0)
