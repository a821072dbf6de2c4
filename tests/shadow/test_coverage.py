"""Which tiles a depth map needs: never too few, and none for what cannot cast or receive."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from warp_smoke.geometry import Mesh
from warp_smoke.shadow.coverage import (
    CUBE_FRAMES,
    casting_boxes,
    cone_rectangles,
    covered_tiles,
    cube_rectangles,
    flat_rectangles,
    frame_along,
    launch_size,
    patches_of,
)

coordinate = st.floats(-5, 5, allow_nan=False)


def _box(a, b):
    return np.sort(np.array([[a, b]], float), axis=1)


@settings(deadline=None)
@given(a=st.tuples(*[coordinate] * 3), b=st.tuples(*[coordinate] * 3), seed=st.integers(0, 1000))
def test_rectangles_hold_every_point_of_a_box(a, b, seed):
    """Points of a box project into its rectangle: on the cube's faces, on a cone's map and on a flat one."""
    box = _box(a, b)
    points = np.random.default_rng(seed).uniform(box[0, 0], box[0, 1], (200, 3))
    frame = frame_along(np.array([0.6, -0.64, 0.48]))
    faces = [(f, r, 1.0) for f, r in zip(CUBE_FRAMES, cube_rectangles(box, np.zeros(3))[0], strict=True)]
    faces.append((frame, cone_rectangles(box, np.zeros(3), frame, 0.5)[0, 0], 0.5))
    for axes, (left, right, top, bottom), slope in faces:
        local = points @ axes.T
        local = local[local[:, 2] > 1e-9]
        st_ = local[:, :2] / (slope * local[:, 2:])
        inside = np.all(np.abs(st_) <= 1.0, axis=1)
        slack = 1e-6
        assert np.all(st_[inside, 0] >= left - slack)
        assert np.all(st_[inside, 0] <= right + slack)
        assert np.all(st_[inside, 1] >= top - slack)
        assert np.all(st_[inside, 1] <= bottom + slack)
    left, right, top, bottom = flat_rectangles(box, frame, np.array([-4.0, -4.0]), 8.0)[0, 0]
    flat = (points @ frame[:2].T + 4.0) / 4.0 - 1.0
    assert flat[:, 0].min() >= left - 1e-9
    assert flat[:, 1].max() <= bottom + 1e-9
    assert left <= right
    assert top <= bottom


def test_rectangle_of_a_box_is_tight():
    """A box straight ahead spans exactly the slopes of its nearest corners, and lies on one face alone."""
    found = cube_rectangles(_box((2, -1, -0.5), (4, 1, 1.0)), np.zeros(3))[0]
    np.testing.assert_allclose(found[0], [-0.5, 0.25, -0.5, 0.5])  # s = −z/x, t = −y/x
    np.testing.assert_array_equal(found[1], [1, -1, 1, -1])
    tiles = covered_tiles(found[None], 64)
    assert tiles.any(axis=(1, 2)).tolist() == [True] + [False] * 5


def test_ground_and_walls_cast_nothing():
    """Walls around a room and the ground under a set shadow no receiver; a wall between light and receiver does."""
    room, receivers = Mesh.box(8.0), np.array([[[-4, -4, -4], [4, 4, 4]]], float)
    cube = Mesh.box(1.0)
    triangles = np.concatenate([m.points_at(1)[m.triangles] for m in (room, cube)])
    owners = np.repeat([0, 1], [len(room.triangles), len(cube.triangles)])
    inside, outside = np.array([0, 3, 0, 1.0]), np.array([0, 9, 0, 1.0])
    np.testing.assert_array_equal(casting_boxes(triangles, owners, receivers, inside, 1e-5), [[[-0.5] * 3, [0.5] * 3]])
    assert len(casting_boxes(triangles, owners, receivers, outside, 1e-5)) == 2
    distant = np.array([0, 1.0, 0, 0])
    assert len(casting_boxes(triangles, owners, receivers, distant, 1e-5)) == 2  # the roof
    floor = Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8))
    ground = floor.points_at(1)[floor.triangles]
    flat = np.array([[[-4, 0, -4], [4, 0, 4]]], float)
    assert len(casting_boxes(ground, np.zeros(2, int), flat, inside, 1e-5)) == 0


def test_patches_are_small_and_of_one_surface():
    """Patches of a sphere span a sixteenth of it and a triangle; another surface, however near, has its own."""
    ball, box = Mesh.sphere(1.0, segments=64), Mesh.box(2.0)
    triangles = np.concatenate([m.points_at(1)[m.triangles] for m in (ball, box)])
    owners = np.repeat([0, 3], [len(ball.triangles), len(box.triangles)])
    patches = patches_of(triangles, owners)
    assert not set(patches[owners == 0]) & set(patches[owners == 3])
    assert np.all(np.sort(patches[owners == 0]) < patches[owners == 3].min())
    edge = 2 * np.pi / 64
    for patch in np.unique(patches[owners == 0]):
        corners = triangles[patches == patch].reshape(-1, 3)
        assert np.ptp(corners, axis=0).max() < 2.0 / 16 + 2 * edge


def test_launch_sizes_are_few():
    """No launch is too small, more than an eighth too large, or of one of many sizes."""
    sizes = [launch_size(n) for n in range(1, 5000)]
    assert all(n <= size <= 1.125 * n + 1 for n, size in enumerate(sizes, 1))
    assert len(set(sizes)) < 100
