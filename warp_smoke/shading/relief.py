"""Surface relief from textures: normal maps, and parallax from heights.

Sources: T. Kaneko et al., "Detailed Shape Representation with Parallax Mapping", 2001, with the offset limiting of T.
Welsh, 2004 (TyphoonLabs GLSL course): T_n = T_o + (h · s + b) V_xy; N. Tatarchuk, "Practical Parallax Occlusion
Mapping", 2006. Heights are in texture coordinates: a point of the relief is (u, v, z = h · s + b), in a frame whose
axes are tangent, bitangent and normal, and the surface itself is z = 0.
"""

import warp as wp

from warp_smoke.shading.looks import Looks, MaterialLook, sample_number

wp.set_module_options({"enable_backward": False})

_VIEW_STEPS = wp.constant(32)
_LIGHT_STEPS = wp.constant(24)
# Flatter directions are treated as this steep, so that steps stay short enough to hit the relief.
_FLATTEST = wp.constant(0.05)


@wp.struct
class Frame:
    """Tangent, bitangent and normal at a point, orthonormal."""

    t: wp.vec3
    b: wp.vec3
    n: wp.vec3


@wp.func
def tangent_frame(normal: wp.vec3, tangent: wp.vec4):
    """The frame with b = sign · n × t; t and b are zero where there is no tangent."""
    frame = Frame()
    frame.n = normal
    along = wp.vec3(tangent[0], tangent[1], tangent[2])
    frame.t = wp.normalize(along - wp.dot(along, normal) * normal)
    frame.b = wp.sign(tangent[3]) * wp.cross(normal, frame.t)
    return frame


@wp.func
def to_tangent(frame: Frame, v: wp.vec3):
    """A world direction in tangent space."""
    return wp.vec3(wp.dot(v, frame.t), wp.dot(v, frame.b), wp.dot(v, frame.n))


@wp.func
def to_world(frame: Frame, v: wp.vec3):
    """A tangent-space direction in the world."""
    return v[0] * frame.t + v[1] * frame.b + v[2] * frame.n


@wp.func
def mapped_normal(frame: Frame, c: wp.vec3):
    """The unit normal for a normal map's direction; the surface's own where there is no direction or tangent."""
    if wp.length(c) < 1.0e-3 or wp.length(frame.t) < 0.5:
        return frame.n
    n = to_world(frame, c)
    if wp.length(n) < 1.0e-6:
        return frame.n
    return wp.normalize(n)


@wp.func
def relief_height(looks: Looks, m: MaterialLook, uv: wp.vec2):
    """Height z = h · s + b, h within 0…1."""
    h = wp.clamp(sample_number(looks, m.height_texture, uv), 0.0, 1.0)
    return h * m.parallax_scale + m.parallax_bias


@wp.func
def offset_parallax(looks: Looks, m: MaterialLook, uv: wp.vec2, to_eye: wp.vec3):
    """T_n = T_o + (h · s + b) V_xy, with V in tangent space."""
    return uv + relief_height(looks, m, uv) * wp.vec2(to_eye[0], to_eye[1])


@wp.func
def march_relief(looks: Looks, m: MaterialLook, uv: wp.vec2, to_eye: wp.vec3):
    """(u, v, z) where the line of sight through uv first meets the relief, found by equal steps and one secant."""
    slope = wp.vec2(to_eye[0], to_eye[1]) / wp.max(to_eye[2], _FLATTEST)
    top = wp.max(m.parallax_bias, m.parallax_bias + m.parallax_scale)
    step = wp.abs(m.parallax_scale) / float(_VIEW_STEPS)
    above = wp.float32(0.0)
    z = wp.float32(top)
    for k in range(_VIEW_STEPS + 1):
        z_here = top - float(k) * step
        gap = z_here - relief_height(looks, m, uv + z_here * slope)
        if gap <= 0.0:
            z = z_here
            if k > 0:
                z = z_here + step * -gap / wp.max(above - gap, 1.0e-12)
            break
        above = gap
        z = z_here
    at = uv + z * slope
    return wp.vec3(at[0], at[1], z)


@wp.func
def relief_visibility(looks: Looks, m: MaterialLook, place: wp.vec3, to_light: wp.vec3):
    """1 where no relief rises above the ray from (u, v, z) to a light, in tangent space; 0 where some does."""
    if to_light[2] <= 0.0:
        return 0.0
    slope = wp.vec2(to_light[0], to_light[1]) / wp.max(to_light[2], _FLATTEST)
    top = wp.max(m.parallax_bias, m.parallax_bias + m.parallax_scale)
    # Steps of the view's march are no finer than this.
    slack = wp.abs(m.parallax_scale) / float(_VIEW_STEPS)
    uv = wp.vec2(place[0], place[1])
    for k in range(1, _LIGHT_STEPS):
        rise = (top - place[2]) * float(k) / float(_LIGHT_STEPS)
        if relief_height(looks, m, uv + rise * slope) > place[2] + rise + slack:
            return 0.0
    return 1.0
