"""Depth bias: how far behind a stored depth a point must lie to be in shadow.

The stored depth belongs to the ray through a texel's centre, and the point lies beside that ray. On a plane whose
normal is at angle θ to the light, at lateral distance e from the ray, the two depths differ by e tan θ. With e half a
texel's diagonal this is the least bias that is free of acne (`auto`).
"""

import numpy as np
import warp as wp

from warp_smoke.scene import Light

wp.set_module_options({"enable_backward": False})

# Least cosine of a facet that the bias uses, as a share of the smooth surface's.
_LEAST_COSINE = wp.constant(0.25)


@wp.struct
class Bias:
    """Bias = max(constant, slope (1 − cos θ)) + a term in `spread` tan θ (see `point_map` and `directional_map`).

    Attributes:
        constant, slope: [stage units].
        spread: half a texel's diagonal: tangent of its angle at a point light, [stage units] for a distant one.
    """

    constant: float
    slope: float
    spread: float


def round_off(extent: float) -> float:
    """Returns the combined float32 rounding error of depths, points and ray hits, for coordinates up to `extent`."""
    # Planes at all angles needed 2 units in the last place; this is four times as much.
    return 8 * float(np.finfo(np.float32).eps) * extent


def light_bias(light: Light, spread: float, extent: float) -> Bias:
    """Returns a light's own bias where it has one, else the least that is free of acne.

    Args:
        light: its `shadow_bias` alone is a constant; with `shadow_slope_bias` it is the floor under the slope term.
        spread: half a texel's diagonal, as in `Bias`.
        extent: largest coordinate or distance involved [stage units].
    """
    bias = Bias()
    if light.shadow_bias is None and light.shadow_slope_bias is None:
        # Where front faces are culled, faces turned to the light are not in the map: they cannot shadow themselves.
        spread = 0.0 if light.shadow_cull_front else spread
        bias.constant, bias.slope, bias.spread = round_off(extent), 0.0, spread
    else:
        bias.constant, bias.slope, bias.spread = light.shadow_bias or 0.0, light.shadow_slope_bias or 0.0, 0.0
    return bias


@wp.func
def plane_normal(normal: wp.vec3, facet: wp.vec3, ray: wp.vec3):
    """The normal of the plane that a point's neighbours lie on, for light along a ray that the point's normal faces.

    It is the facet's; but where the facet turns away from the light and the smooth surface does not, tan θ would be
    unbounded: it is bent towards the point's normal until its cosine is a fixed share of that normal's.
    """
    least = _LEAST_COSINE * wp.dot(normal, ray)
    facing = wp.dot(facet, ray)
    bent = facet
    if facing > least:
        bent = wp.normalize(wp.lerp(facet, normal, (least - facing) / (wp.dot(normal, ray) - facing)))
    return bent


@wp.func
def fixed_bias(bias: Bias, cosine: float):
    """max(constant, slope (1 − cos θ))."""
    return wp.max(bias.constant, bias.slope * (1.0 - cosine))


@wp.func
def tangent(cosine: float):
    """The tangent of θ from cos θ > 0, at most 1e6."""
    return wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0)) / wp.max(cosine, 1.0e-6)
