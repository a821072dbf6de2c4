"""Backward traces by name: Runge–Kutta methods of order 1, 2 and 3.

R. Bridson, *Fluid Simulation for Computer Graphics*, 2015, section 2.4; that of order 3 is A. Ralston's, 1962. That of
order 2, by which all smoke is advected, is in `trace.py`; the others are here for comparison.
"""

import warp as wp

from warp_smoke.fluid.grid import Patch
from warp_smoke.fluid.trace import Displacement, face_sums, trace_by_midpoint, tracing_kernel, velocity_at
from warp_smoke.fluid.two_way_trace import trace_both_ways_by_midpoint, two_way_kernel
from warp_smoke.launch import Launcher

wp.set_module_options({"enable_backward": False})


@wp.func
def by_euler(u: wp.array3d[float], v: wp.array3d[float], w: wp.array3d[float], step: float, i: int, j: int, k: int):
    """Euler: d = −s u(x)."""
    return -0.5 * step * face_sums(u, v, w, i, j, k)


@wp.func
def by_ralston(u: wp.array3d[float], v: wp.array3d[float], w: wp.array3d[float], step: float, i: int, j: int, k: int):
    """Ralston: d = −s (2 a + 3 b + 4 c) / 9, a = u(x), b = u(x − ½ s a), c = u(x − ¾ s b)."""
    x = wp.vec3(float(i), float(j), float(k))
    a = velocity_at(u, v, w, x)
    b = velocity_at(u, v, w, x - 0.5 * step * a)
    c = velocity_at(u, v, w, x - 0.75 * step * b)
    return -step / 9.0 * (2.0 * a + 3.0 * b + 4.0 * c)


# Kernels by the name of the rule: backward only, and both ways.
TRACES = {
    "euler": tracing_kernel(by_euler, __name__),
    "rk2": trace_by_midpoint,
    "rk3": tracing_kernel(by_ralston, __name__),
}
_TWO_WAY_TRACES = {
    "euler": two_way_kernel(by_euler, __name__),
    "rk2": trace_both_ways_by_midpoint,
    "rk3": two_way_kernel(by_ralston, __name__),
}


def trace_back(
    launcher: Launcher,
    scheme: str,
    cells: Patch,
    velocity: tuple,
    step: float,
    limits: tuple[wp.vec3, wp.vec3],
    back: Displacement,
) -> None:
    """Traces from each cell's centre to where its smoke was one step ago.

    Args:
        launcher: where it runs.
        scheme: one of `TRACES`.
        cells: the cells to trace from.
        velocity: u, v, w on faces [m/s].
        step: dt / h [s/m].
        limits: where traces end, see `trace_limits`.
        back: written.
    """
    launcher.launch(TRACES[scheme], *cells, *velocity, step, *limits, back)


def trace_both_ways(
    launcher: Launcher,
    scheme: str,
    cells: Patch,
    velocity: tuple,
    step: float,
    limits: tuple[wp.vec3, wp.vec3],
    back: Displacement,
    ahead: Displacement,
) -> None:
    """Traces from each cell's centre to where its smoke was one step ago, and to where it will be one step later.

    Args:
        launcher: where it runs.
        scheme: one of `TRACES`.
        cells: the cells to trace from.
        velocity: u, v, w on faces [m/s].
        step: dt / h [s/m].
        limits: where traces end, see `trace_limits`.
        back: written.
        ahead: written.
    """
    launcher.launch(_TWO_WAY_TRACES[scheme], *cells, *velocity, step, *limits, back, ahead)
