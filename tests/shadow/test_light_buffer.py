"""Where light buffers lie: texels and slices on one ray, everything inside, lights that none can serve."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from warp_smoke.record import Samples
from warp_smoke.scene import PointLight
from warp_smoke.shadow.light_buffer import MAX_SLOPE, buffer_serves, fit_shear, light_in_cells, set_to_cells

LENGTHS = st.integers(1, 40)


def _lights():
    numbers = st.floats(-300, 300)
    return st.tuples(numbers, numbers, numbers, st.sampled_from([0.0, 1.0])).map(np.array)


def _fit(light, shape, **given_size):
    assume(np.linalg.norm(light[:3]) > 1e-3)
    if not light[3]:
        light = np.append(light[:3] / np.linalg.norm(light[:3]), 0.0)
    shear = fit_shear(light, shape, **given_size)
    assume(shear is not None)
    return light, shear


def _cells(shear, shape, s, t, slice_):
    """Cell coordinates of a point (s, t) in the middle of a slice."""
    inverse = np.linalg.inv(shear.from_cells)
    return np.array([s, t, slice_ + 0.5, 1.0]) @ inverse


@settings(deadline=None)
@given(light=_lights(), shape=st.tuples(LENGTHS, LENGTHS, LENGTHS), size=st.none() | st.integers(1, 64))
def test_a_texel_samples_one_ray(light, shape, size):
    """The places where a texel samples the slices and the light lie on one line, at rising depth."""
    light, shear = _fit(light, shape, size=size)
    scale, first_s, first_t = shear.slice_places().T
    for row, column in ((0, 0), (shear.texels[0] - 1, shear.texels[1] // 2)):
        slices = range(shear.slices)
        points = np.array(
            [_cells(shear, shape, scale[z] * row + first_s[z], scale[z] * column + first_t[z], z)[:3] for z in slices]
        )
        towards = light[:3] - light[3] * points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        np.testing.assert_allclose(towards, np.broadcast_to(towards[0], towards.shape), atol=1e-9)
        if shear.slices > 1:
            np.testing.assert_array_less(np.diff(points, axis=0) @ towards[0], 0.0)


@settings(deadline=None)
@given(light=_lights(), shape=st.tuples(LENGTHS, LENGTHS, LENGTHS), size=st.none() | st.integers(1, 64))
def test_the_box_lies_inside_the_outermost_texels(light, shape, size):
    """Every slice, with the half cell that its samples reach beyond it, lands between the outermost texels' centres."""
    _, shear = _fit(light, shape, size=size)
    sides = [n for axis, n in enumerate(shape) if axis != shear.axis]
    scale, *first = shear.slice_places().T
    for n in range(2):
        low = (-0.5 - first[n]) / scale
        high = (sides[n] + 0.5 - first[n]) / scale
        assert low.min() > -1e-9
        assert high.max() < shear.texels[n] - 1 + 1e-9


@settings(deadline=None)
@given(light=_lights(), shape=st.tuples(LENGTHS, LENGTHS, LENGTHS), texels=st.tuples(*[st.integers(4, 60)] * 2))
def test_given_texels_are_widened_to_hold_the_box(light, shape, texels):
    """A light that moves keeps its buffer's size: the box still fits."""
    _, shear = _fit(light, shape, texels=texels)
    assert shear.texels == texels
    sides = [n for axis, n in enumerate(shape) if axis != shear.axis]
    scale, *first = shear.slice_places().T
    for n in range(2):
        assert ((-0.5 - first[n]) / scale).min() > -1e-9
        assert ((sides[n] + 0.5 - first[n]) / scale).max() < texels[n] - 1 + 1e-9


def test_texels_meet_cells_for_light_along_an_axis():
    """Straight light samples every cell at its centre, so nothing is smeared."""
    shear = fit_shear(np.array([0.0, 1.0, 0.0, 0.0]), (8, 4, 6))
    assert (shear.axis, shear.flipped, shear.texels, shear.texel) == (1, True, (10, 8), 1.0)
    scale, s, t = shear.slice_places().T
    for values, expected in ((scale, 1.0), (s, -0.5), (t, -0.5)):
        np.testing.assert_array_equal(values, expected)


def test_size_is_that_of_the_longer_side():
    """`smoke_shadow_size` texels lie along the longer side of the box's shadow, and a spare one or two at its ends."""
    shear = fit_shear(np.array([0.0, 0.0, 1.0, 0.0]), (64, 32, 16), size=20)
    assert 20 <= shear.texels[0] <= 22
    assert 10 <= shear.texels[1] <= 13


def test_lights_inside_or_too_near_are_not_served(lattice_at, point_light, distant_light):
    """No buffer serves a light in the box, on its side, or so near that rays are steeper than MAX_SLOPE."""
    lattice = lattice_at((16, 16, 16))
    nearest = 8.5 / MAX_SLOPE - 0.5  # half the side and half a cell, over the slope at the first slice's middle
    for distance, served in ((0.0, False), (nearest - 0.01, False), (nearest + 0.01, True), (1e5, True)):
        for axis in range(3):
            for side in (-1, 1):
                position = np.zeros(3)
                position[axis] = side * (8 + distance)
                assert buffer_serves(point_light(position), lattice, [1.0]) == served
    assert not buffer_serves(point_light((1, 2, 3)), lattice, [1.0])
    assert buffer_serves(distant_light((1, 2, 3)), lattice, [1.0])


def test_a_light_is_served_only_if_it_is_at_all_times(lattice_at, placed):
    """A light that passes through the domain is refused for the frames in which it is inside."""
    path = Samples([1, 5], [placed((-40, 0, 0)), placed((40, 0, 0))])
    light = PointLight(path="/light", transform=path)
    lattice = lattice_at((16, 16, 16))
    assert buffer_serves(light, lattice, [1, 2])
    assert not buffer_serves(light, lattice, [1, 2, 3])


def test_spaces_far_from_the_origin(lattice_at, point_light):
    """Set space reaches the same cells however far away the scene is."""
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    for origin in (np.zeros(3), np.array([1e6, -2e6, 3e6])):
        lattice = lattice_at((4, 8, 16), corner=np.add(origin, [1, 2, 3]), voxel_size=0.5, axes=turn)
        place = np.append([1.0, 2.0, 3.0] + np.array([1.0, 2.5, 4.0]) @ turn, 1.0)
        np.testing.assert_allclose(place @ set_to_cells(lattice, origin), [2, 5, 8, 1], atol=1e-8)
        np.testing.assert_allclose(
            light_in_cells(point_light(place[:3] + origin), lattice, 1.0), [2, 5, 8, 1], atol=2e-8
        )


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("towards", [-1.0, 1.0])
def test_axis_with_the_least_slope(axis, towards):
    """Slices lie across the axis that the rays follow most, counted from the light."""
    direction = np.full(4, 0.5)
    direction[axis] = 2.0 * towards
    direction[3] = 0.0
    shear = fit_shear(direction / np.linalg.norm(direction), (5, 6, 7))
    assert (shear.axis, shear.flipped) == (axis, towards > 0)
    position = np.full(4, 3.0)
    position[axis] = 30.0 if towards > 0 else -24.0
    position[3] = 1.0
    shear = fit_shear(position, (5, 6, 7))
    assert (shear.axis, shear.flipped) == (axis, towards > 0)
