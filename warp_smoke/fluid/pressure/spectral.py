"""Exact pressure in an empty box: sine and cosine transforms along k and j, a tridiagonal solve along i.

The modes are those of `fluid/transforms.py`: pressure is 0 on open sides (odd) and has slope 0 on closed ones (even).
Periodic axes have Hartley's modes; if i is periodic, it is transformed too, and each mode divided by its eigenvalue.
"""

from math import isfinite, sqrt

import numpy as np
import warp as wp

from warp_smoke.fluid.operators import side_weights
from warp_smoke.fluid.pressure.status import PressureStatus
from warp_smoke.fluid.pressure.sums import Sums, add_residual, clear_part, dense_parts
from warp_smoke.fluid.transforms import EVEN, ODD, PERIODIC, FastTransforms, MatrixTransforms, Modes, cell_modes
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})

_Shape = tuple[int, int, int]


@wp.kernel
def _solve_tridiagonal(rows: Rows, factor: wp.array3d[float], q_inout: wp.array3d[float]):
    """Solves −q_(i−1) + b_i q_i − q_(i+1) = −d_i (L. H. Thomas, 1949), d and then q in `q_inout`.

    With m_i = 1 / (b_i − m_(i−1)) in `factor`: f_i = m_i (f_(i−1) − d_i) upwards, q_i = f_i + m_i q_(i+1) downwards.
    """
    j, _, c = wp.tid()
    j += rows.first
    m = dense(factor)
    q = dense(q_inout)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, q_inout.shape[2])
    k = start
    while k < end:
        q[0, j, k] = -m[0, j, k] * q[0, j, k]
        k += 1
    i = wp.int32(1)
    while i < q_inout.shape[0]:
        k = start
        while k < end:
            q[i, j, k] = m[i, j, k] * (q[i - 1, j, k] - q[i, j, k])
            k += 1
        i += 1
    i = q_inout.shape[0] - 2
    while i >= 0:
        k = start
        while k < end:
            q[i, j, k] = q[i, j, k] + m[i, j, k] * q[i + 1, j, k]
            k += 1
        i -= 1


@wp.kernel
def _divide(
    rows: Rows, along_i: wp.array[float], along_j: wp.array[float], along_k: wp.array[float], q_inout: wp.array3d[float]
):
    """Division: q = −d / (λ_i + λ_j + λ_k), d and then q in `q_inout`; 0 where the sum is 0."""
    i, j, c = wp.tid()
    i += rows.first
    q = dense(q_inout)
    across = along_i[i] + along_j[j]
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, q_inout.shape[2])
    while k < end:
        total = across + along_k[k]
        q[i, j, k] = wp.where(total > 0.0, -q[i, j, k] / wp.max(total, 1.0e-12), 0.0)
        k += 1


@wp.kernel
def _remove_mean_mode(rows: Rows, modes_inout: wp.array3d[float], mean_out: wp.array[float]):
    """Subtracts from modes_i00, which hold the sums over j and k, their mean over i."""
    n = rows.first + wp.tid()
    total = wp.float64(0.0)
    for i in range(modes_inout.shape[0]):
        total += wp.float64(modes_inout[i, 0, 0])
    mean = wp.float32(total / wp.float64(modes_inout.shape[0]))
    for i in range(modes_inout.shape[0]):
        modes_inout[i, 0, 0] = modes_inout[i, 0, 0] - mean
    mean_out[n] = mean


@wp.kernel
def _sum_residual(
    rows: Rows,
    divergence: wp.array3d[float],
    imbalance: float,
    pressure: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    parts_out: wp.array3d[wp.float64],
):
    """Computes the parts of Σ d², max |d|, Σ r² and max |r|, with r = d − imbalance − L q."""
    i, _, c = wp.tid()
    i += rows.first
    nx = pressure.shape[0]
    ny = pressure.shape[1]
    nz = pressure.shape[2]
    d = dense(divergence)
    q = dense(pressure)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, nz)
    clear_part(parts, 0, i, start, end)
    clear_part(parts, 1, i, start, end)
    clear_part(parts, 2, i, start, end)
    clear_part(parts, 3, i, start, end)
    # Beyond sides of weight 1 is the other end of the domain; beyond those of weight 2 and 0 there is nothing.
    i_before = wp.where(i > 0, i - 1, nx - 1)
    i_after = wp.where(i < nx - 1, i + 1, 0)
    a0 = wp.where(i > 0 or lower[0] == 1.0, 1.0, 0.0)
    a1 = wp.where(i < nx - 1 or upper[0] == 1.0, 1.0, 0.0)
    centre_i = wp.where(i > 0, 1.0, lower[0]) + wp.where(i < nx - 1, 1.0, upper[0])
    j = wp.int32(0)
    while j < ny:
        j_before = wp.where(j > 0, j - 1, ny - 1)
        j_after = wp.where(j < ny - 1, j + 1, 0)
        b0 = wp.where(j > 0 or lower[1] == 1.0, 1.0, 0.0)
        b1 = wp.where(j < ny - 1 or upper[1] == 1.0, 1.0, 0.0)
        beyond_0 = wp.where(lower[2] == 1.0, q[i, j, nz - 1], 0.0)
        beyond_1 = wp.where(upper[2] == 1.0, q[i, j, 0], 0.0)
        centre_j = wp.where(j > 0, 1.0, lower[1]) + wp.where(j < ny - 1, 1.0, upper[1])
        k = start
        while k < end:
            here = q[i, j, k]
            along_i = a0 * q[i_before, j, k] + a1 * q[i_after, j, k] - centre_i * here
            along_j = b0 * q[i, j_before, k] + b1 * q[i, j_after, k] - centre_j * here
            below = wp.where(k > 0, q[i, j, wp.max(k - 1, 0)] - here, lower[2] * (beyond_0 - here))
            above = wp.where(k < nz - 1, q[i, j, wp.min(k + 1, nz - 1)] - here, upper[2] * (beyond_1 - here))
            add_residual(parts, 0, i, k, d[i, j, k])
            add_residual(parts, 2, i, k, d[i, j, k] - imbalance - (along_i + along_j + below + above))
            k += 1
        j += 1


_ENDS = {"open": ODD, "closed": EVEN, "periodic": PERIODIC}


def _modes(n: int, *sides: str) -> Modes:
    """Returns the modes along an axis of n cells: q is odd at open sides, even at closed ones, or periodic."""
    return cell_modes(n, *(_ENDS[side] for side in sides))


def eigenvalues(n: int, lower: str, upper: str) -> np.ndarray:
    """Returns λ for an axis of n cells between two sides, [n] float64: −λ q is that axis's part of L q."""
    return _modes(n, lower, upper).eigenvalues


class SpectralPressure:
    """Direct solver for a box without solids, with any mix of open, closed and periodic sides.

    In a box without open sides, the mean of the divergence is ignored and the mean of the pressure is 0.
    """

    def __init__(self, launcher: Launcher, shape: _Shape, sides: tuple[str, ...]):
        """Prepares the transforms and the factors of the tridiagonal systems.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz).
            sides: open, closed or periodic for each of -x +x -y +y -z +z.
        """
        self._launcher, self._shape, self._sides = launcher, shape, sides
        self._transforms_i = sides[0] == "periodic"
        axes = (2, 1, 0) if self._transforms_i else (2, 1)
        modes = {axis: _modes(shape[axis], *sides[2 * axis : 2 * axis + 2]) for axis in axes}
        if launcher.device.is_cpu:
            self._transforms = FastTransforms(launcher, modes)
        else:
            self._transforms = MatrixTransforms(launcher, modes, shape, "pressure")
        if self._transforms_i:
            self._eigenvalues = [
                launcher.array(modes[axis].eigenvalues.astype(np.float32), "pressure") for axis in range(3)
            ]
        else:
            self._factor = launcher.array(_tridiagonal_factor(shape, sides), "pressure")
        self._singular = "open" not in sides
        self._mean = launcher.zeros(1, "pressure")
        self._sums = Sums(launcher, shape, 4, "pressure")

    def solve(self, divergence: wp.array, pressure: wp.array) -> PressureStatus:
        """Solves Σ (q_neighbour − q) = d.

        Args:
            divergence: d, [nx, ny, nz] [m/s].
            pressure: q = dt p / h, [nx, ny, nz] [m/s], written.
        """
        imbalance = self.invert(divergence, pressure)
        args = (divergence, imbalance, pressure, *side_weights(self._sides), self._sums.parts)
        self._launcher.launch(_sum_residual, self._sums.launch_shape, *args)
        largest, square = self._sums.largest(1), self._sums.sum(0)
        max_residual = self._sums.largest(3) / largest if largest else 0.0
        rms_residual = sqrt(self._sums.sum(2) / square) if square else 0.0
        return PressureStatus(
            iterations=1,
            max_residual=max_residual,
            rms_residual=rms_residual,
            converged=isfinite(rms_residual),
            imbalance=abs(imbalance),
        )

    def invert(self, divergence: wp.array, pressure: wp.array) -> float:
        """Solves like `solve`, without measuring the residual.

        Returns:
            The mean of the divergence if it had to be ignored, else 0 [m/s].
        """
        self._transforms.forward(divergence, pressure)
        imbalance = self._remove_mean(pressure) if self._singular else 0.0
        if self._transforms_i:
            self._launcher.launch(_divide, self._shape, *self._eigenvalues, pressure)
        else:
            _, ny, nz = self._shape
            self._launcher.launch(_solve_tridiagonal, (ny, 1, nz), self._factor, pressure)
            if self._singular:
                self._remove_mean(pressure)
        self._transforms.inverse(pressure)
        return imbalance

    def _remove_mean(self, modes: wp.array) -> float:
        """Subtracts the mean from a field given by its modes, and returns the mean."""
        nx, ny, nz = self._shape
        if self._transforms_i:  # only the first mode has a mean, and `_divide` sets it to 0
            return float(modes[:1, :1, :1].numpy().item()) / sqrt(nx * ny * nz)
        self._launcher.launch_each(_remove_mean_mode, 1, modes, self._mean)
        return float(self._mean.numpy()[0]) / sqrt(ny * nz)


def _tridiagonal_factor(shape: _Shape, sides: tuple[str, ...]) -> np.ndarray:
    """Returns factor m of `_solve_tridiagonal`, [nx, ny, nz] float32; 0 for the singular pivot of a closed box."""
    nx, ny, nz = shape
    across = eigenvalues(ny, *sides[2:4])[:, None] + eigenvalues(nz, *sides[4:6])
    ends = np.zeros(nx)
    for end, side in ((0, sides[0]), (-1, sides[1])):
        ends[end] += 1.0 if side == "open" else -1.0
    factor = np.empty(shape, np.float32)
    before = np.zeros((ny, nz))
    for i in range(nx):
        pivot = 2.0 + across + ends[i] - before
        if i == nx - 1 and "open" not in sides:
            pivot[0, 0] = np.inf
        before = 1.0 / pivot
        factor[i] = before
    return factor
