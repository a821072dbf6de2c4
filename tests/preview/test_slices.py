"""Cuts through volumes: which voxels, and where they lie."""

import numpy as np
import pytest

from warp_smoke.geometry import transform_points
from warp_smoke.preview.slices import cut_slice

VALUES = np.arange(2 * 3 * 4, dtype=np.float32).reshape(2, 3, 4)
# Voxels of 1 × 2 × 3 whose first centre is at (10, 20, 30).
TO_WORLD = np.diag([1.0, 2.0, 3.0, 1.0])
TO_WORLD[3, :3] = 10, 20, 30


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_voxels_keep_their_places(axis):
    """Each value of a cut lies where the voxel that it was taken from lies."""
    facing = np.eye(3)[axis]
    index = np.array([1, 1, 2])
    cut = cut_slice(VALUES, TO_WORLD, facing, transform_points(TO_WORLD, index))
    for a in range(cut.values.shape[0]):
        for b in range(cut.values.shape[1]):
            voxel = np.insert([a, b], axis, index[axis])
            assert cut.values[a, b] == VALUES[tuple(voxel)]
            place = transform_points(cut.to_world, np.array([a, b, 0]))
            np.testing.assert_allclose(place, transform_points(TO_WORLD, voxel))


def test_a_turned_volume_is_cut_along_its_own_axis():
    """The voxels' axis that is nearest to the direction is the cut's normal."""
    turned = TO_WORLD @ np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])  # x→z, y→x, z→y
    assert cut_slice(VALUES, turned, np.array([0.1, 0.2, 1.0]), None).values.shape == (3, 4)


def test_a_cut_beside_the_voxels_is_none():
    """A point outside of the voxels along the cut's normal gives no cut."""
    assert cut_slice(VALUES, TO_WORLD, np.array([1.0, 0, 0]), np.array([12.0, 20, 30])) is None
