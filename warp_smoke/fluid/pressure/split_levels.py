"""Coarse levels on which a cell divided by walls becomes several cells, one for each piece.

A coarse cell with a wall through it would couple the pressures on both sides, far too stiffly. So each connected part
of the cells of a 2 × 2 × 2 block makes up a coarse cell (C. Dick, M. Rogowsky, R. Westermann, 2015). Such levels are
lists of cells with sparse matrices stored by rows.
"""

import numpy as np
import scipy.sparse
import warp as wp

from warp_smoke.fluid.pressure.levels import FEW_CELLS
from warp_smoke.fluid.pressure.sparse import Graph, coarsen, find_members, spread_rows
from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})

# Arrays are sized in multiples of this many cells, so that moving solids seldom need new arrays and launches.
_GRAIN = 256
# Sweeps on a last level with more cells, which only thin, well-conditioned layers between open sides have.
LAST_SWEEPS = 8


@wp.func
def _row_product(first: wp.array[int], column: wp.array[int], value: wp.array[float], a: wp.array[float], n: int):
    """Returns the product of row n of a sparse matrix and a."""
    total = wp.float32(0.0)
    for m in range(first[n], first[n + 1]):
        total += value[m] * a[column[m]]
    return total


@wp.kernel
def _restrict_rows(
    rows: Rows,
    first: wp.array[int],
    column: wp.array[int],
    value: wp.array[float],
    residual: wp.array[float],
    inverse: wp.array[float],
    weight: float,
    source_out: wp.array[float],
    e_out: wp.array[float],
):
    """d_n = Σ value r over row n; first sweep from e = 0: e = −weight d / Σ w."""
    n = rows.first + wp.tid()
    total = _row_product(first, column, value, residual, n)
    source_out[n] = total
    e_out[n] = -weight * inverse[n] * total


@wp.kernel
def _sweep_rows(
    rows: Rows,
    first: wp.array[int],
    column: wp.array[int],
    value: wp.array[float],
    inverse: wp.array[float],
    e: wp.array[float],
    source: wp.array[float],
    weight: float,
    e_out: wp.array[float],
):
    """e_out = (1 − weight) e + weight (Σ w e_neighbour − d) / Σ w."""
    n = rows.first + wp.tid()
    total = _row_product(first, column, value, e, n)
    e_out[n] = (1.0 - weight) * e[n] + weight * inverse[n] * (total - source[n])


@wp.kernel
def _measure_rows(
    rows: Rows,
    first: wp.array[int],
    column: wp.array[int],
    value: wp.array[float],
    inverse: wp.array[float],
    e: wp.array[float],
    source: wp.array[float],
    residual_out: wp.array[float],
):
    """Sets r = d − L e, 0 where the cell has no open face."""
    n = rows.first + wp.tid()
    total = _row_product(first, column, value, e, n)
    r = source[n] - total + e[n] / wp.max(inverse[n], 1.0e-6)
    residual_out[n] = wp.where(inverse[n] > 0.0, r, 0.0)


@wp.kernel
def _prolong_rows(
    rows: Rows,
    first: wp.array[int],
    column: wp.array[int],
    value: wp.array[float],
    coarse: wp.array[float],
    e: wp.array[float],
    e_out: wp.array[float],
):
    """e_out_n = e_n + Σ value E over row n."""
    n = rows.first + wp.tid()
    total = _row_product(first, column, value, coarse, n)
    e_out[n] = e[n] + total


@wp.kernel
def _solve_rows(rows: Rows, inverse: wp.array2d[float], source: wp.array[float], e_out: wp.array[float]):
    """Sets e = L⁺ d."""
    n = rows.first + wp.tid()
    total = wp.float32(0.0)
    for m in range(inverse.shape[1]):
        total += inverse[n, m] * source[m]
    e_out[n] = total


class _Sparse:
    """A sparse matrix stored by rows on the device, with spare capacity for changes."""

    def __init__(self, launcher: Launcher):
        self._launcher = launcher
        self.first, self.column = (launcher.zeros(0, "pressure", int) for _ in range(2))
        self.value = launcher.zeros(0, "pressure")

    def assign(self, matrix: scipy.sparse.csr_array, count: int) -> None:
        """Copies a matrix, padded with empty rows to `count` rows."""
        entries = _rounded(matrix.nnz)
        if count + 1 > self.first.size:
            self.first = self._launcher.zeros(count + 1, "pressure", int)
        if entries > self.column.size:
            self.column = self._launcher.zeros(entries, "pressure", int)
            self.value = self._launcher.zeros(entries, "pressure")
        first = np.full(self.first.size, matrix.nnz, np.int32)
        first[: len(matrix.indptr)] = matrix.indptr
        self.first.assign(first)
        self.column[: matrix.nnz].assign(matrix.indices.astype(np.int32))
        self.value[: matrix.nnz].assign(matrix.data.astype(np.float32))

    @property
    def arrays(self) -> tuple[wp.array, wp.array, wp.array]:
        """First entry of each row, columns, values."""
        return self.first, self.column, self.value


class _List:
    """A level: its operator, its work arrays, and restriction from and prolongation to the next finer level."""

    def __init__(self, launcher: Launcher):
        self._launcher = launcher
        self.size = 0
        self.neighbours, self.restriction, self.prolongation = (_Sparse(launcher) for _ in range(3))
        self.fine_size = 0
        self._allocate()

    def _allocate(self) -> None:
        arrays = (self._launcher.zeros(self.size, "pressure") for _ in range(4))
        self.inverse, self.source, self.e, self.other = arrays

    def assign(self, graph: Graph, prolongation: scipy.sparse.csr_array) -> None:
        """Copies L of this level and the prolongation to the finer one."""
        diagonal = graph.diagonal()
        size = _rounded(len(diagonal))
        self.fine_size = prolongation.shape[0]
        if size > self.inverse.size:
            self.size = size
            self._allocate()
        self.size = size
        inverse = np.zeros(self.inverse.size, np.float32)
        inverse[: len(diagonal)] = np.divide(1.0, diagonal, where=diagonal > 0, out=np.zeros(len(diagonal)))
        self.inverse.assign(inverse)
        self.neighbours.assign(graph.neighbours(), size)
        self.restriction.assign((0.5 * prolongation.T).tocsr(), size)
        self.prolongation.assign(prolongation, self.fine_size)


class SplitLevels:
    """Corrects a level by coarser ones whose cells are connected."""

    def __init__(self, launcher: Launcher, weights: tuple[float, float]):
        """Allocates what does not depend on the solids.

        Args:
            launcher: where it runs.
            weights: weights of the two sweeps.
        """
        self._launcher, self._weights = launcher, weights
        self._lists: list[_List] = []
        self._count = 0
        self._direct = None  # L⁺ of the last level

    def prepare(self, graph: Graph, place: np.ndarray, room: int) -> None:
        """Makes the levels below a level.

        Args:
            graph: the operator of that level.
            place: indices of its cells in its arrays, ascending.
            room: size of these arrays.
        """
        self._count = 0
        while True:
            cells = np.count_nonzero(graph.diagonal())
            if self._count and cells <= FEW_CELLS:
                break
            members = find_members(graph)
            coarse_cells = members.max(initial=-1) + 1
            if coarse_cells == 0 or coarse_cells > 0.8 * cells:
                break
            graph, prolongation = coarsen(graph, members)
            if self._count == 0:
                prolongation = spread_rows(prolongation, place, room)
            if self._count == len(self._lists):
                self._lists.append(_List(self._launcher))
            self._lists[self._count].assign(graph, prolongation)
            self._count += 1
        size = len(graph.outside)
        self._solvable = 0 < size <= _GRAIN
        if self._solvable and self._count:
            if self._direct is None:
                self._direct = self._launcher.zeros((_GRAIN, _GRAIN), "pressure")
            padded = np.zeros((_GRAIN, _GRAIN), np.float32)
            padded[:size, :size] = graph.inverse()
            self._direct.assign(padded)

    def correct(self, residual: wp.array, e: wp.array, e_out: wp.array) -> None:
        """Sets e_out = e + the correction for a residual; all [n]."""
        launch = self._launcher.launch_each
        lists, (weak, strong) = self._lists[: self._count], self._weights
        if not lists:
            wp.copy(e_out, e)
            return
        for number, level in enumerate(lists):
            args = (*level.restriction.arrays, residual, level.inverse, weak, level.source, level.e)
            launch(_restrict_rows, level.size, *args)
            if number + 1 == len(lists):
                break
            self._sweep(level, level.e, strong, level.other)
            args = (*level.neighbours.arrays, level.inverse, level.other, level.source, level.e)
            launch(_measure_rows, level.size, *args)
            residual = level.e
        last = lists[-1]
        if self._solvable:
            launch(_solve_rows, last.size, self._direct, last.source, last.e)
        else:
            for _ in range(LAST_SWEEPS):
                self._sweep(last, last.e, strong, last.other)
                self._sweep(last, last.other, weak, last.e)
        for level, coarse in zip(lists[-2::-1], lists[:0:-1], strict=True):
            launch(_prolong_rows, coarse.fine_size, *coarse.prolongation.arrays, coarse.e, level.other, level.e)
            self._sweep(level, level.e, strong, level.other)
            self._sweep(level, level.other, weak, level.e)
        launch(_prolong_rows, lists[0].fine_size, *lists[0].prolongation.arrays, lists[0].e, e, e_out)

    def _sweep(self, level: _List, e: wp.array, weight: float, e_out: wp.array) -> None:
        args = (*level.neighbours.arrays, level.inverse, e, level.source, weight, e_out)
        self._launcher.launch_each(_sweep_rows, level.size, *args)


def _rounded(count: int) -> int:
    return -(-count // _GRAIN) * _GRAIN
