"""Conjugate gradients around solids, preconditioned by the exact solver of the empty box.

M. R. Hestenes, E. Stiefel (1952); the fast solver of a simpler domain as preconditioner: P. Concus, G. H. Golub (1973).
The operator has a weight for each face, the share of it that is open: L q = Σ a w (q_neighbour − q), with a = 1 between
cells and 2 on an open side, where q = 0 outside.
"""

from math import isfinite, nan, prod, sqrt
from typing import TYPE_CHECKING, NamedTuple

import warp as wp

from warp_smoke.fluid.colliders import open_faces
from warp_smoke.fluid.operators import face_weight, side_weights
from warp_smoke.fluid.pressure.components import ClosedComponents
from warp_smoke.fluid.pressure.spectral import SpectralPressure
from warp_smoke.fluid.pressure.status import PressureStatus
from warp_smoke.fluid.pressure.sums import Sums, dense_parts
from warp_smoke.launch import Launcher, Rows, dense

if TYPE_CHECKING:
    from warp_smoke.fluid.colliders import Solids

wp.set_module_options({"enable_backward": False})

# Residual due to the round-off of a pressure of 1: 12 half ulps from storing it, about as much from summing L q.
_ROUND_OFF = 24 * 2.0**-24


@wp.kernel
def _sum_weights(
    rows: Rows,
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    centre_out: wp.array3d[float],
):
    """Sets centre = Σ a w over the six faces of a cell."""
    i, j, c = wp.tid()
    i += rows.first
    nx = centre_out.shape[0]
    ny = centre_out.shape[1]
    nz = centre_out.shape[2]
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, nz)
    while k < end:
        total = face_weight(i, nx, lower[0], upper[0]) * wx[i, j, k]
        total += face_weight(i + 1, nx, lower[0], upper[0]) * wx[i + 1, j, k]
        total += face_weight(j, ny, lower[1], upper[1]) * wy[i, j, k]
        total += face_weight(j + 1, ny, lower[1], upper[1]) * wy[i, j + 1, k]
        total += face_weight(k, nz, lower[2], upper[2]) * wz[i, j, k]
        total += face_weight(k + 1, nz, lower[2], upper[2]) * wz[i, j, k + 1]
        centre_out[i, j, k] = total
        k += 1


@wp.kernel
def _start(rows: Rows, fluid: wp.array3d[float], q_inout: wp.array3d[float], padded_out: wp.array3d[float]):
    """Sets q = fluid q, and the padded copy of it inside a layer of zeros."""
    i, j, c = wp.tid()
    i += rows.first
    f = dense(fluid)
    q = dense(q_inout)
    p = dense(padded_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, q_inout.shape[2])
    while k < end:
        value = f[i, j, k] * q[i, j, k]
        q[i, j, k] = value
        p[i + 1, j + 1, k + 1] = value
        k += 1


@wp.func
def _laplacian(
    p: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    centre: wp.array3d[float],
    i: int,
    j: int,
    k: int,
):
    """Σ w p_neighbour − centre p, with p padded by a layer of zeros, so that sides need no branch."""
    along_i = wx[i, j, k] * p[i, j + 1, k + 1] + wx[i + 1, j, k] * p[i + 2, j + 1, k + 1]
    along_j = wy[i, j, k] * p[i + 1, j, k + 1] + wy[i, j + 1, k] * p[i + 1, j + 2, k + 1]
    along_k = wz[i, j, k] * p[i + 1, j + 1, k] + wz[i, j, k + 1] * p[i + 1, j + 1, k + 2]
    return along_i + along_j + along_k - centre[i, j, k] * p[i + 1, j + 1, k + 1]


@wp.kernel
def _measure_residual(
    rows: Rows,
    padded: wp.array3d[float],
    divergence: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    centre: wp.array3d[float],
    residual_out: wp.array3d[float],
    parts_out: wp.array3d[wp.float64],
):
    """Sets r = d − L q; parts of Σ r², max |r| and max |q|."""
    i, _, c = wp.tid()
    i += rows.first
    p = dense(padded)
    d = dense(divergence)
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    middle = dense(centre)
    r = dense(residual_out)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, divergence.shape[2])
    k = start
    while k < end:
        parts[0, i, k] = wp.float64(0.0)
        parts[1, i, k] = wp.float64(0.0)
        parts[2, i, k] = wp.float64(0.0)
        k += 1
    j = wp.int32(0)
    while j < divergence.shape[1]:
        k = start
        while k < end:
            value = d[i, j, k] - _laplacian(p, ox, oy, oz, middle, i, j, k)
            r[i, j, k] = value
            wide = wp.float64(value)
            parts[0, i, k] = parts[0, i, k] + wide * wide
            parts[1, i, k] = wp.max(parts[1, i, k], wp.abs(wide))
            parts[2, i, k] = wp.max(parts[2, i, k], wp.float64(wp.abs(p[i + 1, j + 1, k + 1])))
            k += 1
        j += 1


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
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    middle = dense(centre)
    a = dense(a_out)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, a_out.shape[2])
    k = start
    while k < end:
        parts[0, i, k] = wp.float64(0.0)
        k += 1
    j = wp.int32(0)
    while j < a_out.shape[1]:
        k = start
        while k < end:
            value = _laplacian(p, ox, oy, oz, middle, i, j, k)
            a[i, j, k] = value
            parts[0, i, k] = parts[0, i, k] + wp.float64(p[i + 1, j + 1, k + 1]) * wp.float64(value)
            k += 1
        j += 1


@wp.kernel
def _descend(
    rows: Rows,
    step: float,
    padded: wp.array3d[float],
    a: wp.array3d[float],
    q_inout: wp.array3d[float],
    residual_inout: wp.array3d[float],
    parts_out: wp.array3d[wp.float64],
):
    """Adds step p to q and −step L p to r; parts of Σ r², max |r| and max |q|."""
    i, _, c = wp.tid()
    i += rows.first
    p = dense(padded)
    change = dense(a)
    q = dense(q_inout)
    r = dense(residual_inout)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, a.shape[2])
    k = start
    while k < end:
        parts[0, i, k] = wp.float64(0.0)
        parts[1, i, k] = wp.float64(0.0)
        parts[2, i, k] = wp.float64(0.0)
        k += 1
    j = wp.int32(0)
    while j < a.shape[1]:
        k = start
        while k < end:
            pressure = q[i, j, k] + step * p[i + 1, j + 1, k + 1]
            q[i, j, k] = pressure
            parts[2, i, k] = wp.max(parts[2, i, k], wp.float64(wp.abs(pressure)))
            value = r[i, j, k] - step * change[i, j, k]
            r[i, j, k] = value
            wide = wp.float64(value)
            parts[0, i, k] = parts[0, i, k] + wide * wide
            parts[1, i, k] = wp.max(parts[1, i, k], wp.abs(wide))
            k += 1
        j += 1


@wp.kernel
def _sum_products(rows: Rows, a: wp.array3d[float], b: wp.array3d[float], parts_out: wp.array3d[wp.float64]):
    """Parts of Σ a b and max |a|."""
    i, _, c = wp.tid()
    i += rows.first
    x = dense(a)
    y = dense(b)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, a.shape[2])
    k = start
    while k < end:
        parts[0, i, k] = wp.float64(0.0)
        parts[1, i, k] = wp.float64(0.0)
        k += 1
    j = wp.int32(0)
    while j < a.shape[1]:
        k = start
        while k < end:
            wide = wp.float64(x[i, j, k])
            parts[0, i, k] = parts[0, i, k] + wide * wp.float64(y[i, j, k])
            parts[1, i, k] = wp.max(parts[1, i, k], wp.abs(wide))
            k += 1
        j += 1


@wp.kernel
def _turn(
    rows: Rows,
    correction: wp.array3d[float],
    fluid: wp.array3d[float],
    share: float,
    padded_inout: wp.array3d[float],
):
    """Sets p = fluid z + share p."""
    i, j, c = wp.tid()
    i += rows.first
    z = dense(correction)
    f = dense(fluid)
    p = dense(padded_inout)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, correction.shape[2])
    while k < end:
        p[i + 1, j + 1, k + 1] = f[i, j, k] * z[i, j, k] + share * p[i + 1, j + 1, k + 1]
        k += 1


class _Residual(NamedTuple):
    """Largest absolute value and norm of a residual, and the largest absolute pressure that it was measured with."""

    largest: float
    norm: float
    pressure: float


class ConjugateGradientPressure:
    """Iterative solver for a box with solids (or without, for comparison).

    Of all corrections that its iterations can reach, each iterate is the one with the least error in the energy norm,
    √(e · L e); so the last is the best, also when iterations run out. The net divergence of closed components of fluid
    is left out, and the mean of their pressure is 0.
    """

    def __init__(
        self,
        launcher: Launcher,
        shape: tuple[int, int, int],
        sides: tuple[str, ...],
        solids: "Solids | None",
        tolerance: float,
        max_iterations: int,
    ):
        """Allocates; what depends on the solids is prepared when they have changed.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz).
            sides: open or closed for each of -x +x -y +y -z +z.
            solids: the domain's solids, or None.
            tolerance: stop when largest |r| and rms r are at most this, relative to those of zero pressure.
            max_iterations: stop after so many.
        """
        self._launcher, self._shape, self._sides, self._solids = launcher, shape, sides, solids
        self._tolerance, self._max_iterations = tolerance, max_iterations
        self._empty_box = SpectralPressure(launcher, shape, sides)
        self._centre, self._source, self._residual, self._correction, self._change = (
            launcher.zeros(shape, "pressure") for _ in range(5)
        )
        self._direction = launcher.zeros(tuple(n + 2 for n in shape), "pressure")
        self._sums = Sums(launcher, shape, 3, "pressure")
        self._components = ClosedComponents(launcher, sides)
        self._prepared_for = None  # `solids.changes` at that time
        if solids is None:
            self._fluid = launcher.zeros(shape, "pressure")
            self._fluid.fill_(1.0)
            self._shares = tuple(
                launcher.zeros(tuple(n + (axis == along) for axis, n in enumerate(shape)), "pressure")
                for along in range(3)
            )
            open_faces(launcher, self._fluid, sides, self._shares)
            self._prepare()
        else:
            self._fluid, self._shares = solids.fluid, (solids.wx, solids.wy, solids.wz)

    def solve(self, divergence: wp.array, pressure: wp.array) -> PressureStatus:
        """Solves Σ (q_neighbour − q) = d over the open faces of cells of fluid.

        Args:
            divergence: d, [nx, ny, nz] [m/s], 0 in solid cells.
            pressure: q = dt p / h, [nx, ny, nz] [m/s]: the first guess, replaced by the solution; 0 in solid cells.
        """
        if self._solids is not None and self._prepared_for != self._solids.changes:
            self._prepare()
            self._prepared_for = self._solids.changes
        zero_guess = self._measure(divergence)
        if zero_guess.norm == 0.0:
            pressure.zero_()
            return PressureStatus(iterations=0, max_residual=0.0, rms_residual=0.0, converged=True)
        if not isfinite(zero_guess.norm):
            return PressureStatus(iterations=0, max_residual=nan, rms_residual=nan, converged=False)
        wp.copy(self._source, divergence)
        imbalance = self._components.remove_means(self._source)

        iterations = 0
        residual = self._restart(pressure)
        converged = self._is_small(residual, zero_guess)
        while not converged and iterations < self._max_iterations:
            before = residual
            iterations += self._iterate(pressure, zero_guess, self._max_iterations - iterations)
            # Round-off makes the residual that was updated drift from the true one: only the true one counts.
            residual = self._restart(pressure)
            converged = self._is_small(residual, zero_guess)
            if not (residual.largest < before.largest or residual.norm < before.norm):
                break
        self._components.remove_means(pressure)
        return PressureStatus(
            iterations=iterations,
            max_residual=residual.largest / zero_guess.largest,
            rms_residual=residual.norm / zero_guess.norm,
            converged=converged,
            imbalance=imbalance,
        )

    def _prepare(self) -> None:
        """Takes in where the solids are."""
        args = (*self._shares, *side_weights(self._sides), self._centre)
        self._launcher.launch(_sum_weights, self._shape, *args)
        self._components.find(self._fluid.numpy())

    def _measure(self, field: wp.array) -> _Residual:
        """A field as the residual of zero pressure."""
        self._launcher.launch(_sum_products, self._sums.launch_shape, field, field, self._sums.parts)
        return _Residual(self._sums.largest(1), sqrt(self._sums.sum(0)), 0.0)

    def _restart(self, pressure: wp.array) -> _Residual:
        """Measures the true residual of a pressure, for the iterations to go on from."""
        self._launcher.launch(_start, self._shape, self._fluid, pressure, self._direction)
        args = (self._direction, self._source, *self._shares, self._centre, self._residual, self._sums.parts)
        self._launcher.launch(_measure_residual, self._sums.launch_shape, *args)
        return self._read_residual()

    def _read_residual(self) -> _Residual:
        return _Residual(self._sums.largest(1), sqrt(self._sums.sum(0)), self._sums.largest(2))

    def _is_small(self, residual: _Residual, zero_guess: _Residual) -> bool:
        round_off = _ROUND_OFF * residual.pressure
        return residual.largest <= max(self._tolerance * zero_guess.largest, round_off) and residual.norm <= max(
            self._tolerance * zero_guess.norm, round_off * sqrt(prod(self._shape))
        )

    def _iterate(self, pressure: wp.array, zero_guess: _Residual, limit: int) -> int:
        """Iterates until the residual as updated is small; returns how often."""
        launch, sums = self._launcher.launch, self._sums
        product = 0.0
        for iteration in range(limit):
            self._empty_box.invert(self._residual, self._correction)
            launch(_sum_products, sums.launch_shape, self._residual, self._correction, sums.parts)
            product, before = sums.sum(0), product
            share = product / before if iteration else 0.0
            launch(_turn, self._shape, self._correction, self._fluid, share, self._direction)
            args = (self._direction, *self._shares, self._centre, self._change, sums.parts)
            launch(_apply_laplacian, sums.launch_shape, *args)
            curvature = sums.sum(0)
            if not curvature < 0.0:
                return iteration
            args = (product / curvature, self._direction, self._change, pressure, self._residual, sums.parts)
            launch(_descend, sums.launch_shape, *args)
            if self._is_small(self._read_residual(), zero_guess):
                return iteration + 1
        return limit
