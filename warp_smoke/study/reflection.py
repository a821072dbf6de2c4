"""Reflected light against formulas: a highlight on a ball, per vertex or pixel, and the albedo."""

import numpy as np
import warp as wp

from warp_smoke.geometry import Mesh, normalized
from warp_smoke.launch import Launcher
from warp_smoke.material import Material
from warp_smoke.scene import DistantLight, PointLight
from warp_smoke.shading.primary_rays import Hits, interpolate_corners
from warp_smoke.study.case import Measured, time_repeats
from warp_smoke.study.light_answers import blinn_phong, blinn_phong_albedo, difference
from warp_smoke.study.shaded_points import POINTS, place_points, source_of
from warp_smoke.study.shadow_scenes import shine
from warp_smoke.study.smoke_plume import at

# For the ball: exponent 64, a light and an eye three radii from its centre.
_ROUGHNESS, _DIFFUSE, _R0 = 0.75, (0.2, 0.3, 0.4), (0.04, 0.04, 0.04)
_LAMP, _EYE = np.array([2.0, 2.0, 1.0]), np.array([-0.5, 1.0, 2.8])


def _ball(segments: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns a ball's triangles [m, 3, 3], and points seen from the eye: triangle, barycentric weights, and truth."""
    mesh = Mesh.sphere(1.0, segments)
    corners = mesh.points_at(1.0).astype(np.float64)[mesh.triangles]
    rng = np.random.default_rng(0)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    triangle = rng.choice(len(area), POINTS, p=area / area.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), POINTS)
    place = normalized(np.sum(weights[:, :, None] * corners[triangle], axis=1))
    seen = np.sum((_EYE - place) * place, axis=1) > 0.0
    place = place[seen]
    to_light, distance = normalized(_LAMP - place), np.linalg.norm(_LAMP - place, axis=1)
    colors = 1.0 / distance[:, None] ** 2, np.array(_DIFFUSE), np.array(_R0)
    truth = blinn_phong(to_light, normalized(_EYE - place), place, *colors, 256.0 * (1.0 - _ROUGHNESS))
    return corners, triangle[seen], weights[seen], truth


def _gloss() -> tuple[Material, PointLight]:
    """Returns the ball's material and its light, of B = 1/d²."""
    lamp = PointLight(path="/Lamp", transform=at(*_LAMP), intensity=4.0 * np.pi)
    return Material(diffuse_color=_DIFFUSE, fresnel_r0=_R0, roughness=_ROUGHNESS), lamp


def measure_pixels(segments: int, launcher: Launcher, repeats: int) -> Measured:
    """Measures the highlight shaded at each point, with normals interpolated between corners."""
    corners, triangle, weights, truth = _ball(segments)
    material, lamp = _gloss()
    positions, normals = (np.sum(weights[:, :, None] * a[triangle], axis=1) for a in (corners, normalized(corners)))
    arrays = {"positions": positions, "normals": normalized(normals)}
    points, source = place_points(launcher, material, _EYE, arrays), source_of(lamp)

    def shade() -> None:
        points.look_up()
        points.shade(source)

    seconds = time_repeats(launcher, shade, repeats)
    return Measured(difference(points.radiance.numpy(), truth), seconds, points.count)


def measure_vertices(segments: int, launcher: Launcher, repeats: int) -> Measured:
    """Measures the highlight shaded at the corners and interpolated between them."""
    corners, triangle, weights, truth = _ball(segments)
    material, lamp = _gloss()
    arrays = {"positions": corners.reshape(-1, 3), "normals": normalized(corners.reshape(-1, 3))}
    points, source = place_points(launcher, material, _EYE, arrays), source_of(lamp)
    hits, count = Hits(), len(triangle)
    hits.triangle = launcher.array(triangle.astype(np.int32), "study")
    hits.weights = launcher.array(weights[:, 1:].astype(np.float32), "study", dtype=wp.vec2)
    hits.distance = launcher.zeros(count, "study")
    radiance = launcher.zeros(count, "study", dtype=wp.vec3)

    def shade() -> None:
        points.look_up()
        points.shade(source)
        interpolate_corners(launcher, count, hits, points.radiance, wp.vec3(0.0, 0.0, 0.0), radiance)

    seconds = time_repeats(launcher, shade, repeats)
    return Measured(difference(radiance.numpy(), truth), seconds, count)


def measure_albedo(exponent: int, reflection: str, angles: int, launcher: Launcher, repeats: int) -> Measured:
    """Measures the albedo by the midpoint rule over the eye's angle, for light along the normal and R₀ = 1."""
    angle = (np.arange(angles) + 0.5) * (0.5 * np.pi / angles)
    to_eye = np.stack([np.sin(angle), np.cos(angle), np.zeros(angles)], axis=1)
    material = Material(
        diffuse_color=(0.0,) * 3, fresnel_r0=(1.0,) * 3, roughness=1.0 - exponent / 256.0, reflection=reflection
    )
    sun = DistantLight(path="/Sun", transform=shine((0.0, -1.0, 0.0)), intensity=np.pi)
    arrays = {"positions": -to_eye, "normals": np.tile([0.0, 1.0, 0.0], (angles, 1))}
    points, source = place_points(launcher, material, np.zeros(3), arrays), source_of(sun)

    def shade() -> None:
        points.look_up()
        points.shade(source)

    seconds = time_repeats(launcher, shade, repeats)
    # B = 1 is an irradiance of π; radiance leaves through 2π sin θ cos θ dθ.
    share = np.sum(points.radiance.numpy()[:, 0] * np.sin(2.0 * angle)) * (0.5 * np.pi / angles)
    truth = blinn_phong_albedo(exponent) if reflection == "blinnPhong" else 1.0
    return Measured(difference(np.array([share]), np.array([truth])), seconds, angles)
