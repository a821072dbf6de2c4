"""One multigrid V-cycle for the pressure around solids: kernels and levels.

A. Brandt (1977); for smoke among solids A. McAdams, E. Sifakis, J. Teran (2010). Every level has the operator
L e = Σ w (e_neighbour − e) with a weight for each face, and e = 0 in a layer of cells around it. Cell n of an axis lies
at index n + 1 of the arrays, and the face below it too. Two Jacobi sweeps, weighted for Chebyshev's polynomial, come
before and two, in reverse, after the correction from the next level.
"""

from itertools import pairwise
from math import prod
from typing import NamedTuple

import numpy as np
import scipy.sparse
import warp as wp

from warp_smoke.fluid.operators import side_weights
from warp_smoke.fluid.pressure.iterative import FaceWeights
from warp_smoke.fluid.pressure.split_levels import FEW_CELLS, LAST_SWEEPS, SplitLevels, pseudo_inverse
from warp_smoke.fluid.pressure.sums import Sums, dense_parts
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})

# Roots of Chebyshev's polynomial of degree 2 over the upper part of the spectrum that the next level cannot see.
_WEAK, _STRONG = 0.5695, 1.732
_EightInts = wp.types.vector(length=8, dtype=wp.int32)
# Blocks of the finest level that may be split by walls, as a share of a slice through the box.
_SPLIT_SHARE = 0.125
_UNITS = np.eye(3, dtype=int)


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
def _neighbours(e: wp.array3d[float], x: int, y: int, z: int):
    """Σ e_neighbour: where faces are open or closed and e = 0 in solid cells, this needs no weights."""
    return e[x - 1, y, z] + e[x + 1, y, z] + e[x, y - 1, z] + e[x, y + 1, z] + e[x, y, z - 1] + e[x, y, z + 1]


@wp.func
def _weighted_neighbours(
    e: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    x: int,
    y: int,
    z: int,
):
    """Σ w e_neighbour."""
    along_x = wx[x, y, z] * e[x - 1, y, z] + wx[x + 1, y, z] * e[x + 1, y, z]
    along_y = wy[x, y, z] * e[x, y - 1, z] + wy[x, y + 1, z] * e[x, y + 1, z]
    along_z = wz[x, y, z] * e[x, y, z - 1] + wz[x, y, z + 1] * e[x, y, z + 1]
    return along_x + along_y + along_z


@wp.kernel
def _start(
    rows: Rows,
    residual: wp.array3d[float],
    inverse: wp.array3d[float],
    weight: float,
    source_out: wp.array3d[float],
    e_out: wp.array3d[float],
):
    """Copies d = r; first sweep from e = 0: e = −weight d / Σ w."""
    i, j, c = wp.tid()
    i += rows.first
    r = dense(residual)
    m = dense(inverse)
    d = dense_store(source_out)
    e = dense_store(e_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, residual.shape[2])
    while k < end:
        value = r[i, j, k]
        d[i + 1, j + 1, k + 1] = bits(value)
        e[i + 1, j + 1, k + 1] = bits(-weight * m[i + 1, j + 1, k + 1] * value)
        k += 1


@wp.kernel
def _sweep(
    rows: Rows,
    e: wp.array3d[float],
    source: wp.array3d[float],
    inverse: wp.array3d[float],
    weight: float,
    e_out: wp.array3d[float],
):
    """e_out = (1 − weight) e + weight (Σ e_neighbour − d) / Σ w."""
    i, j, c = wp.tid()
    x = i + rows.first + 1
    y = j + 1
    before = dense(e)
    d = dense(source)
    m = dense(inverse)
    after = dense_store(e_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, e.shape[2] - 3)
    while k < end:
        z = k + 1
        jacobi = m[x, y, z] * (_neighbours(before, x, y, z) - d[x, y, z])
        after[x, y, z] = bits((1.0 - weight) * before[x, y, z] + weight * jacobi)
        k += 1


@wp.kernel
def _sweep_last(
    rows: Rows,
    e: wp.array3d[float],
    source: wp.array3d[float],
    inverse: wp.array3d[float],
    weight: float,
    e_out: wp.array3d[float],
    parts_out: wp.array3d[wp.float64],
):
    """As `_sweep`; parts of Σ d e_out."""
    i, _, c = wp.tid()
    i += rows.first
    x = i + 1
    before = dense(e)
    d = dense(source)
    m = dense(inverse)
    after = dense(e_out)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, e.shape[2] - 3)
    k = start
    while k < end:
        parts[0, i, k] = wp.float64(0.0)
        k += 1
    y = wp.int32(1)
    while y < e.shape[1] - 2:
        k = start
        while k < end:
            z = k + 1
            right = d[x, y, z]
            jacobi = m[x, y, z] * (_neighbours(before, x, y, z) - right)
            value = (1.0 - weight) * before[x, y, z] + weight * jacobi
            after[x, y, z] = value
            parts[0, i, k] = parts[0, i, k] + wp.float64(right) * wp.float64(value)
            k += 1
        y += 1


@wp.kernel
def _sum_products(rows: Rows, a: wp.array3d[float], b: wp.array3d[float], parts_out: wp.array3d[wp.float64]):
    """Parts of Σ a b over the cells inside the layers of zeros."""
    i, _, c = wp.tid()
    i += rows.first
    f = dense(a)
    g = dense(b)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, a.shape[2] - 3)
    k = start
    while k < end:
        parts[0, i, k] = wp.float64(0.0)
        k += 1
    y = wp.int32(1)
    while y < a.shape[1] - 2:
        k = start
        while k < end:
            product = wp.float64(f[i + 1, y, k + 1]) * wp.float64(g[i + 1, y, k + 1])
            parts[0, i, k] = parts[0, i, k] + product
            k += 1
        y += 1


@wp.kernel
def _sweep_weighted(
    rows: Rows,
    e: wp.array3d[float],
    source: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    inverse: wp.array3d[float],
    weight: float,
    e_out: wp.array3d[float],
):
    """e_out = (1 − weight) e + weight (Σ w e_neighbour − d) / Σ w."""
    i, j, c = wp.tid()
    x = i + rows.first + 1
    y = j + 1
    before = dense(e)
    d = dense(source)
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    m = dense(inverse)
    after = dense_store(e_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, e.shape[2] - 3)
    while k < end:
        z = k + 1
        jacobi = m[x, y, z] * (_weighted_neighbours(before, ox, oy, oz, x, y, z) - d[x, y, z])
        after[x, y, z] = bits((1.0 - weight) * before[x, y, z] + weight * jacobi)
        k += 1


@wp.func
def _residual(e: wp.array3d[float], d: wp.array3d[float], m: wp.array3d[float], x: int, y: int, z: int):
    """Residual d − L e, 0 where the cell has no open face."""
    r = d[x, y, z] - _neighbours(e, x, y, z) + e[x, y, z] / wp.max(m[x, y, z], 1.0e-6)
    return wp.where(m[x, y, z] > 0.0, r, 0.0)


@wp.func
def _weighted_residual(
    e: wp.array3d[float],
    d: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    m: wp.array3d[float],
    x: int,
    y: int,
    z: int,
):
    """Residual d − L e, 0 where the cell has no open face."""
    r = d[x, y, z] - _weighted_neighbours(e, wx, wy, wz, x, y, z) + e[x, y, z] / wp.max(m[x, y, z], 1.0e-6)
    return wp.where(m[x, y, z] > 0.0, r, 0.0)


@wp.kernel
def _measure(
    rows: Rows,
    e: wp.array3d[float],
    source: wp.array3d[float],
    inverse: wp.array3d[float],
    residual_out: wp.array3d[float],
):
    """Sets r = d − L e, 0 where the cell has no open face."""
    i, j, c = wp.tid()
    x = i + rows.first + 1
    y = j + 1
    f = dense(e)
    d = dense(source)
    m = dense(inverse)
    r = dense_store(residual_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, e.shape[2] - 3)
    while k < end:
        r[x, y, k + 1] = bits(_residual(f, d, m, x, y, k + 1))
        k += 1


@wp.kernel
def _measure_weighted(
    rows: Rows,
    e: wp.array3d[float],
    source: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    inverse: wp.array3d[float],
    residual_out: wp.array3d[float],
):
    """Sets r = d − L e, 0 where the cell has no open face."""
    i, j, c = wp.tid()
    x = i + rows.first + 1
    y = j + 1
    f = dense(e)
    d = dense(source)
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    m = dense(inverse)
    r = dense_store(residual_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, e.shape[2] - 3)
    while k < end:
        r[x, y, k + 1] = bits(_weighted_residual(f, d, ox, oy, oz, m, x, y, k + 1))
        k += 1


@wp.func
def _sum_x(r: wp.array3d[float], x: int, y: int, z: int):
    """Sum over the four cells from (x, y, z) on across x."""
    return r[x, y, z] + r[x, y, z + 1] + r[x, y + 1, z] + r[x, y + 1, z + 1]


@wp.func
def _sum_y(r: wp.array3d[float], x: int, y: int, z: int):
    """Sum over the four cells from (x, y, z) on across y."""
    return r[x, y, z] + r[x, y, z + 1] + r[x + 1, y, z] + r[x + 1, y, z + 1]


@wp.func
def _sum_z(r: wp.array3d[float], x: int, y: int, z: int):
    """Sum over the four cells from (x, y, z) on across z."""
    return r[x, y, z] + r[x, y + 1, z] + r[x + 1, y, z] + r[x + 1, y + 1, z]


@wp.kernel
def _restrict(
    rows: Rows,
    residual: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    inverse: wp.array3d[float],
    weight: float,
    source_out: wp.array3d[float],
    e_out: wp.array3d[float],
):
    """On the next level, d = ½ (Σ r + ¼ Σ W (r beyond the face − r inside)); first sweep from 0 as in `_start`.

    Sums are over the eight cells of a coarse one, and over the four on either side of each of its faces: half the
    transpose of `_prolong`, so that the cycle is symmetric.
    """
    i, j, c = wp.tid()
    i += rows.first
    r = dense(residual)
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    m = dense(inverse)
    d_out = dense_store(source_out)
    first = dense_store(e_out)
    x = 2 * i + 1
    y = 2 * j + 1
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, source_out.shape[2] - 3)
    while k < end:
        z = 2 * k + 1
        lower = _sum_x(r, x, y, z)
        upper = _sum_x(r, x + 1, y, z)
        exchange = ox[i + 1, j + 1, k + 1] * (_sum_x(r, x - 1, y, z) - lower)
        exchange += ox[i + 2, j + 1, k + 1] * (_sum_x(r, x + 2, y, z) - upper)
        exchange += oy[i + 1, j + 1, k + 1] * (_sum_y(r, x, y - 1, z) - _sum_y(r, x, y, z))
        exchange += oy[i + 1, j + 2, k + 1] * (_sum_y(r, x, y + 2, z) - _sum_y(r, x, y + 1, z))
        exchange += oz[i + 1, j + 1, k + 1] * (_sum_z(r, x, y, z - 1) - _sum_z(r, x, y, z))
        exchange += oz[i + 1, j + 1, k + 2] * (_sum_z(r, x, y, z + 2) - _sum_z(r, x, y, z + 1))
        total = 0.5 * (lower + upper + 0.25 * exchange)
        d_out[i + 1, j + 1, k + 1] = bits(total)
        first[i + 1, j + 1, k + 1] = bits(-weight * m[i + 1, j + 1, k + 1] * total)
        k += 1


@wp.func
def _is_wall(weight: float, inverse_a: float, inverse_b: float):
    """Whether a closed face separates two cells that both have open ones."""
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
def _mark_split(
    rows: Rows,
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    inverse: wp.array3d[float],
    split_out: wp.array3d[float],
):
    """Sets split = 1 for a 2 × 2 × 2 block whose cells are not all connected inside it."""
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


@wp.kernel
def _prolong(
    rows: Rows,
    coarse: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    inverse: wp.array3d[float],
    e: wp.array3d[float],
    e_out: wp.array3d[float],
):
    """e_out = e + E + ¼ Σ W (E_neighbour − E), over the three neighbours of the coarse cell on this cell's side."""
    i, j, c = wp.tid()
    i += rows.first
    f = dense(coarse)
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    m = dense(inverse)
    before = dense(e)
    after = dense_store(e_out)
    x = i / 2 + 1
    y = j / 2 + 1
    side_x = i % 2
    side_y = j % 2
    neighbour_x = x - 1 + 2 * side_x
    neighbour_y = y - 1 + 2 * side_y
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, (e.shape[2] - 2) / 2)
    while k < end:
        z = k + 1
        here = f[x, y, z]
        base = here + 0.25 * ox[x + side_x, y, z] * (f[neighbour_x, y, z] - here)
        base += 0.25 * oy[x, y + side_y, z] * (f[x, neighbour_y, z] - here)
        below = base + 0.25 * oz[x, y, z] * (f[x, y, z - 1] - here)
        above = base + 0.25 * oz[x, y, z + 1] * (f[x, y, z + 1] - here)
        lower = 2 * k + 1
        after[i + 1, j + 1, lower] = bits(
            before[i + 1, j + 1, lower] + wp.where(m[i + 1, j + 1, lower] > 0.0, below, 0.0)
        )
        after[i + 1, j + 1, lower + 1] = bits(
            before[i + 1, j + 1, lower + 1] + wp.where(m[i + 1, j + 1, lower + 1] > 0.0, above, 0.0)
        )
        k += 1


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


class _Level(NamedTuple):
    """Arrays of a level, each with a layer of zeros below and two above: they cover 2 × 2 × 2 cells of odd sizes."""

    shape: tuple[int, int, int]
    inverse: wp.array
    source: wp.array
    e: wp.array
    other: wp.array
    weights: tuple[wp.array, wp.array, wp.array]


def level_shapes(shape: tuple[int, int, int], sides: tuple[str, ...]) -> list[tuple[int, int, int]]:
    """Cells along each axis on each level.

    Beyond a closed side a coarse cell may stick out, as if into a solid. An open side has its p = 0 half a coarse cell
    from the last centre or farther, up to 1 ½.
    """
    shapes = [shape]
    while prod(shapes[-1]) > FEW_CELLS:
        coarse = tuple(n // 2 if sides[2 * axis + 1] == "open" else (n + 1) // 2 for axis, n in enumerate(shapes[-1]))
        if 0 in coarse:
            break
        shapes.append(coarse)
    return shapes


class VCycle:
    """Approximate inverse of the pressure's operator around solids.

    Attributes:
        correction: its result, [nx+3, ny+3, nz+3], cell (i, j, k) at (i+1, j+1, k+1).
        border: 1, the layer of zeros below.
    """

    border = 1

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], sides: tuple[str, ...]):
        """Allocates; `prepare` takes in the solids.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz).
            sides: open or closed for each of -x +x -y +y -z +z.
        """
        self._launcher, self._sides = launcher, sides
        self._levels = []
        for number, cells in enumerate(level_shapes(shape, sides)):
            arrays = [self._zeros(cells) for _ in range(7 if number else 4)]
            # Without walls the finest level needs its weights only to prepare the others: they borrow work arrays.
            self._levels.append(_Level(cells, *arrays[:4], tuple(arrays[4:] or arrays[1:4])))
        self.correction = self._levels[0].e
        self._sums = Sums(launcher, shape, 1, "pressure")
        self._walls = False  # between cells of the finest level
        self._dense = len(self._levels)  # levels before those of `_split`
        self._split = SplitLevels(launcher, (_WEAK, _STRONG))
        self._marks = launcher.zeros(shape, "pressure")
        cells = prod(self._levels[-1].shape)
        self._direct = launcher.zeros((cells, cells), "pressure") if cells <= FEW_CELLS else None

    def _zeros(self, cells: tuple[int, int, int]) -> wp.array:
        return self._launcher.zeros(tuple(n + 3 for n in cells), "pressure")

    def prepare(self, operator: FaceWeights) -> None:
        """Takes in which faces are open: each wholly or not at all."""
        self._prepare_finest(operator)
        for number, coarse in enumerate(self._levels[1:], 1):
            for axis, fine in enumerate(self._levels[number - 1].weights):
                turned = (wp.vec3i(*_UNITS[(axis + turn) % 3]) for turn in range(3))
                faces = tuple(n + (axis == along) for along, n in enumerate(coarse.shape))
                args = (fine, *turned, coarse.shape[axis], self._upper_factor(number, axis), coarse.weights[axis])
                self._launcher.launch(_coarsen_weights, faces, *args)
            self._launcher.launch(_invert_diagonal, coarse.shape, *coarse.weights, coarse.inverse)
        self._dense = self._count_dense()
        last = self._levels[self._dense - 1]
        if self._dense < len(self._levels):
            matrix = _matrix(last)
            position = np.stack(np.unravel_index(np.arange(matrix.shape[0]), last.inverse.shape), axis=1) - 1
            ends = zip(last.shape, self._sides[1::2], strict=True)
            self._split.prepare(matrix, position, np.array([n - n % 2 if side == "open" else n for n, side in ends]))
        elif self._direct is not None:
            cells = np.ravel_multi_index(np.indices(last.shape).reshape(3, -1) + 1, last.e.shape)
            self._direct.assign(pseudo_inverse(-_matrix(last)[cells][:, cells].toarray()))
        if not self._walls:
            for array in self._levels[0].weights:
                array.zero_()

    def _prepare_finest(self, operator: FaceWeights) -> None:
        finest = self._levels[0]
        self._copy_weights(operator)
        self._launcher.launch(_invert_diagonal, finest.shape, *finest.weights, finest.inverse)
        walls = self._mark(_mark_walls, finest, finest.shape)
        self._walls = walls > 0
        if self._walls and finest.weights[0] is finest.source:
            for array in finest.weights:
                array.zero_()
            own = tuple(self._zeros(finest.shape) for _ in range(3))
            self._levels[0] = finest._replace(weights=own)
            self._copy_weights(operator)

    def _copy_weights(self, operator: FaceWeights) -> None:
        lower, upper = side_weights(self._sides)
        for axis, (share, weights) in enumerate(zip(operator.shares, self._levels[0].weights, strict=True)):
            args = (share, wp.vec3i(*_UNITS[axis]), lower[axis], upper[axis], weights)
            self._launcher.launch(_copy_weights, share.shape, *args)

    def _mark(self, kernel: wp.Kernel, level: _Level, shape: tuple[int, int, int]) -> int:
        """How many cells, or blocks of them, a kernel marks on a level."""
        self._launcher.launch(kernel, shape, *level.weights, level.inverse, self._marks)
        return int(np.count_nonzero(self._marks.numpy()[: shape[0], : shape[1], : shape[2]]))

    def _count_dense(self) -> int:
        """Levels down to the first with blocks that walls split.

        On the finest, where lists of cells are dear, a few such blocks are let pass.
        """
        for number, coarse in enumerate(self._levels[1:], 1):
            split = self._mark(_mark_split, self._levels[number - 1], coarse.shape)
            if split > (0 if number > 1 else _SPLIT_SHARE * prod(coarse.shape) ** (2 / 3)):
                return number
        return len(self._levels)

    def apply(self, residual: wp.array) -> float:
        """Sets correction ≈ L⁻¹ r.

        Args:
            residual: r, [nx, ny, nz] [m/s], 0 in solid cells.

        Returns:
            Σ r correction.
        """
        levels, launch = self._levels[: self._dense], self._launcher.launch
        finest = levels[0]
        launch(_start, finest.shape, residual, finest.inverse, _WEAK, finest.source, finest.e)
        for level, coarse in pairwise(levels):
            self._sweep(level, level.e, _STRONG, level.other)
            self._measure(level)
            args = (level.e, *coarse.weights, coarse.inverse, _WEAK, coarse.source, coarse.e)
            launch(_restrict, coarse.shape, *args)
        self._solve_last(levels[-1])
        for coarse, level in pairwise(reversed(levels)):
            launch(_prolong, level.shape, coarse.e, *coarse.weights, level.inverse, level.other, level.e)
            self._sweep(level, level.e, _STRONG, level.other)
            if level is not finest:
                self._sweep(level, level.other, _WEAK, level.e)
        return self._sweep_last()

    def _sweep(self, level: _Level, e: wp.array, weight: float, e_out: wp.array) -> None:
        if self._is_plain(level):
            self._launcher.launch(_sweep, level.shape, e, level.source, level.inverse, weight, e_out)
        else:
            args = (e, level.source, *level.weights, level.inverse, weight, e_out)
            self._launcher.launch(_sweep_weighted, level.shape, *args)

    def _measure(self, level: _Level) -> None:
        """Sets e to the residual of `other`."""
        if self._is_plain(level):
            args = (level.other, level.source, level.inverse, level.e)
            self._launcher.launch(_measure, level.shape, *args)
        else:
            args = (level.other, level.source, *level.weights, level.inverse, level.e)
            self._launcher.launch(_measure_weighted, level.shape, *args)

    def _is_plain(self, level: _Level) -> bool:
        """Whether e = 0 in solid cells does for weights."""
        return level is self._levels[0] and not self._walls

    def _sweep_last(self) -> float:
        """The last sweep of all, and Σ r correction."""
        finest, parts = self._levels[0], self._sums.parts
        if self._walls:
            self._sweep(finest, finest.other, _WEAK, finest.e)
            self._launcher.launch(_sum_products, self._sums.launch_shape, finest.source, finest.e, parts)
        else:
            args = (finest.other, finest.source, finest.inverse, _WEAK, finest.e, parts)
            self._launcher.launch(_sweep_last, self._sums.launch_shape, *args)
        return self._sums.sum(0)

    def _solve_last(self, last: _Level) -> None:
        """Solves the last dense level: e, or `other` before the last sweep if it is the finest as well."""
        if self._dense < len(self._levels):
            self._sweep(last, last.e, _STRONG, last.other)
            self._measure(last)
            self._split.correct(last.e.flatten(), last.other.flatten(), last.e.flatten())
            self._sweep(last, last.e, _STRONG, last.other)
            if self._dense > 1:
                self._sweep(last, last.other, _WEAK, last.e)
        elif self._direct is not None:
            e = last.e if self._dense > 1 else last.other
            self._launcher.launch_each(_solve_directly, self._direct.shape[0], self._direct, last.source, e)
        else:
            for _ in range(LAST_SWEEPS):
                self._sweep(last, last.e, _STRONG, last.other)
                self._sweep(last, last.other, _WEAK, last.e)

    def _upper_factor(self, level: int, axis: int) -> float:
        """Weight of the upper side on a level, over that of the fine face in its place."""
        if self._sides[2 * axis + 1] == "closed":
            return 1.0
        n = self._levels[0].shape[axis]

        def distance(number: int) -> float:
            return n / 2**number - self._levels[number].shape[axis] + 0.5

        even = self._levels[level - 1].shape[axis] % 2 == 0
        return (distance(level - 1) if even else 1.0) / distance(level)


def _matrix(level: _Level) -> scipy.sparse.csr_array:
    """−L over the cells of the level's arrays, those around it too: their rows are empty."""
    numbers = np.arange(level.inverse.size).reshape(level.inverse.shape)
    inner = np.zeros(level.inverse.shape, bool)
    inner[tuple(slice(1, n + 1) for n in level.shape)] = True
    rows, columns, values = [], [], []
    for axis, weights in enumerate(level.weights):
        w = weights.numpy().astype(np.float64)
        below = np.roll(numbers, 1, axis)
        for here, there in ((numbers, below), (below, numbers)):
            at = (w > 0) & inner.ravel()[here]
            rows.append(here[at])
            columns.append(here[at])
            values.append(w[at])
            at &= inner.ravel()[there]
            rows.append(here[at])
            columns.append(there[at])
            values.append(-w[at])
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return scipy.sparse.coo_array(entries, shape=(numbers.size, numbers.size)).tocsr()
