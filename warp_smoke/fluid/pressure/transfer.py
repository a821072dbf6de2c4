"""Restriction and prolongation between levels of a multigrid V-cycle; one is half the transpose of the other."""

import warp as wp

from warp_smoke.fluid.pressure.levels import Level
from warp_smoke.fluid.pressure.smoothing import fill_ghosts
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.func
def _sum_x(r: wp.array3d[float], x: int, y: int, z: int):
    """Returns the sum over the four cells from (x, y, z) on across x."""
    return r[x, y, z] + r[x, y, z + 1] + r[x, y + 1, z] + r[x, y + 1, z + 1]


@wp.func
def _sum_y(r: wp.array3d[float], x: int, y: int, z: int):
    """Returns the sum over the four cells from (x, y, z) on across y."""
    return r[x, y, z] + r[x, y, z + 1] + r[x + 1, y, z] + r[x + 1, y, z + 1]


@wp.func
def _sum_z(r: wp.array3d[float], x: int, y: int, z: int):
    """Returns the sum over the four cells from (x, y, z) on across z."""
    return r[x, y, z] + r[x, y + 1, z] + r[x + 1, y, z] + r[x + 1, y + 1, z]


@wp.kernel
def _restrict(
    rows: Rows,
    residual: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    source_out: wp.array3d[float],
):
    """On the next level, d = ½ (Σ r + ¼ Σ W (r beyond the face − r inside)).

    Sums are over the eight fine cells of a coarse cell, and over the four on either side of each of its faces: half the
    transpose of `_prolong`, so that the cycle is symmetric.
    """
    i, j, c = wp.tid()
    i += rows.first
    r = dense(residual)
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    d = dense_store(source_out)
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
        d[i + 1, j + 1, k + 1] = bits(0.5 * (lower + upper + 0.25 * exchange))
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


def restrict(launcher: Launcher, level: Level, residual: wp.array, coarse: Level) -> None:
    """Sets d of the next coarser level from the residual of a level."""
    fill_ghosts(launcher, level, residual)
    launcher.launch(_restrict, coarse.shape, residual, *coarse.weights, coarse.source)


def prolong(launcher: Launcher, coarse: Level, level: Level, e: wp.array, e_out: wp.array) -> None:
    """Sets e_out to e plus the correction from the next coarser level."""
    fill_ghosts(launcher, coarse, coarse.e)
    launcher.launch(_prolong, level.shape, coarse.e, *coarse.weights, level.inverse, e, e_out)
