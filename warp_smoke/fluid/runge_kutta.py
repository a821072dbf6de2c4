"""Traces backwards by name: Runge–Kutta methods of order 1, 2 and 3.

R. Bridson, *Fluid Simulation for Computer Graphics*, 2015, section 2.4; the third is A. Ralston's, 1962. The second,
which all smoke is carried by, is in `trace.py`; the others are there to be compared with it.
"""

import warp as wp

from warp_smoke.fluid.grid import Block, Patch
from warp_smoke.fluid.interpolation import sample, within
from warp_smoke.fluid.trace import trace_by_midpoint
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.func
def _velocity_at(u: wp.array3d[float], v: wp.array3d[float], w: wp.array3d[float], x: float, y: float, z: float):
    """(u, v, w) at a place in cell indices, or at the sample nearest to it."""
    last_x = float(v.shape[0] - 1)
    last_y = float(u.shape[1] - 1)
    last_z = float(u.shape[2] - 1)
    cx = within(x, 0.0, last_x)
    cy = within(y, 0.0, last_y)
    cz = within(z, 0.0, last_z)
    return wp.vec3(
        sample(u, within(x + 0.5, 0.0, last_x + 1.0), cy, cz),
        sample(v, cx, within(y + 0.5, 0.0, last_y + 1.0), cz),
        sample(w, cx, cy, within(z + 0.5, 0.0, last_z + 1.0)),
    )


@wp.kernel
def _trace_by_euler(
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
    """Euler: d = −s u(x), s = dt / h, and x + d kept within [lower, upper]."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    fu = dense(u)
    fv = dense(v)
    fw = dense(w)
    dx = dense_store(dx_out)
    dy = dense_store(dy_out)
    dz = dense_store(dz_out)
    x = float(i)
    y = float(j)
    half = 0.5 * step
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        z = float(k)
        dx[i, j, k] = bits(within(-half * (fu[i, j, k] + fu[i + 1, j, k]), lower[0] - x, upper[0] - x))
        dy[i, j, k] = bits(within(-half * (fv[i, j, k] + fv[i, j + 1, k]), lower[1] - y, upper[1] - y))
        dz[i, j, k] = bits(within(-half * (fw[i, j, k] + fw[i, j, k + 1]), lower[2] - z, upper[2] - z))
        k += 1


@wp.kernel
def _trace_by_ralston(
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
    """Ralston: d = −s (2 a + 3 b + 4 c) / 9, a = u(x), b = u(x − ½ s a), c = u(x − ¾ s b); ends as for Euler's."""
    i, j, n = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    k = wp.max(block.first[2] + n * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x = wp.vec3(float(i), float(j), float(k))
        a = _velocity_at(u, v, w, x[0], x[1], x[2])
        y = x - 0.5 * step * a
        b = _velocity_at(u, v, w, y[0], y[1], y[2])
        y = x - 0.75 * step * b
        c = _velocity_at(u, v, w, y[0], y[1], y[2])
        d = -step / 9.0 * (2.0 * a + 3.0 * b + 4.0 * c)
        dx_out[i, j, k] = within(d[0], lower[0] - x[0], upper[0] - x[0])
        dy_out[i, j, k] = within(d[1], lower[1] - x[1], upper[1] - x[1])
        dz_out[i, j, k] = within(d[2], lower[2] - x[2], upper[2] - x[2])
        k += 1


TRACES = {"euler": _trace_by_euler, "rk2": trace_by_midpoint, "rk3": _trace_by_ralston}


def trace_back(
    launcher: Launcher,
    scheme: str,
    cells: Patch,
    velocity: tuple,
    step: float,
    limits: tuple[wp.vec3, wp.vec3],
    displacement: tuple,
) -> None:
    """Traces from each cell's centre to where its smoke was one step ago.

    Args:
        launcher: where it runs.
        scheme: one of `TRACES`.
        cells: those to trace from.
        velocity: u, v, w on faces [m/s].
        step: dt / h [s/m].
        limits: where traces end, see `trace_limits`.
        displacement: along x, y, z, each [nx, ny, nz] [cells], written.
    """
    launcher.launch(TRACES[scheme], *cells, *velocity, step, *limits, *displacement)
