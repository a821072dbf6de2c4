"""The known answers of shadows and shading against sums over their definitions."""

import numpy as np
import pytest

from warp_smoke.study.light_answers import (
    blinn_phong,
    blinn_phong_albedo,
    difference,
    disk_share,
    edge_penumbra,
    gaussian_depth,
    implicit_step,
    sphere_depth,
    sphere_shadow_radius,
    spread_gaussian,
    variance,
    wave_heights,
    wave_normals,
)


def test_difference():
    """Errors 0, 3 and −4 against 10: mean 7/3, root mean square √(25/3), largest 4, of what they are a share of."""
    found = difference(np.array([10.0, 13.0, 6.0]), np.full(3, 10.0))
    assert found == pytest.approx({"l1": 7 / 3, "l2": (25 / 3) ** 0.5, "linf": 4.0, "relative_l2": (1 / 12) ** 0.5})
    assert difference(np.ones(2), np.zeros(2), 4.0)["relative_l2"] == 0.25


def test_depths_are_integrals():
    """Depths of the blob and the ball equal sums of their density along a line."""
    z = np.linspace(-6.0, 6.0, 100_001)
    for b in (0.0, 0.3, 0.69):
        blob = np.exp(-0.5 * (b**2 + z**2) / 0.3**2)
        assert gaussian_depth(b, 0.3, 2.0) == pytest.approx(2.0 * np.trapezoid(blob, z), rel=1e-6)
        assert sphere_depth(b, 0.7, 2.0) == pytest.approx(2.0 * np.mean(b**2 + z**2 < 0.49) * 12.0, abs=1e-3)
    assert sphere_depth(0.8, 0.7, 2.0) == 0.0


def test_implicit_step_solves_its_equation():
    """(I − r Δ) of the answer is what it began with, edges mirrored; a point's variance grows by 2r."""
    u = np.zeros((41, 41))
    u[20, 18] = 1.0
    for r in (0.1, 2.0):
        found = implicit_step(u, r)
        padded = np.pad(found, 1, mode="edge")
        around = padded[2:, 1:-1] + padded[:-2, 1:-1] + padded[1:-1, 2:] + padded[1:-1, :-2]
        np.testing.assert_allclose(found - r * (around - 4 * found), u, atol=1e-12)
    assert variance(implicit_step(u, 0.5)) == pytest.approx(1.0, rel=1e-6)


def test_spread_gaussian():
    """It keeps its sum, and its variance grows by what is added."""
    x = np.arange(101) - 50
    squares = np.add.outer(x**2, x**2)
    before, after = (spread_gaussian(squares, 9.0, added) for added in (0.0, 16.0))
    assert after.sum() == pytest.approx(before.sum(), rel=1e-6)
    assert variance(after) - variance(before) == pytest.approx(16.0, rel=1e-4)


def test_sphere_shadow_radius():
    """A tangent from the light to the ball meets the plane there."""
    radius = sphere_shadow_radius(3.0, 2.0, 0.5)
    ray = np.array([radius, -3.0]) / np.hypot(radius, 3.0)
    middle = np.array([0.0, -2.0])
    assert np.linalg.norm(middle - (middle @ ray) * ray) == pytest.approx(0.5)


def test_disk_share_is_an_area():
    """Of points spread over the unit disk."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (400_000, 2))
    inside = points[np.hypot(*points.T) < 1]
    for cut in (-1.5, -0.4, 0.0, 0.8, 2.0):
        assert disk_share(np.array(cut)) == pytest.approx(np.mean(inside[:, 0] > cut), abs=3e-3)


def test_edge_penumbra_counts_free_rays():
    """Rays from points to the disk that the light is seen as pass the half plane, or not."""
    light, radius, height = np.array([0.0, 3.0, 0.0]), 0.4, 1.2
    rng = np.random.default_rng(1)
    disk = rng.uniform(-1, 1, (400_000, 2))
    disk = disk[np.hypot(*disk.T) < 1]
    points = np.array([[-0.1, 0, 0.3], [0.0, 0, 0], [0.15, 0, -0.4], [1.0, 0, 0], [-1.0, 0, 0]])
    for point, expected in zip(points, edge_penumbra(points, light, radius, height), strict=True):
        toward = light - point
        distance = np.linalg.norm(toward)
        side = np.cross(toward / distance, [0.0, 0.0, 1.0])
        side /= np.linalg.norm(side)
        up = np.cross(side, toward / distance)
        width = distance * np.tan(np.arcsin(radius / distance))
        target = light + width * (disk[:, :1] * side + disk[:, 1:] * up)
        x = point[0] + height / (target[:, 1] - point[1]) * (target[:, 0] - point[0])
        assert expected == pytest.approx(np.mean(x > 0), abs=3e-3)


def test_waves():
    """Normals are at right angles to the slopes, found by small differences."""
    x, y = np.random.default_rng(2).random((2, 50))
    step = 1e-6
    slope_x, slope_y = (
        (wave_heights(x + a, y + b, 0.1) - wave_heights(x - a, y - b, 0.1)) / (2 * step)
        for a, b in ((step, 0), (0, step))
    )
    expected = np.stack([-slope_x, -slope_y, np.ones(50)], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(wave_normals(x, y, 0.1), expected, atol=1e-8)


@pytest.mark.parametrize("exponent", [0.0, 9.0, 256.0])
def test_albedo_is_an_integral(exponent):
    """Of the highlight's radiance over the hemisphere, for light of normal incidence and a white mirror."""
    steps = 20_000
    angle = (np.arange(steps) + 0.5) * (np.pi / 2 / steps)
    to_eye = np.stack([np.sin(angle), np.cos(angle), np.zeros(steps)], axis=1)
    up = np.tile([0.0, 1.0, 0.0], (steps, 1))
    radiance = blinn_phong(up, to_eye, up, np.ones(3), np.zeros(3), np.ones(3), exponent)[:, 0]
    share = np.sum(radiance * np.sin(2 * angle)) * (np.pi / 2 / steps)
    assert blinn_phong_albedo(exponent) == pytest.approx(share, rel=1e-6)
