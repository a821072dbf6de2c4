"""Modes of the axes: they are eigenvectors, both kinds of transforms agree, and back is the inverse of forth."""

from itertools import product

import numpy as np
import pytest

from warp_smoke.fluid.transforms import FastTransforms, MatrixTransforms, cell_modes, face_modes
from warp_smoke.launch import Launcher

ENDS = [*product(("even", "odd"), repeat=2), ("periodic", "periodic")]


def _continued(a: np.ndarray, ends: tuple, on_samples: bool) -> np.ndarray:
    """A field along an axis with one more sample at each end: mirrored at or half a sample beyond the last one."""
    if ends[0] == "periodic":
        period = len(a) - 1 if on_samples else len(a)
        again = np.append(a[:period], a[0]) if on_samples else a
        return np.concatenate([[a[period - 1]], again, [again[1 % len(again)] if on_samples else a[0]]])
    signs = [1.0 if end == "even" else -1.0 for end in ends]
    beside = (a[1], a[-2]) if on_samples else (a[0], a[-1])
    return np.concatenate([[signs[0] * beside[0]], a, [signs[1] * beside[1]]])


@pytest.mark.parametrize("n", [2, 3, 8, 11])
@pytest.mark.parametrize("ends", ENDS, ids="-".join)
@pytest.mark.parametrize("make", [cell_modes, face_modes])
def test_modes_are_eigenvectors(make, ends, n):
    """Each mode's second difference, continued at the ends, is −λ times the mode."""
    modes = make(n, *ends)
    inverse = modes.matrix(modes.inverse)
    for m in range(modes.first, modes.stop):
        a = inverse[:, m]
        difference = np.diff(_continued(a, ends, make is face_modes), 2)
        inner = slice(modes.first, modes.stop)
        np.testing.assert_allclose(difference[inner], -modes.eigenvalues[m] * a[inner], atol=1e-12)


@pytest.mark.parametrize("ends", ENDS, ids="-".join)
@pytest.mark.parametrize("make", [cell_modes, face_modes])
def test_back_is_the_inverse_of_forth(make, ends):
    """Forth and back give each sample again that has modes, and 0 on faces that have none."""
    modes = make(7, *ends)
    product = modes.matrix(modes.inverse) @ modes.matrix(modes.forward)
    has_modes = np.arange(len(modes.eigenvalues))
    np.testing.assert_allclose(product, np.diag((has_modes >= modes.first) & (has_modes < modes.stop)), atol=1e-14)


@pytest.mark.parametrize("ends", ENDS, ids="-".join)
@pytest.mark.parametrize("axes", [(2, 1), (2, 1, 0)])
def test_matrices_equal_fast_transforms(axes, ends):
    """The transforms that CUDA uses and those of scipy agree, forth and back, along two axes and three."""
    launcher, shape = Launcher("cpu", 1), (6, 12, 8)
    modes = {axis: cell_modes(shape[axis], *ends) for axis in axes}
    modes[1] = face_modes(shape[1] - 1, *ends)
    values = np.random.default_rng(2).standard_normal(shape).astype(np.float32)
    values[:, : modes[1].first] = 0.0
    values[:, modes[1].stop :] = 0.0
    field = launcher.array(values, "test")
    fast, dense = launcher.zeros(shape, "test"), launcher.zeros(shape, "test")
    one, other = FastTransforms(launcher, modes), MatrixTransforms(launcher, modes, shape, "test")
    one.forward(field, fast)
    other.forward(field, dense)
    np.testing.assert_allclose(dense.numpy(), fast.numpy(), atol=1e-4)  # sums of up to 24 numbers of size 3
    one.inverse(fast)
    other.inverse(dense)
    np.testing.assert_allclose(fast.numpy(), field.numpy(), atol=5e-6)
    np.testing.assert_allclose(dense.numpy(), field.numpy(), atol=5e-6)
