"""Blinn-Phong reflection with Schlick's Fresnel term, one function a formula.

Source: F. Luna, *Introduction to 3D Game Programming with DirectX 12*, chapter 8; R. Schlick, "An Inexpensive BRDF
Model for Physically-based Rendering", 1994. Vectors are unit length and point away from the surface.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


def blinn_phong_exponent(roughness: float) -> float:
    """The exponent m = 256 · shininess, shininess = 1 − roughness."""
    return 256.0 * (1.0 - roughness)


@wp.func
def schlick_fresnel(r0: wp.vec3, h_dot_l: float):
    """R_F = R₀ + (1 − R₀)(1 − h·l)⁵."""
    c = 1.0 - wp.clamp(h_dot_l, 0.0, 1.0)
    c2 = c * c
    return r0 + (wp.vec3(1.0) - r0) * (c2 * c2 * c)


@wp.func
def blinn_phong_lobe(n_dot_h: float, m: float):
    """(m + 8)/8 · (n·h)ᵐ, which nearly keeps the reflected energy the same for every m."""
    return (m + 8.0) / 8.0 * wp.pow(wp.max(n_dot_h, 0.0), m)


@wp.func
def reflect_diffuse(light: wp.vec3, to_light: wp.vec3, normal: wp.vec3, diffuse: wp.vec3):
    """B ⊗ m_d max(l·n, 0): the radiance that a matte surface reflects, B = irradiance/π of the light."""
    return wp.cw_mul(light, diffuse) * wp.max(wp.dot(to_light, normal), 0.0)


@wp.func
def reflect_blinn_phong(
    light: wp.vec3, to_light: wp.vec3, to_eye: wp.vec3, normal: wp.vec3, diffuse: wp.vec3, r0: wp.vec3, m: float
):
    """B ⊗ (m_d + R_F (m + 8)/8 (n·h)ᵐ) max(l·n, 0), with h = (l + v)/|l + v|."""
    h = wp.normalize(to_light + to_eye)
    specular = schlick_fresnel(r0, wp.dot(h, to_light)) * blinn_phong_lobe(wp.dot(normal, h), m)
    return wp.cw_mul(light, diffuse + specular) * wp.max(wp.dot(to_light, normal), 0.0)
