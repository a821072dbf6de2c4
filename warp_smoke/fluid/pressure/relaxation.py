"""Relaxation of the pressure, sweep by sweep: the simpler, slower alternatives to multigrid.

Damped Jacobi, and red-black successive over-relaxation (D. M. Young, 1954).
"""

from abc import abstractmethod
from math import sqrt

import warp as wp

from warp_smoke.fluid.pressure.iterative import IterativePressure, Residual, laplacian
from warp_smoke.fluid.pressure.spectral import eigenvalues
from warp_smoke.fluid.pressure.status import PressureProblem
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})

# Without damping, a checkerboard mode in a box with closed sides would alternate in sign forever.
JACOBI_WEIGHT = 6.0 / 7.0
_SWEEPS_BETWEEN_CHECKS = 8


@wp.func
def _relaxed(
    padded: wp.array3d[float],
    divergence: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    centre: wp.array3d[float],
    weight: float,
    i: int,
    j: int,
    k: int,
):
    """Returns q + weight (L q − d) / Σ a w; 0 where all faces are closed."""
    q = dense(padded)
    d = dense(divergence)
    middle = dense(centre)
    change = laplacian(padded, wx, wy, wz, centre, i, j, k) - d[i, j, k]
    here = q[i + 1, j + 1, k + 1]
    total = middle[i, j, k]
    return wp.where(total > 0.0, here + weight * change / wp.max(total, 1.0e-6), 0.0)


@wp.kernel
def _relax(
    rows: Rows,
    padded: wp.array3d[float],
    divergence: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    centre: wp.array3d[float],
    weight: float,
    padded_out: wp.array3d[float],
):
    """q_out = q + weight (L q − d) / Σ a w."""
    i, j, c = wp.tid()
    i += rows.first
    after = dense(padded_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, divergence.shape[2])
    while k < end:
        after[i + 1, j + 1, k + 1] = _relaxed(padded, divergence, wx, wy, wz, centre, weight, i, j, k)
        k += 1


@wp.kernel
def _relax_color(
    rows: Rows,
    color: int,
    divergence: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    centre: wp.array3d[float],
    weight: float,
    padded_inout: wp.array3d[float],
):
    """Adds weight (L q − d) / Σ a w to q where (i + j + k) mod 2 = color; all neighbours have the other colour."""
    i, j, c = wp.tid()
    i += rows.first
    q = dense(padded_inout)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, divergence.shape[2])
    k = start + (i + j + start + color) % 2
    while k < end:
        q[i + 1, j + 1, k + 1] = _relaxed(padded_inout, divergence, wx, wy, wz, centre, weight, i, j, k)
        k += 2


@wp.kernel
def _relax_third(
    rows: Rows,
    last: wp.vec3i,
    color: int,
    divergence: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    centre: wp.array3d[float],
    weight: float,
    padded_inout: wp.array3d[float],
):
    """Like `_relax_color` where (a_i + b_j + c_k) mod 3 = color: each is the index mod 2, or 2 for the index `last`."""
    i, j, c = wp.tid()
    i += rows.first
    q = dense(padded_inout)
    across = wp.where(i == last[0], 2, i % 2) + wp.where(j == last[1], 2, j % 2)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, divergence.shape[2])
    while k < end:
        if (across + wp.where(k == last[2], 2, k % 2)) % 3 == color:
            q[i + 1, j + 1, k + 1] = _relaxed(padded_inout, divergence, wx, wy, wz, centre, weight, i, j, k)
        k += 1


@wp.kernel
def _copy_inner(rows: Rows, padded: wp.array3d[float], q_out: wp.array3d[float]):
    """Copies q out of the layer of zeros around it."""
    i, j, c = wp.tid()
    i += rows.first
    p = dense(padded)
    q = dense(q_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, q_out.shape[2])
    while k < end:
        q[i, j, k] = p[i + 1, j + 1, k + 1]
        k += 1


class _Relaxation(IterativePressure):
    """Sweeps, with a regular check of the residual."""

    def __init__(self, launcher: Launcher, problem: PressureProblem):
        """Allocates."""
        super().__init__(launcher, problem, launcher.zeros(problem.shape, "pressure"), border=0)

    def _improve(self, pressure: wp.array, residual: Residual, zero_guess: Residual) -> tuple[int, Residual]:
        iterations, limit = 0, self._problem.max_iterations
        while iterations < limit and not self._is_small(residual, zero_guess):
            sweeps = min(_SWEEPS_BETWEEN_CHECKS, limit - iterations)
            for _ in range(sweeps):
                self._sweep()
            iterations += sweeps
            self._launcher.launch(_copy_inner, self._problem.shape, self._padded, pressure)
            residual = self._restart(pressure)
        return iterations, residual

    @abstractmethod
    def _sweep(self) -> None:
        """Relaxes every cell of the padded pressure once."""


class JacobiPressure(_Relaxation):
    """Damped Jacobi: all cells at once from the previous values."""

    def __init__(self, launcher: Launcher, problem: PressureProblem):
        """Allocates."""
        super().__init__(launcher, problem)
        self._other = launcher.zeros(self._padded.shape, "pressure")

    def _sweep(self) -> None:
        self._fill_ghosts()
        operator = (*self._operator.shares, self._operator.centre)
        args = (self._padded, self._source, *operator, JACOBI_WEIGHT, self._other)
        self._launcher.launch(_relax, self._problem.shape, *args)
        self._padded, self._other = self._other, self._padded


class RedBlackPressure(_Relaxation):
    """Over-relaxation of red, then black cells, with the weight that is optimal in the box without solids.

    Along a periodic axis with an odd number of cells a checkerboard does not close, so cells then have three colours.
    """

    def __init__(self, launcher: Launcher, problem: PressureProblem):
        """Allocates."""
        super().__init__(launcher, problem)
        self._weight = over_relaxation(problem)
        self._is_odd_ring = any(
            n % 2 and side == "periodic" for n, side in zip(problem.shape, problem.sides[0::2], strict=True)
        )
        # The last cell along each such axis, or −1.
        ends = zip(problem.shape, problem.sides[0::2], strict=True)
        self._last = wp.vec3i(*(n - 1 if n % 2 and side == "periodic" else -1 for n, side in ends))

    def _sweep(self) -> None:
        operator = (*self._operator.shares, self._operator.centre)
        for color in range(3 if self._is_odd_ring else 2):
            self._fill_ghosts()
            args = (color, self._source, *operator, self._weight, self._padded)
            if self._is_odd_ring:
                self._launcher.launch(_relax_third, self._problem.shape, self._last, *args)
            else:
                self._launcher.launch(_relax_color, self._problem.shape, *args)


def over_relaxation(problem: PressureProblem) -> float:
    """Returns the optimal weight 2 / (1 + √(1 − ρ²)) for the box without solids (Young, 1954).

    Jacobi's slowest mode shrinks by ρ = 1 − λ / 6 per sweep, with λ the least positive eigenvalue.
    """
    axes = [eigenvalues(n, *problem.sides[2 * axis : 2 * axis + 2]) for axis, n in enumerate(problem.shape)]
    least = sum(each[0] for each in axes)
    if least == 0.0:
        least = min((each[1] for each in axes if len(each) > 1), default=6.0)
    reach = 1.0 - min(least, 6.0) / 6.0
    return 2.0 / (1.0 + sqrt(1.0 - reach**2))
