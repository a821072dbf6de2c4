"""Weighted Jacobi sweeps and residuals on the levels of a multigrid V-cycle.

On a level without weights, faces are closed only at solid cells, where e = 0, so sums over neighbours need no weights.
"""

import warp as wp

from warp_smoke.fluid.halo import copy_samples
from warp_smoke.fluid.pressure.levels import Level
from warp_smoke.fluid.pressure.preconditioner import sum_products
from warp_smoke.fluid.pressure.sums import Sums, add_product, clear_part, dense_parts
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.func
def _neighbours(correction: wp.array3d[float], x: int, y: int, z: int):
    """Returns Σ e_neighbour, which needs no weights where faces are closed only at solid cells with e = 0."""
    e = dense(correction)
    return e[x - 1, y, z] + e[x + 1, y, z] + e[x, y - 1, z] + e[x, y + 1, z] + e[x, y, z - 1] + e[x, y, z + 1]


@wp.func
def _weighted_neighbours(
    correction: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    x: int,
    y: int,
    z: int,
):
    """Returns Σ w e_neighbour."""
    e = dense(correction)
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    along_x = ox[x, y, z] * e[x - 1, y, z] + ox[x + 1, y, z] * e[x + 1, y, z]
    along_y = oy[x, y, z] * e[x, y - 1, z] + oy[x, y + 1, z] * e[x, y + 1, z]
    along_z = oz[x, y, z] * e[x, y, z - 1] + oz[x, y, z + 1] * e[x, y, z + 1]
    return along_x + along_y + along_z


@wp.func
def _relaxed(here: float, neighbours: float, right: float, inverse: float, weight: float):
    """Returns (1 − weight) e + weight (Σ w e_neighbour − d) / Σ w."""
    return (1.0 - weight) * here + weight * (inverse * (neighbours - right))


@wp.func
def _residual(here: float, neighbours: float, right: float, inverse: float):
    """Returns the residual d − L e, 0 if the cell has no open face."""
    return wp.where(inverse > 0.0, right - neighbours + here / wp.max(inverse, 1.0e-6), 0.0)


@wp.func
def _first(source: wp.array3d[float], inverse: wp.array3d[float], weight: float, x: int, y: int, z: int):
    """Returns the result of the first sweep from e = 0: −weight d / Σ w."""
    d = dense(source)
    m = dense(inverse)
    return -weight * m[x, y, z] * d[x, y, z]


@wp.kernel
def _sweep_twice(
    rows: Rows,
    source: wp.array3d[float],
    inverse: wp.array3d[float],
    first_weight: float,
    weight: float,
    e_out: wp.array3d[float],
):
    """From e = 0, e_out by two sweeps as in `_sweep`."""
    i, j, c = wp.tid()
    x = i + rows.first + 1
    y = j + 1
    d = dense(source)
    m = dense(inverse)
    after = dense_store(e_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, e_out.shape[2] - 3)
    while k < end:
        z = k + 1
        total = _first(source, inverse, first_weight, x - 1, y, z) + _first(source, inverse, first_weight, x + 1, y, z)
        total += _first(source, inverse, first_weight, x, y - 1, z) + _first(source, inverse, first_weight, x, y + 1, z)
        total += _first(source, inverse, first_weight, x, y, z - 1) + _first(source, inverse, first_weight, x, y, z + 1)
        here = _first(source, inverse, first_weight, x, y, z)
        after[x, y, z] = bits(_relaxed(here, total, d[x, y, z], m[x, y, z], weight))
        k += 1


@wp.kernel
def _sweep_twice_weighted(
    rows: Rows,
    source: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    inverse: wp.array3d[float],
    first_weight: float,
    weight: float,
    e_out: wp.array3d[float],
):
    """From e = 0, e_out by two sweeps as in `_sweep_weighted`."""
    i, j, c = wp.tid()
    x = i + rows.first + 1
    y = j + 1
    d = dense(source)
    m = dense(inverse)
    ox = dense(wx)
    oy = dense(wy)
    oz = dense(wz)
    after = dense_store(e_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, e_out.shape[2] - 3)
    while k < end:
        z = k + 1
        total = ox[x, y, z] * _first(source, inverse, first_weight, x - 1, y, z)
        total += ox[x + 1, y, z] * _first(source, inverse, first_weight, x + 1, y, z)
        total += oy[x, y, z] * _first(source, inverse, first_weight, x, y - 1, z)
        total += oy[x, y + 1, z] * _first(source, inverse, first_weight, x, y + 1, z)
        total += oz[x, y, z] * _first(source, inverse, first_weight, x, y, z - 1)
        total += oz[x, y, z + 1] * _first(source, inverse, first_weight, x, y, z + 1)
        here = _first(source, inverse, first_weight, x, y, z)
        after[x, y, z] = bits(_relaxed(here, total, d[x, y, z], m[x, y, z], weight))
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
        total = _neighbours(e, x, y, z)
        after[x, y, z] = bits(_relaxed(before[x, y, z], total, d[x, y, z], m[x, y, z], weight))
        k += 1


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
    m = dense(inverse)
    after = dense_store(e_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, e.shape[2] - 3)
    while k < end:
        z = k + 1
        total = _weighted_neighbours(e, wx, wy, wz, x, y, z)
        after[x, y, z] = bits(_relaxed(before[x, y, z], total, d[x, y, z], m[x, y, z], weight))
        k += 1


@wp.kernel
def _sweep_and_sum(
    rows: Rows,
    e: wp.array3d[float],
    source: wp.array3d[float],
    inverse: wp.array3d[float],
    weight: float,
    e_out: wp.array3d[float],
    parts_out: wp.array3d[wp.float64],
):
    """Like `_sweep`; also the parts of Σ d e_out."""
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
    clear_part(parts, 0, i, start, end)
    y = wp.int32(1)
    while y < e.shape[1] - 2:
        k = start
        while k < end:
            z = k + 1
            right = d[x, y, z]
            total = _neighbours(e, x, y, z)
            value = _relaxed(before[x, y, z], total, right, m[x, y, z], weight)
            after[x, y, z] = value
            add_product(parts, i, k, right, value)
            k += 1
        y += 1


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
        z = k + 1
        r[x, y, z] = bits(_residual(f[x, y, z], _neighbours(e, x, y, z), d[x, y, z], m[x, y, z]))
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
    m = dense(inverse)
    r = dense_store(residual_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, e.shape[2] - 3)
    while k < end:
        z = k + 1
        total = _weighted_neighbours(e, wx, wy, wz, x, y, z)
        r[x, y, z] = bits(_residual(f[x, y, z], total, d[x, y, z], m[x, y, z]))
        k += 1


def fill_ghosts(launcher: Launcher, level: Level, a: wp.array) -> None:
    """Fills the ghosts of a level's field beyond periodic sides."""
    copy_samples(launcher, level.ghosts, a, a)


def sweep_twice(launcher: Launcher, level: Level, first_weight: float, weight: float, e_out: wp.array) -> None:
    """Sets e_out to the result of two weighted Jacobi sweeps from 0."""
    fill_ghosts(launcher, level, level.source)
    if level.weights is None:
        launcher.launch(_sweep_twice, level.shape, level.source, level.inverse, first_weight, weight, e_out)
    else:
        args = (level.source, *level.weights, level.inverse, first_weight, weight, e_out)
        launcher.launch(_sweep_twice_weighted, level.shape, *args)


def sweep(launcher: Launcher, level: Level, e: wp.array, weight: float, e_out: wp.array) -> None:
    """Sets e_out to e after one weighted Jacobi sweep."""
    fill_ghosts(launcher, level, e)
    if level.weights is None:
        launcher.launch(_sweep, level.shape, e, level.source, level.inverse, weight, e_out)
    else:
        args = (e, level.source, *level.weights, level.inverse, weight, e_out)
        launcher.launch(_sweep_weighted, level.shape, *args)


def sweep_and_sum(launcher: Launcher, level: Level, e: wp.array, weight: float, e_out: wp.array, sums: Sums) -> None:
    """Like `sweep`; also sums d e_out."""
    if level.weights is None:
        fill_ghosts(launcher, level, e)
        args = (e, level.source, level.inverse, weight, e_out, sums.parts)
        launcher.launch(_sweep_and_sum, sums.launch_shape, *args)
    else:
        sweep(launcher, level, e, weight, e_out)
        sum_products(launcher, level.source, e_out, 1, sums)


def measure(launcher: Launcher, level: Level, e: wp.array, residual_out: wp.array) -> None:
    """Sets residual_out to d − L e."""
    fill_ghosts(launcher, level, e)
    if level.weights is None:
        launcher.launch(_measure, level.shape, e, level.source, level.inverse, residual_out)
    else:
        args = (e, level.source, *level.weights, level.inverse, residual_out)
        launcher.launch(_measure_weighted, level.shape, *args)
