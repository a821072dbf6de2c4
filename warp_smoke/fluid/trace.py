"""Traces of the smoke through one step: where it came from, and where it goes.

Backwards by the midpoint rule (RK2); J. Stam, *Stable Fluids*, 1999. Displacements are in cells, one for each cell
centre; all fields share them.
"""

import warp as wp

from warp_smoke.fluid.grid import Block, Patch
from warp_smoke.fluid.interpolation import sample, within
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.kernel
def trace_by_midpoint(
    rows: Rows,
    block: Block,
    u: wp.array3d[float],
    v: wp.array3d[float],
    w: wp.array3d[float],
    step: float,
    lower: wp.vec3,
    upper: wp.vec3,
    dx_out: wp.array3d[float],
    dy_out: wp.array3d[float],
    dz_out: wp.array3d[float],
):
    """Midpoint rule: d = −s u(x − ½ s u(x)), s = dt / h, and x + d kept within [lower, upper]."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    fu = dense(u)
    fv = dense(v)
    fw = dense(w)
    dx = dense_store(dx_out)
    dy = dense_store(dy_out)
    dz = dense_store(dz_out)
    last_x = float(dx_out.shape[0] - 1)
    last_y = float(dx_out.shape[1] - 1)
    last_z = float(dx_out.shape[2] - 1)
    x = float(i)
    y = float(j)
    quarter = 0.25 * step
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        z = float(k)
        mx = x - quarter * (fu[i, j, k] + fu[i + 1, j, k])
        my = y - quarter * (fv[i, j, k] + fv[i, j + 1, k])
        mz = z - quarter * (fw[i, j, k] + fw[i, j, k + 1])
        cx = within(mx, 0.0, last_x)
        cy = within(my, 0.0, last_y)
        cz = within(mz, 0.0, last_z)
        mu = sample(u, within(mx + 0.5, 0.0, last_x + 1.0), cy, cz)
        mv = sample(v, cx, within(my + 0.5, 0.0, last_y + 1.0), cz)
        mw = sample(w, cx, cy, within(mz + 0.5, 0.0, last_z + 1.0))
        dx[i, j, k] = bits(within(-step * mu, lower[0] - x, upper[0] - x))
        dy[i, j, k] = bits(within(-step * mv, lower[1] - y, upper[1] - y))
        dz[i, j, k] = bits(within(-step * mw, lower[2] - z, upper[2] - z))
        k += 1


@wp.kernel
def _trace_ahead(
    rows: Rows,
    block: Block,
    u: wp.array3d[float],
    v: wp.array3d[float],
    w: wp.array3d[float],
    step: float,
    lower: wp.vec3,
    upper: wp.vec3,
    dx: wp.array3d[float],
    dy: wp.array3d[float],
    dz: wp.array3d[float],
    ex_out: wp.array3d[float],
    ey_out: wp.array3d[float],
    ez_out: wp.array3d[float],
):
    """Reverse: e = d + 2 s u(x), s = dt / h, d the displacement backwards, and x + e kept within [lower, upper].

    d = −s u + ½ s² u·∇u + O(s³) and its counterpart forwards is s u + ½ s² u·∇u + O(s³):
    their difference is 2 s u.
    """
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    fu = dense(u)
    fv = dense(v)
    fw = dense(w)
    bx = dense(dx)
    by = dense(dy)
    bz = dense(dz)
    ex = dense_store(ex_out)
    ey = dense_store(ey_out)
    ez = dense_store(ez_out)
    x = float(i)
    y = float(j)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        z = float(k)
        ax = bx[i, j, k] + step * (fu[i, j, k] + fu[i + 1, j, k])
        ay = by[i, j, k] + step * (fv[i, j, k] + fv[i, j + 1, k])
        az = bz[i, j, k] + step * (fw[i, j, k] + fw[i, j, k + 1])
        ex[i, j, k] = bits(within(ax, lower[0] - x, upper[0] - x))
        ey[i, j, k] = bits(within(ay, lower[1] - y, upper[1] - y))
        ez[i, j, k] = bits(within(az, lower[2] - z, upper[2] - z))
        k += 1


def trace_limits(shape: tuple[int, int, int], sides: tuple[str, ...]) -> tuple[wp.vec3, wp.vec3]:
    """Where traces end, lower and upper, in cell indices: on closed sides, and a cell's centre beyond open ones."""
    lower = [-0.5 if side == "closed" else -1.0 for side in sides[0::2]]
    upper = [n - (0.5 if side == "closed" else 0.0) for n, side in zip(shape, sides[1::2], strict=True)]
    return wp.vec3(*lower), wp.vec3(*upper)


def trace_ahead(
    launcher: Launcher,
    cells: Patch,
    velocity: tuple,
    step: float,
    limits: tuple[wp.vec3, wp.vec3],
    backwards: tuple,
    displacement: tuple,
) -> None:
    """Traces from each cell's centre to where its smoke will be one step on.

    Args:
        launcher: where it runs.
        cells: those to trace from.
        velocity: u, v, w on faces [m/s].
        step: dt / h [s/m].
        limits: where traces end, see `trace_limits`.
        backwards: what `runge_kutta.trace_back` made of the same velocity.
        displacement: along x, y, z, each [nx, ny, nz] [cells], written.
    """
    launcher.launch(_trace_ahead, *cells, *velocity, step, *limits, *backwards, *displacement)
