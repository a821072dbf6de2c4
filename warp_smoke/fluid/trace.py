"""Traces of the smoke through one step: where it came from.

By the midpoint rule (RK2); J. Stam, *Stable Fluids*, 1999. Displacements are in cells, one for each cell centre; all
fields share them.
"""

import warp as wp

from warp_smoke.fluid.grid import Block
from warp_smoke.fluid.interpolation import sample, within
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.func
def face_sums(u: wp.array3d[float], v: wp.array3d[float], w: wp.array3d[float], i: int, j: int, k: int):
    """Returns twice the velocity at the centre of a cell: the sums over its faces across x, y and z."""
    fu = dense(u)
    fv = dense(v)
    fw = dense(w)
    return wp.vec3(fu[i, j, k] + fu[i + 1, j, k], fv[i, j, k] + fv[i, j + 1, k], fw[i, j, k] + fw[i, j, k + 1])


@wp.func
def velocity_at(u: wp.array3d[float], v: wp.array3d[float], w: wp.array3d[float], x: wp.vec3):
    """Returns the velocity at a point in cell indices, clamped to the samples."""
    last_x = float(v.shape[0] - 1)
    last_y = float(u.shape[1] - 1)
    last_z = float(u.shape[2] - 1)
    cx = within(x[0], 0.0, last_x)
    cy = within(x[1], 0.0, last_y)
    cz = within(x[2], 0.0, last_z)
    return wp.vec3(
        sample(u, within(x[0] + 0.5, 0.0, last_x + 1.0), cy, cz),
        sample(v, cx, within(x[1] + 0.5, 0.0, last_y + 1.0), cz),
        sample(w, cx, cy, within(x[2] + 0.5, 0.0, last_z + 1.0)),
    )


@wp.struct
class Displacement:
    """Displacement of each cell's smoke along x, y and z, each [nx, ny, nz] [cells]."""

    x: wp.array3d[float]
    y: wp.array3d[float]
    z: wp.array3d[float]


def make_displacement(launcher: Launcher, shape: tuple[int, int, int]) -> Displacement:
    """Allocates displacements of 0."""
    made = Displacement()
    made.x, made.y, made.z = (launcher.zeros(shape, "advection") for _ in range(3))
    return made


@wp.func
def shortened(i: int, j: int, k: int, d: wp.vec3, lower: wp.vec3, upper: wp.vec3):
    """Returns the displacement d of a cell, shortened to end within [lower, upper]."""
    x = float(i)
    y = float(j)
    z = float(k)
    return wp.vec3(
        within(d[0], lower[0] - x, upper[0] - x),
        within(d[1], lower[1] - y, upper[1] - y),
        within(d[2], lower[2] - z, upper[2] - z),
    )


@wp.func
def store_displacement(i: int, j: int, k: int, d: wp.vec3, d_out: Displacement):
    """Stores the displacement d of a cell."""
    dx = dense_store(d_out.x)
    dy = dense_store(d_out.y)
    dz = dense_store(d_out.z)
    dx[i, j, k] = bits(d[0])
    dy[i, j, k] = bits(d[1])
    dz[i, j, k] = bits(d[2])


def tracing_kernel(rule: wp.Function, module: str) -> wp.Kernel:
    """Makes the kernel that traces backward by an integration rule.

    Args:
        rule: (u, v, w, step, i, j, k) → displacement of cell (i, j, k).
        module: name of the module that the kernel is compiled with.
    """

    @wp.kernel(name=f"trace_{rule.key}", module=wp.get_module(module))
    def trace(
        rows: Rows,
        block: Block,
        u: wp.array3d[float],
        v: wp.array3d[float],
        w: wp.array3d[float],
        step: float,
        lower: wp.vec3,
        upper: wp.vec3,
        d_out: Displacement,
    ):
        """Displacement d by the rule with step s = dt / h, and x + d kept within [lower, upper]."""
        i, j, c = wp.tid()
        i += rows.first + block.first[0]
        j += block.first[1]
        k = wp.max(block.first[2] + c * rows.run, 0)
        end = wp.min(k + rows.run, block.stop)
        while k < end:
            d = shortened(i, j, k, rule(u, v, w, step, i, j, k), lower, upper)
            store_displacement(i, j, k, d, d_out)
            k += 1

    return trace


@wp.func
def by_midpoint(u: wp.array3d[float], v: wp.array3d[float], w: wp.array3d[float], step: float, i: int, j: int, k: int):
    """Midpoint rule: d = −s u(x − ½ s u(x))."""
    middle = wp.vec3(float(i), float(j), float(k)) - 0.25 * step * face_sums(u, v, w, i, j, k)
    return -step * velocity_at(u, v, w, middle)


trace_by_midpoint = tracing_kernel(by_midpoint, __name__)


def trace_limits(shape: tuple[int, int, int], sides: tuple[str, ...]) -> tuple[wp.vec3, wp.vec3]:
    """Returns where traces end, in cell indices: on closed sides, and at the first cell centre beyond open ones."""
    lower = [-0.5 if side == "closed" else -1.0 for side in sides[0::2]]
    upper = [n - (0.5 if side == "closed" else 0.0) for n, side in zip(shape, sides[1::2], strict=True)]
    return wp.vec3(*lower), wp.vec3(*upper)
