"""Multigrid V-cycle as a preconditioner for the pressure around solids.

A. Brandt (1977); for smoke among solids A. McAdams, E. Sifakis, J. Teran (2010). Two Jacobi sweeps, with the weights of
a Chebyshev polynomial, precede the correction from the next level, and two in reverse order follow it; restriction is
half the transpose of prolongation, so the cycle is symmetric and definite. Below the first level on which walls split
cells, the levels are those of `split_levels`.
"""

from functools import partial
from math import prod

import numpy as np
import warp as wp

from warp_smoke.fluid.pressure.iterative import FaceWeights
from warp_smoke.fluid.pressure.levels import FEW_CELLS, GridLevels, Level
from warp_smoke.fluid.pressure.smoothing import measure, sweep, sweep_and_sum, sweep_twice
from warp_smoke.fluid.pressure.sparse import level_graph
from warp_smoke.fluid.pressure.split_levels import LAST_SWEEPS, SplitLevels
from warp_smoke.fluid.pressure.sums import Sums
from warp_smoke.fluid.pressure.transfer import prolong, restrict
from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})

# Inverse roots of the Chebyshev polynomial of degree 2 over the upper part of the spectrum of L / Σ w.
_WEAK, _STRONG = 0.5695, 1.732
_SMALL = 32768  # cells
# Blocks of the finest level that walls may split, as a share of a slice through the box.
_SPLIT_SHARE = 0.125


@wp.kernel
def _solve_directly(rows: Rows, inverse: wp.array2d[float], source: wp.array3d[float], e_out: wp.array3d[float]):
    """Sets e = L⁺ d."""
    n = rows.first + wp.tid()
    ny = source.shape[1] - 3
    nz = source.shape[2] - 3
    total = wp.float32(0.0)
    m = wp.int32(0)
    for x in range(source.shape[0] - 3):
        for y in range(ny):
            for z in range(nz):
                total += inverse[n, m] * source[x + 1, y + 1, z + 1]
                m += 1
    e_out[n / (ny * nz) + 1, n / nz % ny + 1, n % nz + 1] = total


class VCycle:
    """Approximate inverse of the pressure's operator around solids.

    Attributes:
        residual, correction: its input and result; [nx+3, ny+3, nz+3], cell (i, j, k) at (i+1, j+1, k+1).
        border: 1, the layer of zeros below.
    """

    border = 1

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], sides: tuple[str, ...]):
        """Allocates; `prepare` takes the solids into account.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz).
            sides: open, closed or periodic for each of -x +x -y +y -z +z.
        """
        # Along a periodic axis of one cell, pressure drives no flow.
        thin = [n == 1 and side == "periodic" for n, side in zip(shape, sides[0::2], strict=True)]
        sides = tuple("closed" if thin[number // 2] else side for number, side in enumerate(sides))
        self._launcher, self._sides = launcher, sides
        self._grid = GridLevels(launcher, shape, sides)
        self._levels = self._grid.levels  # those before the levels of `_split`
        self._split = None  # made when walls split a cell
        self.residual, self.correction = self._levels[0].source, self._levels[0].e
        self._sums = Sums(launcher, shape, 1, "pressure")
        sizes = [prod(level.shape) for level in self._levels]
        # Levels from here on are recorded: their sweeps take less time than launching them.
        self._first_small = next((n for n, cells in enumerate(sizes) if n and cells <= _SMALL), len(sizes))
        self._solve_small = None  # recorded when walls split no cell
        cells = sizes[-1]
        self._direct = launcher.zeros((cells, cells), "pressure") if cells <= FEW_CELLS else None

    def prepare(self, operator: FaceWeights) -> None:
        """Prepares the levels for the operator, whose faces are fully open or closed."""
        self._grid.prepare(operator)
        levels = self._grid.levels
        self._levels = levels[: self._count_unsplit()]
        last = self._levels[-1]
        self._splits = len(self._levels) < len(levels) or self._grid.ends_early
        if self._splits:
            if self._split is None:
                self._split = SplitLevels(self._launcher, (_WEAK, _STRONG))
            place = np.ravel_multi_index(np.indices(last.shape).reshape(3, -1) + 1, last.e.shape)
            self._split.prepare(level_graph(last, self._sides), place, last.e.size)
        elif self._direct is not None:
            self._direct.assign(level_graph(last, self._sides).inverse())
        if not self._splits and self._solve_small is None and self._first_small < len(levels):
            self._solve_small = self._launcher.record(partial(self._solve, self._first_small))

    def _count_unsplit(self) -> int:
        """Counts the levels down to the first with blocks that walls split.

        On the finest level, where lists of cells are expensive, a few such blocks are tolerated.
        """
        levels = self._grid.levels
        for number, coarse in enumerate(levels[1:]):
            allowed = 0 if number else _SPLIT_SHARE * prod(coarse.shape) ** (2 / 3)
            if self._grid.count_split(number) > allowed:
                return number + 1
        return len(levels)

    def apply(self) -> float:
        """Sets correction ≈ L⁻¹ r; returns Σ r correction."""
        finest = self._levels[0]
        self._solve(0)
        sweep_and_sum(self._launcher, finest, finest.other, _WEAK, finest.e, self._sums)
        return self._sums.sum(0)

    def _solve(self, number: int) -> None:
        """Solves a level except for its last sweep; the result is in `other`."""
        launcher, level = self._launcher, self._levels[number]
        if number + 1 == len(self._levels):
            self._solve_last(level)
            return
        coarse = self._levels[number + 1]
        sweep_twice(launcher, level, _WEAK, _STRONG, level.other)
        measure(launcher, level, level.other, level.e)
        restrict(launcher, level, level.e, coarse)
        if number + 1 == self._first_small and not self._splits:
            self._solve_small()
        else:
            self._solve(number + 1)
        sweep(launcher, coarse, coarse.other, _WEAK, coarse.e)
        prolong(launcher, coarse, level, level.other, level.e)
        sweep(launcher, level, level.e, _STRONG, level.other)

    def _solve_last(self, last: Level) -> None:
        """Solves the last level except for its last sweep; the result is in `other`."""
        launcher = self._launcher
        if self._splits:
            sweep_twice(launcher, last, _WEAK, _STRONG, last.other)
            measure(launcher, last, last.other, last.e)
            self._split.correct(last.e.flatten(), last.other.flatten(), last.e.flatten())
            sweep(launcher, last, last.e, _STRONG, last.other)
        elif self._direct is not None:
            launcher.launch_each(_solve_directly, self._direct.shape[0], self._direct, last.source, last.other)
        else:
            sweep_twice(launcher, last, _WEAK, _STRONG, last.other)
            for _ in range(LAST_SWEEPS):
                sweep(launcher, last, last.other, _WEAK, last.e)
                sweep(launcher, last, last.e, _STRONG, last.other)
