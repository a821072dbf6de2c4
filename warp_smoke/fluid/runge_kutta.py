"""Traces backwards by name: Runge–Kutta methods of order 1, 2 and 3.

R. Bridson, *Fluid Simulation for Computer Graphics*, 2015, section 2.4; the third is A. Ralston's, 1962. The second,
which all smoke is carried by, is in `trace.py`; the others are there to be compared with it.
"""

import warp as wp

from warp_smoke.fluid.grid import Block, Patch
from warp_smoke.fluid.trace import face_sums, store_displacement, trace_by_midpoint, velocity_at
from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})


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
    half = 0.5 * step
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        d = -half * face_sums(u, v, w, i, j, k)
        store_displacement(i, j, k, d, lower, upper, dx_out, dy_out, dz_out)
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
        a = velocity_at(u, v, w, x)
        b = velocity_at(u, v, w, x - 0.5 * step * a)
        c = velocity_at(u, v, w, x - 0.75 * step * b)
        d = -step / 9.0 * (2.0 * a + 3.0 * b + 4.0 * c)
        store_displacement(i, j, k, d, lower, upper, dx_out, dy_out, dz_out)
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
