"""The light that reaches a point: radiometry of UsdLux lights, in the form that the shading formulas take.

`B` is the irradiance of a surface that faces the light, divided by π, linear RGB, so that B ⊗ m_d is the radiance that
a matte surface of albedo m_d reflects. With intensity I (which includes exposure and colour temperature):

- Sphere of radius r (in the world), centre at distance d. UsdLux gives it the radiance I, or with `normalize`
  I/(4π r²), I over its area. A sphere's irradiance is radiance · π r²/d², so B = I r²/d², or with `normalize`
  B = I/(4π d²). A point (r = 0) has no area: its intensity always counts as normalized.
- Distant light that fills a cone of half angle α = angle/2. Its irradiance is radiance · π sin²α, so B = I sin²α;
  `normalize` divides the radiance by π sin²α, so that I is the irradiance and B = I/π. A light without width
  (angle = 0) always counts as normalized, and one wider than a hemisphere as a hemisphere.

The other falloff models replace 1/d²: B = S · attenuation(d) with S = I r² or I/(4π). So the polynomial (0, 0, 1)
equals inverseSquare, and a light of strength S with 1/(k₂ d²) is an inverseSquare light of intensity I = 4π S/k₂.
"""

import math

import numpy as np
import warp as wp

from warp_smoke.record import value_at
from warp_smoke.scene import FALLOFF_MODELS, DistantLight, Light, SpotLight
from warp_smoke.shading.attenuation import (
    attenuate_inverse_square,
    attenuate_linear,
    attenuate_polynomial,
    shape_cone,
    shape_focus,
)

wp.set_module_options({"enable_backward": False})

_DISTANT, _POINT, _SPOT = (wp.constant(kind) for kind in range(3))
_INVERSE_SQUARE, _LINEAR, _POLYNOMIAL = (wp.constant(FALLOFF_MODELS.index(name)) for name in FALLOFF_MODELS)
# Brighter lights are clipped here, so that float32 products with any attenuation stay finite.
_BRIGHTEST = 1e18


@wp.struct
class LightSource:
    """A light at one time, in set space.

    Attributes:
        kind: `_DISTANT`, `_POINT` or `_SPOT`.
        strength: B before attenuation, linear RGB.
        position: of a point or spot light, [3] [stage units].
        direction: unit vector in which a distant or spot light shines.
        falloff: index of the falloff model in `FALLOFF_MODELS`.
        falloff_start: distance at which the linear falloff begins [stage units].
        falloff_end: no light beyond this distance [stage units].
        attenuation: k₀, k₁, k₂ of the polynomial falloff.
        cone_inner, cone_outer: angles from the axis at which a cone's edge begins to fade and ends [rad].
        focus: exponent of cos θ.
    """

    kind: int
    strength: wp.vec3
    position: wp.vec3
    direction: wp.vec3
    falloff: int
    falloff_start: float
    falloff_end: float
    attenuation: wp.vec3
    cone_inner: float
    cone_outer: float
    focus: float


def light_source(light: Light, origin: np.ndarray, time: float) -> LightSource:
    """Returns a light of the scene as it is at a time code.

    Args:
        light: a distant, point or spot light.
        origin: world position of set space's origin, [3] float64.
        time: time code.
    """
    source = LightSource()
    strength = _strength(light, time) * np.asarray(light.color)
    source.strength = wp.vec3(*np.minimum(strength, _BRIGHTEST))
    if isinstance(light, DistantLight):
        source.kind = _DISTANT
        source.direction = wp.vec3(*light.direction_at(time))
        return source
    source.kind = _POINT
    source.position = wp.vec3(*(light.position_at(time) - origin))
    source.falloff = FALLOFF_MODELS.index(light.falloff_model)
    source.falloff_start = light.falloff_start
    source.falloff_end = math.inf if light.falloff_end is None else light.falloff_end
    source.attenuation = wp.vec3(*light.attenuation)
    if isinstance(light, SpotLight):
        source.kind = _SPOT
        source.direction = wp.vec3(*light.direction_at(time))
        source.cone_outer = math.radians(light.cone_angle)
        source.cone_inner = (1.0 - light.cone_softness) * source.cone_outer
        source.focus = light.focus
    return source


def _strength(light: Light, time: float) -> float:
    """Returns B before attenuation and colour; see the module's derivation."""
    if not value_at(light.enabled, time):
        return 0.0
    intensity = float(value_at(light.intensity, time))
    if isinstance(light, DistantLight):
        if light.normalize or light.angle == 0.0:
            return intensity / math.pi
        return intensity * math.sin(math.radians(min(light.angle / 2.0, 90.0))) ** 2
    scale = abs(np.linalg.det(light.transform_at(time)[:3, :3])) ** (1.0 / 3.0)
    radius = light.radius * scale
    if light.normalize or radius == 0.0:
        return intensity / (4.0 * math.pi)
    return intensity * radius**2


@wp.func
def attenuate(light: LightSource, d: float):
    """The light's falloff model at distance d, zero beyond its end."""
    if d > light.falloff_end:
        return 0.0
    if light.falloff == _LINEAR:
        return attenuate_linear(d, light.falloff_start, light.falloff_end)
    if light.falloff == _POLYNOMIAL:
        return attenuate_polynomial(d, light.attenuation)
    return attenuate_inverse_square(d)


@wp.func
def incident_light(light: LightSource, p: wp.vec3):
    """Unit vector from p to the light (zero at the light itself), and B at p."""
    if light.kind == _DISTANT:
        return -light.direction, light.strength
    offset = light.position - p
    to_light = wp.normalize(offset)
    share = attenuate(light, wp.length(offset))
    if light.kind == _SPOT:
        cos_angle = -wp.dot(to_light, light.direction)
        # atan2 of sine and cosine keeps small angles exact; acos of the cosine does not.
        angle = wp.atan2(wp.length(wp.cross(to_light, light.direction)), cos_angle)
        share *= shape_focus(cos_angle, light.focus) * shape_cone(angle, light.cone_inner, light.cone_outer)
    return to_light, light.strength * share
