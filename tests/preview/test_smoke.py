"""Smoke as coloured voxels: exact depths, where the voxels lie, and how light falls off in them."""

import numpy as np
import pytest

from warp_smoke.preview.color import encode_light, expose_light, linear_to_srgb, to_bytes
from warp_smoke.preview.smoke import REFLECTANCE, Beam, color_smoke, find_smoke, optical_depth, show_light

SIDES = np.array([0.3, 0.3, 0.3])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_depth_along_an_axis_is_exact(axis, sign):
    """In uniform smoke, light along an axis has passed n + ½ voxels at the centre of the n-th one it comes to."""
    direction = np.zeros(3)
    direction[axis] = sign
    depth = np.moveaxis(optical_depth(np.full((4, 5, 6), 2.0, np.float32), SIDES, direction), axis, 0)
    passed = 2.0 * 0.3 * (np.arange(len(depth)) + 0.5)
    np.testing.assert_allclose(depth[:: int(sign)], passed[:, None, None] + np.zeros_like(depth), rtol=1e-6)


def test_depth_along_a_diagonal_is_exact():
    """Along the diagonal of two axes each slice reads whole voxels: √2 times the depth along one axis."""
    depth = optical_depth(np.ones((5, 5, 3), np.float32), SIDES, np.array([1.0, 1.0, 0.0]))
    i, j, _ = np.indices(depth.shape)
    np.testing.assert_allclose(depth, 0.3 * np.sqrt(2) * (np.minimum(i, j) + 0.5), rtol=1e-6)


def test_depth_along_voxels_of_unequal_sides():
    """A step is as deep as the sides it crosses: along the diagonal of 3 × 4, five thirds of the first side."""
    depth = optical_depth(np.ones((5, 5, 3), np.float32), np.array([0.3, 0.4, 1.0]), np.array([1.0, 1.0, 0.0]))
    i, j, _ = np.indices(depth.shape)
    np.testing.assert_allclose(depth, 0.5 * (np.minimum(i, j) + 0.5), rtol=1e-6)


def test_depth_conserves_smoke():
    """Behind the smoke, the depths of a slice sum to all of it, however oblique the light (none leaves the sides)."""
    density = np.zeros((20, 20, 12), np.float32)
    density[8:12, 8:12, 2:5] = np.random.default_rng(1).random((4, 4, 3))
    direction = np.array([0.3, -0.2, 1.0])
    behind = optical_depth(density, SIDES, direction)[:, :, -1].sum()
    assert behind == pytest.approx(density.sum() * 0.3 * np.linalg.norm(direction), rel=1e-5)


def test_found_smoke_stays_where_it_is():
    """The box holds the smoke and one empty layer around it, and its matrix takes each voxel to where it was."""
    density = np.zeros((9, 8, 7), np.float32)
    density[0:3, 4, 5:7] = 1.0  # up to two sides of the array
    matrix = np.diag([0.5, 0.5, 0.5, 1.0])
    matrix[3, :3] = 10, 20, 30
    found, to_world, _ = find_smoke(density, matrix)
    assert found.shape == (5, 3, 4)
    assert found.sum() == density.sum()
    np.testing.assert_array_equal(found[1:4, 1, 1:3], 1.0)
    np.testing.assert_allclose([1, 1, 1, 1] @ to_world, [0, 4, 5, 1] @ matrix)


@pytest.mark.parametrize("density", [np.zeros((3, 3, 3)), np.full((2, 2, 2), -1.0), np.zeros((0, 0, 0))])
def test_no_smoke_is_found_where_there_is_none(density):
    """Empty, negative and absent voxels hold no smoke."""
    assert find_smoke(density.astype(np.float32), np.eye(4)) is None


def test_ambient_light_is_the_same_everywhere():
    """Without beams each voxel has the colour of the ambient light, and its density as a share of the greatest."""
    density = np.array([0.0, 1.0, 4.0], np.float32).reshape(3, 1, 1)
    smoke = color_smoke(density, np.eye(4), 2.0, [], np.array([0.2, 0.4, 0.8]))
    color = linear_to_srgb(REFLECTANCE * np.array([0.2, 0.4, 0.8]))
    assert (to_bytes(smoke.rgba[..., :3]) == color).all()
    assert smoke.rgba[:, 0, 0, 3].tolist() == [0, 16384, 65535]
    assert smoke.extinction == 8.0


def test_smoke_is_darker_away_from_the_light():
    """Turned voxels under a beam: brightness falls along the beam in the world, not along an axis of the voxels."""
    quarter = np.eye(4)
    quarter[:2, :2] = [[0, 1], [-1, 0]]  # voxel axis i points along world +y
    beam = Beam(np.array([0.0, -1.0, 0.0]), np.ones(3))
    smoke = color_smoke(np.ones((6, 5, 4), np.float32), quarter, 0.5, [beam], np.zeros(3))
    red = smoke.rgba[..., 0].astype(int)
    assert (np.diff(red, axis=0) > 0).all()
    assert (red == red[:, :1, :1]).all()


def test_thin_smoke_gives_back_what_falls_on_it():
    """Where smoke is too thin to shade itself it has the beam's colour: the shares of all bounces add up to 1."""
    beam = Beam(np.array([0.0, 0.0, 1.0]), np.array([0.9, 0.6, 0.3]))
    smoke = color_smoke(np.ones((2, 2, 2), np.float32), np.eye(4), 1e-6, [beam], np.zeros(3))
    assert (to_bytes(smoke.rgba[..., :3]) == linear_to_srgb(REFLECTANCE * beam.radiance)).all()


def test_srgb_bytes_follow_the_standard():
    """Every byte is within its rounding, and 0.05 for the table's steps, of IEC 61966-2-1; the rest is clipped."""
    linear = np.linspace(0, 1, 100_001)
    exact = 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert np.abs(linear_to_srgb(linear) - exact).max() < 0.55
    assert linear_to_srgb(np.array([-1.0, 2.0])).tolist() == [0, 255]


def test_light_beyond_white():
    """The sRGB curve goes on: 16 bits hold light up to the brightest, and a stop less is the light halved."""
    linear = np.array([-1.0, 0.0, 0.002, 0.5, 1.0, 4.0, 40.0])
    codes, brightest = encode_light(linear)
    exact = np.where(linear <= 0.0031308, 12.92 * np.maximum(linear, 0), 1.055 * np.abs(linear) ** (1 / 2.4) - 0.055)
    assert brightest == pytest.approx(exact[-1])
    assert np.abs(codes / 65535 * brightest - exact).max() < 2e-4 + 0.5 * brightest / 65535  # the table's steps
    halved, less = expose_light(codes, brightest, -1.0)
    expected, bright = encode_light(linear / 2)
    np.testing.assert_allclose(less * halved, bright * expected, atol=25)  # of 65535: a byte has 257
    assert expose_light(codes, brightest, 0.0) == (codes, brightest)


def test_light_that_is_known_is_shown_as_it_is():
    """Voxels have the scattered light's own sRGB; empty ones beside them the mean of theirs, others stay black."""
    density = np.zeros((5, 5, 5), np.float32)
    density[1:3, 2, 2] = 1.0
    scattered = np.zeros((5, 5, 5, 3), np.float32)
    scattered[1, 2, 2], scattered[2, 2, 2] = (0.1, 0.2, 0.3), (0.3, 0.6, 0.9)
    smoke = show_light(density, np.eye(4), 2.0, scattered)
    mean = np.array([0.2, 0.4, 0.6])
    for place, light in (((1, 2, 2), scattered[1, 2, 2]), ((3, 2, 2), scattered[2, 2, 2]), ((1, 3, 1), mean)):
        assert to_bytes(smoke.rgba[(*place, slice(3))]).tolist() == linear_to_srgb(light).tolist()
    assert not smoke.rgba[4, :, :, :3].any()
    assert smoke.extinction == 2.0
