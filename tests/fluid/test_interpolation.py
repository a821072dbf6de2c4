"""Trilinear interpolation: exact for what it can represent, at every sample, and in fields one sample thick."""

import numpy as np
import pytest
import warp as wp

from warp_smoke.fluid.interpolation import sample, settle, within
from warp_smoke.launch import Rows

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _sample_at(rows: Rows, a: wp.array3d[float], points: wp.array[wp.vec3], result_out: wp.array[float]):
    """Sampling: result = a at each point."""
    n = rows.first + wp.tid()
    result_out[n] = sample(a, points[n][0], points[n][1], points[n][2])


@wp.kernel
def _tame(rows: Rows, a: wp.array[float], result_out: wp.array[float]):
    """Taming: result = a within [−1, 1], or 0 where it is next to nothing."""
    n = rows.first + wp.tid()
    result_out[n] = settle(within(a[n], -1.0, 1.0))


def _sampled(launcher, a: np.ndarray, points: np.ndarray) -> np.ndarray:
    field, places = (
        launcher.array(a.astype(np.float32), "test"),
        launcher.array(points.astype(np.float32), "test", wp.vec3),
    )
    result = launcher.zeros(len(points), "test")
    launcher.launch_each(_sample_at, len(points), field, places, result)
    return result.numpy()


SHAPES = pytest.mark.parametrize("shape", [(5, 6, 7), (1, 6, 7), (5, 1, 7), (5, 6, 1), (2, 2, 2), (1, 1, 1)])


@SHAPES
def test_samples_are_exact(launcher, shape):
    """At a sample the result is that sample, to the bit; the last ones, blended with weight 1, to round-off."""
    a = np.random.default_rng(1).standard_normal(shape).astype(np.float32)
    result = _sampled(launcher, a, np.stack(np.indices(shape).reshape(3, -1), axis=1)).reshape(shape)
    np.testing.assert_allclose(result, a, atol=1e-6)
    not_last = tuple(slice(0, max(1, n - 1)) for n in shape)
    np.testing.assert_array_equal(result[not_last], a[not_last])


@SHAPES
def test_trilinear_functions_are_exact(launcher, shape):
    """1 + 2x − 3y + 4z + xy − yz + 2xz − xyz, anywhere among the samples, to round-off."""

    def f(x, y, z):
        return 1 + 2 * x - 3 * y + 4 * z + x * y - y * z + 2 * x * z - x * y * z

    points = np.random.default_rng(2).uniform(size=(500, 3)) * (np.array(shape) - 1)
    a = f(*np.indices(shape).astype(float))
    np.testing.assert_allclose(_sampled(launcher, a, points), f(*points.T), atol=2e-6 * np.abs(a).max())


def test_tame(launcher):
    """Numbers are kept within bounds, NaN becomes the lower one, and what is next to nothing becomes 0."""
    values = np.array([-5.0, -0.5, -1e-25, 0.0, 1e-30, 1e-10, 0.5, 5.0, np.nan, np.inf, -np.inf], np.float32)
    result = launcher.zeros(len(values), "test")
    launcher.launch_each(_tame, len(values), launcher.array(values, "test"), result)
    expected = np.array([-1.0, -0.5, 0.0, 0.0, 0.0, 1e-10, 0.5, 1.0, -1.0, 1.0, -1.0], np.float32)
    np.testing.assert_array_equal(result.numpy(), expected)
