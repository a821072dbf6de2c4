"""The stage's lights: VTK lights on the set, beams on the smoke.

Where VTK has no such light they are approximate: linear falloff becomes a smooth one of equal strength at the start and
halfway to the end, a cone has a hard edge, and no surface shadows another. Baked surfaces do not use these lights.
"""

from collections.abc import Iterable

import numpy as np
import pyvista as pv

from warp_smoke.preview.camera import level_axes
from warp_smoke.preview.smoke import Beam
from warp_smoke.scene import DistantLight, Light, PointLight, Scene, SpotLight
from warp_smoke.shading.attenuation import shape_cone, shape_focus
from warp_smoke.shading.light_source import light_source

NEUTRAL_AMBIENT = (0.25, 0.25, 0.25)
# Direction (to the right, up, to the front) and colour of each: a bright one from above, a dim one from the left.
NEUTRAL_LIGHTS = (((-0.5, -1.0, -0.45), 0.75), ((1.0, -0.3, -0.3), 0.15))


def lights_of(scene: Scene) -> tuple[tuple[Light, ...], np.ndarray]:
    """Returns a scene's lights and ambient light [3], or neutral ones where it has none."""
    if any(light.shines for light in scene.lights) or any(scene.ambient):
        return scene.lights, np.asarray(scene.ambient)
    lights = []
    right, front = level_axes(scene.up)
    for number, (direction, strength) in enumerate(NEUTRAL_LIGHTS):
        matrix = np.eye(4)
        matrix[2, :3] = -np.asarray(direction) @ (right, scene.up, front)
        lights.append(DistantLight(path=f"/Neutral{number}", transform=matrix, intensity=np.pi * strength))
    return tuple(lights), np.asarray(NEUTRAL_AMBIENT)


def beam_on(light: Light, center: np.ndarray, radius: float, time: float) -> Beam:
    """Returns a light as parallel rays through smoke around a world point; `direction` is a unit world vector.

    A point light nearer than the radius has the strength that it would have at that distance.
    """
    strength = np.asarray(light_source(light, np.zeros(3), time).strength)
    if isinstance(light, DistantLight):
        return Beam(light.direction_at(time), strength)
    offset = center - light.position_at(time)
    distance = float(np.linalg.norm(offset))
    direction = offset / distance if distance > 0 else np.array([0.0, 0.0, 1.0])
    if isinstance(light, SpotLight):
        strength = strength * _share_of_cone(light, float(direction @ light.direction_at(time)))
    if light.falloff_end is not None and distance - radius > light.falloff_end:
        return Beam(direction, np.zeros(3))
    return Beam(direction, strength / np.polyval(_falloff(light)[::-1], max(distance, radius)))


def _share_of_cone(light: SpotLight, cosine: float) -> float:
    """Returns the share of a spot light's strength in a direction at this cosine to its axis."""
    angle, outer = np.arccos(np.clip(cosine, -1.0, 1.0)), np.radians(light.cone_angle)
    inner = (1.0 - light.cone_softness) * outer
    return shape_focus(cosine, light.focus) * shape_cone(float(angle), float(inner), float(outer))


def set_lights(plotter: pv.Plotter, lights: Iterable[Light], time: float, exposure: float = 0.0) -> None:
    """Sets a plotter's lights, in linear light; the exposure is in stops."""
    plotter.remove_all_lights()
    # Without any light VTK creates one, or adds a surface's diffuse colour to its ambient colour.
    dark = pv.Light(light_type="scene light")
    dark.SetDiffuseColor(0.0, 0.0, 0.0)
    for light in (dark, *(_vtk_light(light, time, exposure) for light in lights)):
        plotter.add_light(light)


def _vtk_light(light: Light, time: float, exposure: float) -> pv.Light:
    """Returns a VTK light of colour B, as `warp_smoke.shading.light_source` defines it."""
    strength = 2.0**exposure * np.asarray(light_source(light, np.zeros(3), time).strength)
    lamp = pv.Light(light_type="scene light")
    lamp.SetDiffuseColor(*strength)
    lamp.SetSpecularColor(0.0, 0.0, 0.0)
    if isinstance(light, DistantLight):
        lamp.positional = False
        lamp.position, lamp.focal_point = -light.direction_at(time), np.zeros(3)
        return lamp
    lamp.positional = True
    lamp.position = light.position_at(time)
    lamp.attenuation_values = _falloff(light)
    lamp.cone_angle = 90.0
    if isinstance(light, SpotLight):
        lamp.focal_point = lamp.position + light.direction_at(time)
        lamp.cone_angle, lamp.exponent = min(light.cone_angle, 89.9), light.focus
    return lamp


def _falloff(light: PointLight) -> tuple[float, float, float]:
    """Returns the coefficients k of the attenuation 1/(k₀ + k₁ d + k₂ d²)."""
    if light.falloff_model == "polynomial":
        return light.attenuation
    if light.falloff_model == "linear":
        start, half = light.falloff_start, (light.falloff_start + light.falloff_end) / 2
        slope = 1.0 / (half**2 - start**2)
        return (1.0 - slope * start**2, 0.0, slope)
    return (0.0, 0.0, 1.0)
