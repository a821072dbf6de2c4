"""Levels of a multigrid V-cycle on the grid: sizes, face weights, and the walls in them.

Every level has the operator L e = Σ w (e_neighbour − e) with a weight for each face, and e = 0 in layers of cells
around it. Cell n of an axis is at index n + 1 of the arrays, and so is the face below it.
"""

from math import prod
from typing import NamedTuple

import numpy as np
import warp as wp

from warp_smoke.fluid.grid import Patch, ghost_samples, make_patch
from warp_smoke.fluid.halo import copy_samples, last_faces
from warp_smoke.fluid.operators import side_weights
from warp_smoke.fluid.pressure.iterative import FaceWeights
from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})

# This many cells beside walls, as a share of a slice through the box, hardly matter to a preconditioner. Thus a ball,
# which crosses a few faces without filling half of a cell beside them, needs no weights.
_FEW_WALLS = 0.01
# Levels with no more cells than this are solved directly.
FEW_CELLS = 128
_UNITS = np.eye(3, dtype=int)
_EightInts = wp.types.vector(length=8, dtype=wp.int32)

_Shape = tuple[int, int, int]
_Weights = tuple[wp.array, wp.array, wp.array]


@wp.kernel
def _copy_weights(
    rows: Rows,
    share: wp.array3d[float],
    along: wp.vec3i,
    lower: float,
    upper: float,
    w_out: wp.array3d[float],
):
    """Sets w = a share: a = 1 inside, `lower` and `upper` on the two sides across the axis that is 1 in `along`."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, share.shape[2])
    last = wp.dot(along, wp.vec3i(share.shape[0], share.shape[1], share.shape[2])) - 1
    while k < end:
        face = wp.dot(along, wp.vec3i(i, j, k))
        a = wp.where(face == 0, lower, wp.where(face == last, upper, 1.0))
        w_out[i + 1, j + 1, k + 1] = a * share[i, j, k]
        k += 1


@wp.kernel
def _coarsen_weights(
    rows: Rows,
    fine: wp.array3d[float],
    along: wp.vec3i,
    across: wp.vec3i,
    beside: wp.vec3i,
    last: int,
    upper: float,
    w_out: wp.array3d[float],
):
    """w_n = mean of the four fine weights on the coarse face, times `upper` on face `last`."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, w_out.shape[2] - 3 + along[2])
    while k < end:
        x = 2 * i + 1
        y = 2 * j + 1
        z = 2 * k + 1
        total = fine[x, y, z] + fine[x + across[0], y + across[1], z + across[2]]
        total += fine[x + beside[0], y + beside[1], z + beside[2]]
        total += fine[x + across[0] + beside[0], y + across[1] + beside[1], z + across[2] + beside[2]]
        face = wp.dot(along, wp.vec3i(i, j, k))
        w_out[i + 1, j + 1, k + 1] = 0.25 * wp.where(face == last, upper, 1.0) * total
        k += 1


@wp.kernel
def _invert_diagonal(
    rows: Rows,
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    inverse_out: wp.array3d[float],
):
    """Sets inverse = 1 / Σ w over the faces of a cell; 0 where all are closed."""
    i, j, c = wp.tid()
    x = i + rows.first + 1
    y = j + 1
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, inverse_out.shape[2] - 3)
    while k < end:
        z = k + 1
        total = wx[x, y, z] + wx[x + 1, y, z] + wy[x, y, z] + wy[x, y + 1, z] + wz[x, y, z] + wz[x, y, z + 1]
        inverse_out[x, y, z] = wp.where(total > 0.0, 1.0 / wp.max(total, 1.0e-6), 0.0)
        k += 1


@wp.func
def _is_wall(weight: float, inverse_a: float, inverse_b: float):
    """Returns whether a face is closed between two cells that both have open faces."""
    return weight == 0.0 and inverse_a > 0.0 and inverse_b > 0.0


@wp.kernel
def _mark_walls(
    rows: Rows,
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    inverse: wp.array3d[float],
    wall_out: wp.array3d[float],
):
    """Sets wall = 1 for a cell with a wall on its lower side along any axis."""
    i, j, c = wp.tid()
    x = i + rows.first + 1
    y = j + 1
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, inverse.shape[2] - 3)
    while k < end:
        z = k + 1
        m = inverse[x, y, z]
        wall = wp.float32(0.0)
        if (
            _is_wall(wx[x, y, z], m, inverse[x - 1, y, z])
            or _is_wall(wy[x, y, z], m, inverse[x, y - 1, z])
            or _is_wall(wz[x, y, z], m, inverse[x, y, z - 1])
        ):
            wall = 1.0
        wall_out[x - 1, y - 1, k] = wall
        k += 1


@wp.kernel
def _open_walls(
    rows: Rows,
    inverse: wp.array3d[float],
    wx_inout: wp.array3d[float],
    wy_inout: wp.array3d[float],
    wz_inout: wp.array3d[float],
):
    """Sets w = 1 on walls."""
    i, j, c = wp.tid()
    x = i + rows.first + 1
    y = j + 1
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, inverse.shape[2] - 3)
    while k < end:
        z = k + 1
        m = inverse[x, y, z]
        if _is_wall(wx_inout[x, y, z], m, inverse[x - 1, y, z]):
            wx_inout[x, y, z] = 1.0
        if _is_wall(wy_inout[x, y, z], m, inverse[x, y - 1, z]):
            wy_inout[x, y, z] = 1.0
        if _is_wall(wz_inout[x, y, z], m, inverse[x, y, z - 1]):
            wz_inout[x, y, z] = 1.0
        k += 1


@wp.kernel
def _mark_split(
    rows: Rows,
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    inverse: wp.array3d[float],
    split_out: wp.array3d[float],
):
    """Sets split = 1 for a 2 × 2 × 2 block whose fluid cells are not all connected inside it."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, (inverse.shape[2] - 2) / 2)
    while k < end:
        x = 2 * i + 1
        y = 2 * j + 1
        z = 2 * k + 1
        cells = wp.int32(0)
        links = _EightInts()
        for n in range(8):
            a = n // 4
            b = n // 2 % 2
            g = n % 2
            if inverse[x + a, y + b, z + g] > 0.0:
                cells += 1 << n
            if wx[x + 1, y + b, z + g] > 0.0:
                links[n] = links[n] | (1 << (n ^ 4))
            if wy[x + a, y + 1, z + g] > 0.0:
                links[n] = links[n] | (1 << (n ^ 2))
            if wz[x + a, y + b, z + 1] > 0.0:
                links[n] = links[n] | (1 << (n ^ 1))
        reached = cells & -cells
        for _ in range(7):
            for n in range(8):
                if (reached >> n) & 1 == 1:
                    reached = reached | links[n]
        split_out[i, j, k] = wp.where(reached == cells, 0.0, 1.0)
        k += 1


class Level(NamedTuple):
    """Arrays of a level, with a layer of zeros below and two above, so that odd sizes have complete 2 × 2 × 2 blocks.

    Attributes:
        shape: cells along each axis.
        inverse: 1 / Σ w of each cell.
        source: d.
        e, other: the correction, before and after a sweep.
        weights: w across x, y and z; None on a finest level without walls between its cells, which needs none.
        ghosts: the cells beyond periodic sides, which repeat those at the other end.
    """

    shape: _Shape
    inverse: wp.array
    source: wp.array
    e: wp.array
    other: wp.array
    weights: _Weights | None
    ghosts: list[Patch]


def level_shapes(shape: _Shape, sides: tuple[str, ...]) -> list[_Shape]:
    """Returns the number of cells along each axis on each level.

    A coarse cell may extend beyond a closed side, as if into a solid. The p = 0 of an open side is half a coarse cell
    from the last centre or farther, up to 1½. Along periodic axes an odd number of cells is not coarsened further.
    """
    shapes = [shape]
    while prod(shapes[-1]) > FEW_CELLS and not _is_odd_ring(shapes[-1], sides):
        coarse = tuple(n // 2 if sides[2 * axis + 1] == "open" else (n + 1) // 2 for axis, n in enumerate(shapes[-1]))
        if 0 in coarse:
            break
        shapes.append(coarse)
    return shapes


def _is_odd_ring(shape: _Shape, sides: tuple[str, ...]) -> bool:
    """Returns whether the cells along a periodic axis cannot be paired, or would become one."""
    return any(side == "periodic" and (n % 2 or n == 2) for n, side in zip(shape, sides[0::2], strict=True))


class GridLevels:
    """All levels.

    Attributes:
        levels: the levels, finest first.
        ends_early: whether the last level is not small, because cells along a periodic axis cannot be paired.
    """

    def __init__(self, launcher: Launcher, shape: _Shape, sides: tuple[str, ...]):
        """Allocates; `prepare` takes the solids into account.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz).
            sides: open, closed or periodic for each of -x +x -y +y -z +z.
        """
        self._launcher, self._sides = launcher, sides
        self.levels = []
        layers = tuple(int(side == "periodic") for side in sides[0::2])
        for number, cells in enumerate(level_shapes(shape, sides)):
            arrays = [self._zeros(cells) for _ in range(4)]
            ghosts = ghost_samples(tuple(n + 2 for n in cells), layers)
            self.levels.append(Level(cells, *arrays, self._faces(cells) if number else None, ghosts))
        last = self.levels[-1].shape
        self.ends_early = prod(last) > FEW_CELLS and _is_odd_ring(last, sides)
        self._finest_weights = None  # allocated when they are needed
        self._marks = launcher.zeros(shape, "pressure")

    def _zeros(self, cells: _Shape) -> wp.array:
        return self._launcher.zeros(tuple(n + 3 for n in cells), "pressure")

    def _faces(self, cells: _Shape) -> _Weights:
        return tuple(self._zeros(cells) for _ in range(3))

    def prepare(self, operator: FaceWeights) -> None:
        """Sets the weights from the operator, whose faces are fully open or closed; few walls are treated as open."""
        finest = self.levels[0]
        # Without walls the finest level needs its weights only here, so they borrow its work arrays.
        borrowed = (finest.source, finest.e, finest.other)
        weights = self._finest_weights or borrowed
        self._copy_weights(operator, weights)
        self._launcher.launch(_invert_diagonal, finest.shape, *weights, finest.inverse)
        copy_samples(self._launcher, finest.ghosts, finest.inverse, finest.inverse)
        walls = self._mark(_mark_walls, finest._replace(weights=weights), finest.shape)
        direct = len(self.levels) == 1
        few = walls <= _FEW_WALLS * prod(finest.shape) ** (2 / 3)
        if walls and few and not direct:
            self._launcher.launch(_open_walls, finest.shape, finest.inverse, *weights)
            self._join_seams(finest.shape, weights)
            self._launcher.launch(_invert_diagonal, finest.shape, *weights, finest.inverse)
        needed = direct or not few  # the direct solver reads them
        if needed and self._finest_weights is None:
            weights = self._finest_weights = self._faces(finest.shape)
            self._copy_weights(operator, weights)
        self.levels[0] = finest._replace(weights=weights if needed else None)
        for number, coarse in enumerate(self.levels[1:], 1):
            for axis, fine in enumerate(weights):
                turned = (wp.vec3i(*_UNITS[(axis + turn) % 3]) for turn in range(3))
                faces = tuple(n + (axis == along) for along, n in enumerate(coarse.shape))
                args = (fine, *turned, coarse.shape[axis], self._upper_factor(number, axis), coarse.weights[axis])
                self._launcher.launch(_coarsen_weights, faces, *args)
            self._launcher.launch(_invert_diagonal, coarse.shape, *coarse.weights, coarse.inverse)
            copy_samples(self._launcher, coarse.ghosts, coarse.inverse, coarse.inverse)
            weights = coarse.weights
        for array in borrowed:
            array.zero_()

    def count_split(self, number: int) -> int:
        """Counts the 2 × 2 × 2 blocks that walls split on a level; 0 on a finest level without walls."""
        level = self.levels[number]
        if level.weights is None:
            return 0
        return self._mark(_mark_split, level, self.levels[number + 1].shape)

    def _copy_weights(self, operator: FaceWeights, weights_out: _Weights) -> None:
        lower, upper = side_weights(self._sides)
        for axis, (share, weights) in enumerate(zip(operator.shares, weights_out, strict=True)):
            args = (share, wp.vec3i(*_UNITS[axis]), lower[axis], upper[axis], weights)
            self._launcher.launch(_copy_weights, share.shape, *args)

    def _join_seams(self, shape: _Shape, weights: _Weights) -> None:
        """Gives the last faces of periodic axes the weights of the first, which are the same faces."""
        for axis, w in enumerate(weights):
            if self._sides[2 * axis] == "periodic":
                last = last_faces(shape, axis)
                first = tuple(n + 1 for n in last.block.first)
                copy_samples(self._launcher, [make_patch(first, last.shape, *(2 * (last.block.before,)))], w, w)

    def _mark(self, kernel: wp.Kernel, level: Level, shape: _Shape) -> int:
        """Counts the cells, or blocks of cells, that a kernel marks on a level."""
        self._launcher.launch(kernel, shape, *level.weights, level.inverse, self._marks)
        return int(np.count_nonzero(self._marks.numpy()[: shape[0], : shape[1], : shape[2]]))

    def _upper_factor(self, number: int, axis: int) -> float:
        """Returns the weight of the upper side on a level relative to that of the fine face in its place."""
        if self._sides[2 * axis + 1] != "open":
            return 1.0
        n = self.levels[0].shape[axis]

        def distance(of: int) -> float:
            """Returns the distance from the last centre to the side [cells of that level]."""
            return n / 2**of - self.levels[of].shape[axis] + 0.5

        even = self.levels[number - 1].shape[axis] % 2 == 0
        return (distance(number - 1) if even else 1.0) / distance(number)
