"""How a light weakens with distance and angle, one function per formula.

Sources: F. Luna, *Introduction to 3D Game Programming with DirectX 12*, chapter 8 (linear falloff, spot power); the
TyphoonLabs GLSL course (polynomial); UsdLux `ShapingAPI` (focus and cone). All results are finite, even at the light.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Floors that only matter within a millionth of a unit of the light, where the formulas have a pole.
_SMALLEST_SQUARE = wp.constant(1.0e-12)
_SMALLEST_WIDTH = wp.constant(1.0e-7)


@wp.func
def attenuate_inverse_square(d: float):
    """1/d²."""
    return 1.0 / wp.max(d * d, _SMALLEST_SQUARE)


@wp.func
def attenuate_linear(d: float, start: float, end: float):
    """saturate((end − d)/(end − start))."""
    return wp.clamp((end - d) / wp.max(end - start, _SMALLEST_WIDTH), 0.0, 1.0)


@wp.func
def attenuate_polynomial(d: float, k: wp.vec3):
    """1/(k₀ + k₁ d + k₂ d²)."""
    return 1.0 / wp.max(k[0] + d * (k[1] + d * k[2]), _SMALLEST_SQUARE)


@wp.func
def shape_focus(cos_angle: float, focus: float):
    """max(cos θ, 0)ᶠ, and 1 for f = 0."""
    if focus == 0.0:
        return 1.0
    return wp.pow(wp.max(cos_angle, 0.0), focus)


@wp.func
def shape_cone(angle: float, inner: float, outer: float):
    """1 − smoothstep(inner, outer, θ): 1 up to the inner angle, 0 from the outer one on; lit at θ = inner = outer."""
    t = wp.clamp((angle - inner) / wp.max(outer - inner, _SMALLEST_WIDTH), 0.0, 1.0)
    return 1.0 - t * t * (3.0 - 2.0 * t)
