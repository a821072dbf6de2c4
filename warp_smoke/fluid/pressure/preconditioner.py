"""Preconditioners for conjugate gradients: their interface, and the two that are not multigrid."""

from typing import Protocol

import warp as wp

from warp_smoke.fluid.pressure.iterative import FaceWeights
from warp_smoke.fluid.pressure.spectral import SpectralPressure
from warp_smoke.fluid.pressure.sums import Sums, add_product, clear_part, dense_parts
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})


class Preconditioner(Protocol):
    """A symmetric approximate inverse of the operator.

    Attributes:
        residual: r, to which it is applied [m/s], 0 in solid cells.
        correction: the last result; only fluid cells are used.
        border: layers that both arrays have below the first cell.
    """

    residual: wp.array
    correction: wp.array
    border: int

    def prepare(self, operator: FaceWeights) -> None:
        """Prepares for the operator; called again whenever it has changed."""

    def apply(self) -> float:
        """Sets correction ≈ L⁻¹ r; returns Σ r correction."""


@wp.kernel
def _divide(
    rows: Rows,
    residual: wp.array3d[float],
    centre: wp.array3d[float],
    correction_out: wp.array3d[float],
    parts_out: wp.array3d[wp.float64],
):
    """Sets z = −r / Σ a w, 0 where all faces are closed; parts of Σ r z."""
    i, _, c = wp.tid()
    i += rows.first
    r = dense(residual)
    middle = dense(centre)
    z = dense(correction_out)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, residual.shape[2])
    clear_part(parts, 0, i, start, end)
    j = wp.int32(0)
    while j < residual.shape[1]:
        k = start
        while k < end:
            total = middle[i, j, k]
            value = wp.where(total > 0.0, -r[i, j, k] / wp.max(total, 1.0e-6), 0.0)
            z[i, j, k] = value
            add_product(parts, i, k, r[i, j, k], value)
            k += 1
        j += 1


@wp.kernel
def _sum_products(
    rows: Rows,
    a: wp.array3d[float],
    b: wp.array3d[float],
    border: int,
    cells: int,
    parts_out: wp.array3d[wp.float64],
):
    """Computes the parts of Σ a b over `cells` cells along j, above `border` layers that are skipped."""
    i, _, c = wp.tid()
    i += rows.first
    f = dense(a)
    g = dense(b)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, parts_out.shape[2])
    clear_part(parts, 0, i, start, end)
    low = wp.max(border, 0)
    j = wp.int32(0)
    while j < cells:
        k = start
        while k < end:
            add_product(parts, i, k, f[i + low, j + low, k + low], g[i + low, j + low, k + low])
            k += 1
        j += 1


def sum_products(launcher: Launcher, a: wp.array, b: wp.array, border: int, sums: Sums) -> None:
    """Sums a b over the cells of `sums`, below which both arrays have `border` layers."""
    launcher.launch(_sum_products, sums.launch_shape, a, b, border, sums.shape[1], sums.parts)


class Diagonal:
    """The inverse of the diagonal (C. G. J. Jacobi)."""

    border = 0

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int]):
        """Allocates for (nx, ny, nz) cells."""
        self._launcher = launcher
        self.residual, self.correction = (launcher.zeros(shape, "pressure") for _ in range(2))
        self._sums = Sums(launcher, shape, 1, "pressure")

    def prepare(self, operator: FaceWeights) -> None:
        """Prepares for the operator."""
        self._centre = operator.centre

    def apply(self) -> float:
        """Sets correction = −r / Σ a w; returns Σ r correction."""
        args = (self.residual, self._centre, self.correction, self._sums.parts)
        self._launcher.launch(_divide, self._sums.launch_shape, *args)
        return self._sums.sum(0)


class EmptyBox:
    """The exact solver of the box without its solids (P. Concus, G. H. Golub, 1973)."""

    border = 0

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], sides: tuple[str, ...]):
        """Allocates for (nx, ny, nz) cells between sides -x +x -y +y -z +z."""
        self._launcher = launcher
        self._solver = SpectralPressure(launcher, shape, sides)
        self.residual, self.correction = (launcher.zeros(shape, "pressure") for _ in range(2))
        self._sums = Sums(launcher, shape, 1, "pressure")

    def prepare(self, operator: FaceWeights) -> None:
        """Does nothing: the solids are ignored."""

    def apply(self) -> float:
        """Sets correction to the pressure of a box without solids; returns Σ r correction."""
        self._solver.invert(self.residual, self.correction)
        sum_products(self._launcher, self.residual, self.correction, self.border, self._sums)
        return self._sums.sum(0)
