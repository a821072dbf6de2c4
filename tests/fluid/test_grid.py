"""Blocks of samples: every face that air may pass belongs to exactly one, with the right cells beside it."""

from itertools import product

import numpy as np
import pytest
import warp as wp

from warp_smoke.fluid.grid import Block, all_cells, beside, face_shape, inner_faces, side_faces, side_faces_from_within
from warp_smoke.launch import Rows

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _add_neighbours(rows: Rows, block: Block, a: wp.array3d[float], a_out: wp.array3d[float]):
    """a_out(x) += 1000 a(x − before) + a(x − after)."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    before = beside(a, block.before)
    after = beside(a, block.after)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        a_out[i, j, k] = a_out[i, j, k] + 1000.0 * before[i, j, k] + after[i, j, k]
        k += 1


SHAPES = [(4, 3, 5), (1, 3, 2), (3, 1, 2), (2, 3, 1), (1, 1, 1)]


def _numbered(shape: tuple[int, int, int]) -> np.ndarray:
    return 1.0 + np.arange(np.prod(shape), dtype=np.float32).reshape(shape)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("axis", range(3))
def test_faces_know_their_cells(launcher, upload, shape, axis):
    """Inner faces see the cells before and after them, faces on open sides their one cell twice, and each only once."""
    cells = _numbered(shape)
    for ends in product(("open", "closed"), repeat=2):
        sides = ["closed"] * 6
        sides[2 * axis : 2 * axis + 2] = ends
        result = launcher.zeros(face_shape(shape, axis), "test")
        for size, block in [inner_faces(shape, axis), *side_faces(shape, tuple(sides), axis)]:
            launcher.launch(_add_neighbours, size, block, upload(cells), result)
        expected = np.zeros(face_shape(shape, axis), np.float32)
        faces, along = np.moveaxis(expected, axis, 0), np.moveaxis(cells, axis, 0)
        faces[1:-1] = 1000 * along[:-1] + along[1:]
        if ends[0] == "open":
            faces[0] = 1001 * along[0]
        if ends[1] == "open":
            faces[-1] = 1001 * along[-1]
        np.testing.assert_array_equal(result.numpy(), expected)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("axis", range(3))
def test_side_faces_know_the_next_inside(launcher, upload, shape, axis):
    """Beside each face on an open side lies the next face inside; in a domain one cell thick, itself."""
    numbers = _numbered(face_shape(shape, axis))
    result = launcher.zeros(numbers.shape, "test")
    for size, block in side_faces_from_within(shape, ("open",) * 6, axis):
        launcher.launch(_add_neighbours, size, block, upload(numbers), result)
    expected = np.zeros_like(numbers)
    faces, along = np.moveaxis(expected, axis, 0), np.moveaxis(numbers, axis, 0)
    inwards = int(shape[axis] > 1)
    faces[0], faces[-1] = 1001 * along[inwards], 1001 * along[-1 - inwards]
    np.testing.assert_array_equal(result.numpy(), expected)


def test_all_cells(launcher, upload):
    """Every cell once, with itself beside it."""
    cells = _numbered((3, 4, 5))
    result = launcher.zeros(cells.shape, "test")
    size, block = all_cells(cells.shape)
    launcher.launch(_add_neighbours, size, block, upload(cells), result)
    np.testing.assert_array_equal(result.numpy(), 1001 * cells)
