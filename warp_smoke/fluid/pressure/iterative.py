"""The common part of iterative pressure solvers: the operator around solids, the residual, and when to stop.

The operator weights each face by its open share w: L q = Σ a w (q_neighbour − q), with a = 1 between cells, also across
periodic sides, and a = 2 on an open side, where q = 0 outside. Padded pressures have a layer of zeros around the cells,
or of ghosts beyond periodic sides.
"""

from abc import ABC, abstractmethod
from math import isfinite, nan, prod, sqrt
from typing import NamedTuple

import numpy as np
import warp as wp

from warp_smoke.fluid.grid import Box, ghost_samples
from warp_smoke.fluid.halo import copy_samples
from warp_smoke.fluid.operators import face_weight, side_weights
from warp_smoke.fluid.pressure.components import ClosedComponents
from warp_smoke.fluid.pressure.status import PressureProblem, PressureStatus
from warp_smoke.fluid.pressure.sums import Sums, add_residual, clear_part, dense_parts
from warp_smoke.fluid.solid_faces import open_faces
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})

# Residual due to round-off for a pressure of 1: at most 12 half ulps from storing it and 22 from summing L q.
_ROUND_OFF = 34 * 2.0**-24


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
    """Sets q = fluid q, and copies it into the padded array, inside a layer of zeros."""
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
def laplacian(
    padded: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    centre: wp.array3d[float],
    i: int,
    j: int,
    k: int,
):
    """Returns Σ w q_neighbour − centre q, with q padded by a layer of zeros, so that sides need no branch."""
    q = dense(padded)
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    middle = dense(centre)
    along_i = ox[i, j, k] * q[i, j + 1, k + 1] + ox[i + 1, j, k] * q[i + 2, j + 1, k + 1]
    along_j = oy[i, j, k] * q[i + 1, j, k + 1] + oy[i, j + 1, k] * q[i + 1, j + 2, k + 1]
    along_k = oz[i, j, k] * q[i + 1, j + 1, k] + oz[i, j, k + 1] * q[i + 1, j + 1, k + 2]
    return along_i + along_j + along_k - middle[i, j, k] * q[i + 1, j + 1, k + 1]


@wp.kernel
def _measure_residual(
    rows: Rows,
    padded: wp.array3d[float],
    divergence: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    centre: wp.array3d[float],
    border: int,
    residual_out: wp.array3d[float],
    parts_out: wp.array3d[wp.float64],
):
    """Sets r = d − L q, where r has `border` layers below; parts of Σ r², max |r| and max |q|."""
    i, _, c = wp.tid()
    i += rows.first
    p = dense(padded)
    d = dense(divergence)
    r = dense(residual_out)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, divergence.shape[2])
    clear_part(parts, 0, i, start, end)
    clear_part(parts, 1, i, start, end)
    clear_part(parts, 2, i, start, end)
    b = wp.max(border, 0)
    j = wp.int32(0)
    while j < divergence.shape[1]:
        k = start
        while k < end:
            value = d[i, j, k] - laplacian(padded, wx, wy, wz, centre, i, j, k)
            r[i + b, j + b, k + b] = value
            add_residual(parts, 0, i, k, value)
            parts[2, i, k] = wp.max(parts[2, i, k], wp.float64(wp.abs(p[i + 1, j + 1, k + 1])))
            k += 1
        j += 1


@wp.kernel
def _measure_field(rows: Rows, a: wp.array3d[float], parts_out: wp.array3d[wp.float64]):
    """Computes the parts of Σ a² and max |a|."""
    i, _, c = wp.tid()
    i += rows.first
    x = dense(a)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, a.shape[2])
    clear_part(parts, 0, i, start, end)
    clear_part(parts, 1, i, start, end)
    j = wp.int32(0)
    while j < a.shape[1]:
        k = start
        while k < end:
            add_residual(parts, 0, i, k, x[i, j, k])
            k += 1
        j += 1


class FaceWeights(NamedTuple):
    """The weights of the operator.

    Attributes:
        shares: w of the faces, [nx+1, ny, nz], [nx, ny+1, nz], [nx, ny, nz+1].
        centre: Σ a w of each cell, [nx, ny, nz].
    """

    shares: tuple[wp.array, wp.array, wp.array]
    centre: wp.array


class Residual(NamedTuple):
    """Largest absolute value and 2-norm of a residual, and the largest absolute pressure when it was measured."""

    largest: float
    norm: float
    pressure: float


class IterativePressure(ABC):
    """A solver for a box with solids (or without, for comparison) that improves a pressure iteratively.

    The net divergence of closed components of fluid is left out, and the mean of their pressure is 0.
    """

    def __init__(self, launcher: Launcher, problem: PressureProblem, residual: wp.array, border: int):
        """Allocates; what depends on the solids is prepared whenever they have changed.

        Args:
            launcher: where it runs.
            problem: the problem to solve.
            residual: array for the residual.
            border: layers that this array has below the first cell.
        """
        self._launcher, self._problem = launcher, problem
        shape, solids = problem.shape, problem.solids
        self._residual, self._border = residual, border
        self._source = launcher.zeros(shape, "pressure")
        self._padded = launcher.zeros(tuple(n + 2 for n in shape), "pressure")
        layers = tuple(int(side == "periodic") for side in problem.sides[0::2])
        self._ghosts = ghost_samples(self._padded.shape, layers)
        self._sums = Sums(launcher, shape, 3, "pressure")
        centre = launcher.zeros(shape, "pressure")
        self._prepared_for = None  # `solids.changes` at that time
        self._seen = None  # cells and faces at that time, on the host
        if solids is None:
            self._fluid = launcher.zeros(shape, "pressure")
            self._fluid.fill_(1.0)
            shares = tuple(
                launcher.zeros(tuple(n + (axis == along) for axis, n in enumerate(shape)), "pressure")
                for along in range(3)
            )
            open_faces(launcher, self._fluid, problem.sides, shares)
            self._operator = FaceWeights(shares, centre)
        else:
            self._fluid = solids.fluid
            self._operator = FaceWeights((solids.wx, solids.wy, solids.wz), centre)
        self._components = ClosedComponents(launcher, problem.sides, self._fluid)

    def solve(self, divergence: wp.array, pressure: wp.array) -> PressureStatus:
        """Solves Σ (q_neighbour − q) = d over the open faces of fluid cells.

        Args:
            divergence: d, [nx, ny, nz] [m/s], 0 in solid cells.
            pressure: q = dt p / h, [nx, ny, nz] [m/s]: the first guess, replaced by the solution; 0 in solid cells.
        """
        solids = self._problem.solids
        changes = solids.changes if solids else 0
        if self._prepared_for != changes:
            if self._sees_change():
                self._prepare()
            self._prepared_for = changes
        zero_guess = self._measure(divergence)
        if zero_guess.norm == 0.0:
            pressure.zero_()
            return PressureStatus(iterations=0, max_residual=0.0, rms_residual=0.0, converged=True)
        if not isfinite(zero_guess.norm):
            return PressureStatus(iterations=0, max_residual=nan, rms_residual=nan, converged=False)
        wp.copy(self._source, divergence)
        imbalance = self._components.remove_means(self._source)
        iterations, residual = self._improve(pressure, self._restart(pressure), zero_guess)
        self._components.remove_means(pressure)
        return PressureStatus(
            iterations=iterations,
            max_residual=residual.largest / zero_guess.largest,
            rms_residual=residual.norm / zero_guess.norm,
            converged=self._is_small(residual, zero_guess),
            imbalance=imbalance,
        )

    @abstractmethod
    def _improve(self, pressure: wp.array, residual: Residual, zero_guess: Residual) -> tuple[int, Residual]:
        """Iterates until the residual is small or `max_iterations` are done; returns their number and the residual."""

    def _sees_change(self) -> bool:
        """Returns whether any cell or face has changed since the last call: solids may move without such a change."""
        now = [array.numpy() for array in (self._fluid, *self._operator.shares)]
        if self._seen is not None and all(map(np.array_equal, now, self._seen)):
            return False
        self._seen = [array.copy() for array in now]
        return True

    def _prepare(self) -> None:
        """Updates what depends on the positions of the solids."""
        args = (*self._operator.shares, *side_weights(self._problem.sides), self._operator.centre)
        self._launcher.launch(_sum_weights, self._problem.shape, *args)
        solids = self._problem.solids
        nothing = Box((0, 0, 0), (1, 1, 1))  # any fluid cell will do
        self._components.find(self._operator.shares, (solids.box if solids else None) or nothing)

    def _measure(self, field: wp.array) -> Residual:
        """Measures a field as the residual of zero pressure."""
        self._launcher.launch(_measure_field, self._sums.launch_shape, field, self._sums.parts)
        return Residual(self._sums.largest(1), sqrt(self._sums.sum(0)), 0.0)

    def _restart(self, pressure: wp.array) -> Residual:
        """Pads a pressure and measures its true residual, from which iterations continue."""
        self._launcher.launch(_start, self._problem.shape, self._fluid, pressure, self._padded)
        self._fill_ghosts()
        operator = (*self._operator.shares, self._operator.centre)
        args = (self._padded, self._source, *operator, self._border, self._residual, self._sums.parts)
        self._launcher.launch(_measure_residual, self._sums.launch_shape, *args)
        return self._read_residual()

    def _fill_ghosts(self) -> None:
        """Fills the ghosts of the padded pressure beyond periodic sides."""
        copy_samples(self._launcher, self._ghosts, self._padded, self._padded)

    def _read_residual(self) -> Residual:
        return Residual(self._sums.largest(1), sqrt(self._sums.sum(0)), self._sums.largest(2))

    def _is_small(self, residual: Residual, zero_guess: Residual) -> bool:
        tolerance, round_off = self._problem.tolerance, _ROUND_OFF * residual.pressure
        return residual.largest <= max(tolerance * zero_guess.largest, round_off) and residual.norm <= max(
            tolerance * zero_guess.norm, round_off * sqrt(prod(self._problem.shape))
        )
