"""Sums over the grid in float64: kernels compute parts and the host adds the parts, always in the same order."""

import warp as wp

from warp_smoke.launch import Launcher


@wp.func
def dense_parts(a: wp.array3d[wp.float64]):
    """Returns the parts of `Sums` with strides derived from their shape, like `warp_smoke.launch.dense`."""
    return wp.array(ptr=a.ptr, shape=(a.shape[0], a.shape[1], a.shape[2]), dtype=wp.float64)


@wp.func
def clear_part(parts: wp.array3d[wp.float64], n: int, i: int, start: int, end: int):
    """Sets the parts of the n-th sum to 0 along a row."""
    k = start
    while k < end:
        parts[n, i, k] = wp.float64(0.0)
        k += 1


@wp.func
def add_product(parts: wp.array3d[wp.float64], i: int, k: int, a: float, b: float):
    """Adds a b to the first sum."""
    parts[0, i, k] = parts[0, i, k] + wp.float64(a) * wp.float64(b)


@wp.func
def add_residual(parts: wp.array3d[wp.float64], n: int, i: int, k: int, r: float):
    """Adds r² to the n-th sum, and includes |r| in the maximum after it."""
    wide = wp.float64(r)
    parts[n, i, k] = parts[n, i, k] + wide * wide
    parts[n + 1, i, k] = wp.max(parts[n + 1, i, k], wp.abs(wide))


class Sums:
    """Several sums or maxima over one grid.

    A kernel launched over `launch_shape` covers all j for one i and adds to its own `parts[n, i, k]`: the parts along k
    are independent, so the loop is vectorised, unlike a sum in one variable.

    Attributes:
        shape: cells along each axis (nx, ny, nz).
        parts: [count, nx, nz] float64.
        launch_shape: (nx, 1, nz).
    """

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], count: int, label: str):
        """Allocates the parts of `count` sums over `shape` cells."""
        self.shape = shape
        nx, _, nz = shape
        self.parts = launcher.zeros((count, nx, nz), label, wp.float64)
        self.launch_shape = (nx, 1, nz)

    def sum(self, n: int) -> float:
        """Returns the n-th result as a sum."""
        return float(self.parts.numpy()[n].sum())

    def largest(self, n: int) -> float:
        """Returns the n-th result as a maximum."""
        return float(self.parts.numpy()[n].max())
