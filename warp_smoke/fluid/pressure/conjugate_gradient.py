"""Preconditioned conjugate gradients around solids (M. R. Hestenes, E. Stiefel, 1952)."""

import warp as wp

from warp_smoke.fluid.grid import make_patch
from warp_smoke.fluid.halo import copy_samples
from warp_smoke.fluid.pressure.iterative import IterativePressure, Residual, laplacian
from warp_smoke.fluid.pressure.preconditioner import Preconditioner
from warp_smoke.fluid.pressure.status import PressureProblem
from warp_smoke.fluid.pressure.sums import add_product, add_residual, clear_part, dense_parts
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})

# Once the residual has shrunk by this factor, it is measured again.
_FRESH = 1e-5


@wp.kernel
def _apply_laplacian(
    rows: Rows,
    padded: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    centre: wp.array3d[float],
    a_out: wp.array3d[float],
    parts_out: wp.array3d[wp.float64],
):
    """Sets a = L p; parts of Σ p a."""
    i, _, c = wp.tid()
    i += rows.first
    p = dense(padded)
    a = dense(a_out)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, a_out.shape[2])
    clear_part(parts, 0, i, start, end)
    j = wp.int32(0)
    while j < a_out.shape[1]:
        k = start
        while k < end:
            value = laplacian(padded, wx, wy, wz, centre, i, j, k)
            a[i, j, k] = value
            add_product(parts, i, k, p[i + 1, j + 1, k + 1], value)
            k += 1
        j += 1


@wp.kernel
def _descend(
    rows: Rows,
    step: float,
    padded: wp.array3d[float],
    a: wp.array3d[float],
    border: int,
    q_inout: wp.array3d[float],
    residual_inout: wp.array3d[float],
    parts_out: wp.array3d[wp.float64],
):
    """Adds step p to q and −step L p to r, which has `border` layers below; parts of Σ r², max |r|, max |q|."""
    i, _, c = wp.tid()
    i += rows.first
    p = dense(padded)
    change = dense(a)
    q = dense(q_inout)
    r = dense(residual_inout)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, a.shape[2])
    clear_part(parts, 0, i, start, end)
    clear_part(parts, 1, i, start, end)
    clear_part(parts, 2, i, start, end)
    b = wp.max(border, 0)
    j = wp.int32(0)
    while j < a.shape[1]:
        k = start
        while k < end:
            pressure = q[i, j, k] + step * p[i + 1, j + 1, k + 1]
            q[i, j, k] = pressure
            parts[2, i, k] = wp.max(parts[2, i, k], wp.float64(wp.abs(pressure)))
            value = r[i + b, j + b, k + b] - step * change[i, j, k]
            r[i + b, j + b, k + b] = value
            add_residual(parts, 0, i, k, value)
            k += 1
        j += 1


@wp.kernel
def _turn(
    rows: Rows,
    correction: wp.array3d[float],
    fluid: wp.array3d[float],
    border: int,
    share: float,
    padded_inout: wp.array3d[float],
):
    """Sets p = fluid z + share p; z has `border` layers below."""
    i, j, c = wp.tid()
    i += rows.first
    z = dense(correction)
    f = dense(fluid)
    p = dense(padded_inout)
    b = wp.max(border, 0)  # known not to be negative, else the loop is not vectorised
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fluid.shape[2])
    while k < end:
        p[i + 1, j + 1, k + 1] = f[i, j, k] * z[i + b, j + b, k + b] + share * p[i + 1, j + 1, k + 1]
        k += 1


class ConjugateGradientPressure(IterativePressure):
    """Conjugate gradients.

    Each iterate has the least error in the energy norm √(e · −L e) of all that its iterations can reach, so the last
    is the best, also when iterations run out.
    """

    def __init__(self, launcher: Launcher, problem: PressureProblem, preconditioner: Preconditioner):
        """Allocates."""
        super().__init__(launcher, problem, preconditioner.residual, preconditioner.border)
        self._preconditioner = preconditioner
        self._change = launcher.zeros(problem.shape, "pressure")

    def _prepare(self) -> None:
        super()._prepare()
        self._preconditioner.prepare(self._operator)

    def _improve(self, pressure: wp.array, residual: Residual, zero_guess: Residual) -> tuple[int, Residual]:
        iterations, limit = 0, self._problem.max_iterations
        while iterations < limit and not self._is_small(residual, zero_guess):
            before = residual
            if iterations:
                self._remove_means()
            iterations += self._descend(pressure, residual, zero_guess, limit - iterations)
            # Round-off makes the updated residual drift from the true one: only the true one counts.
            residual = self._restart(pressure)
            if not (residual.largest < before.largest or residual.norm < before.norm):
                break
        return iterations, residual

    def _remove_means(self) -> None:
        """Subtracts the residual's mean over each closed component of fluid, once the residual is small.

        No pressure can remove this mean, and it grows relative to the rest until it misleads the iterations.
        """
        border = (self._border,) * 3
        back = tuple(-n for n in border)
        shape = self._problem.shape
        copy_samples(self._launcher, [make_patch((0, 0, 0), shape, back, back)], self._residual, self._change)
        self._components.remove_means(self._change)
        copy_samples(self._launcher, [make_patch(border, shape, border, border)], self._change, self._residual)

    def _descend(self, pressure: wp.array, start: Residual, zero_guess: Residual, limit: int) -> int:
        """Iterates until the updated residual is small, or much smaller than at the start; returns the iterations."""
        launch, sums, preconditioner = self._launcher.launch, self._sums, self._preconditioner
        operator = (*self._operator.shares, self._operator.centre)
        direction = self._padded  # the first direction has no share of its previous content
        product = 0.0
        for iteration in range(limit):
            product, before = preconditioner.apply(), product
            share = product / before if iteration else 0.0
            args = (preconditioner.correction, self._fluid, self._border, share, direction)
            launch(_turn, self._problem.shape, *args)
            self._fill_ghosts()
            launch(_apply_laplacian, sums.launch_shape, direction, *operator, self._change, sums.parts)
            curvature = sums.sum(0)
            if not curvature < 0.0:
                return iteration
            args = (product / curvature, direction, self._change, self._border, pressure, self._residual, sums.parts)
            launch(_descend, sums.launch_shape, *args)
            residual = self._read_residual()
            if self._is_small(residual, zero_guess) or residual.norm < _FRESH * start.norm:
                return iteration + 1
        return limit
