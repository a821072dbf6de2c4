"""Semi-Lagrangian advection with cubic interpolation, kept within the range of the cell that the trace began in.

R. Fedkiw, J. Stam, H. W. Jensen, *Visual Simulation of Smoke*, 2001, appendix B: cubic Hermite curves through the
samples with central differences for slopes (Catmull–Rom) along each axis. They limit the slopes; here the result is
limited instead, which keeps it monotone in the same sense, that no value arises that was not around.
"""

import warp as wp

from warp_smoke.fluid.advection import SemiLagrangian, end_of_trace
from warp_smoke.fluid.grid import Block, beside
from warp_smoke.fluid.interpolation import base, fraction, greater, lesser, settle, within
from warp_smoke.launch import Rows, bits, dense_store

wp.set_module_options({"enable_backward": False})


@wp.func
def _weights(t: float):
    """Catmull–Rom weights of the samples at −1, 0, 1, 2 for a place t in [0, 1]."""
    t2 = t * t
    t3 = t2 * t
    return (
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * t3 - 0.5 * t2,
    )


@wp.func
def _row(a: wp.array[float], n: int, before: int, after: int, beyond: int, wm: float, w0: float, w1: float, w2: float):
    """Cubic mean of four samples of a row, with the range of the middle two."""
    a0 = a[n]
    a1 = a[n + after]
    return wm * a[n + before] + w0 * a0 + w1 * a1 + w2 * a[n + beyond], lesser(a0, a1), greater(a0, a1)


@wp.func
def _offsets(x: float, n: int):
    """From the base sample to those at −1, 1 and 2, which stay within 0 … n − 1."""
    b = base(x, n)
    return wp.max(b - 1, 0) - b, wp.min(b + 1, n - 1) - b, wp.min(b + 2, n - 1) - b


@wp.func
def _slice(
    a: wp.array[float],
    n: int,
    ym: int,
    y1: int,
    y2: int,
    vm: float,
    v0: float,
    v1: float,
    v2: float,
    zm: int,
    z1: int,
    z2: int,
    wm: float,
    w0: float,
    w1: float,
    w2: float,
):
    """Cubic mean of four rows, with the range of the middle four samples."""
    am, _, _ = _row(a, n + ym, zm, z1, z2, wm, w0, w1, w2)
    a0, l0, h0 = _row(a, n, zm, z1, z2, wm, w0, w1, w2)
    a1, l1, h1 = _row(a, n + y1, zm, z1, z2, wm, w0, w1, w2)
    a2, _, _ = _row(a, n + y2, zm, z1, z2, wm, w0, w1, w2)
    return vm * am + v0 * a0 + v1 * a1 + v2 * a2, lesser(l0, l1), greater(h0, h1)


@wp.func
def sample_cubic(a: wp.array3d[float], x: float, y: float, z: float):
    """Tricubic value of a at (x, y, z), in sample indices within those of a, and the range of the cell around it.

    Beyond the outermost samples the field goes on as constant.
    """
    ny = a.shape[1]
    nz = a.shape[2]
    flat = wp.array(ptr=a.ptr, shape=(a.shape[0] * ny * nz,), dtype=float)
    n = (base(x, a.shape[0]) * ny + base(y, ny)) * nz + base(z, nz)
    xm, x1, x2 = _offsets(x, a.shape[0])
    ym, y1, y2 = _offsets(y, ny)
    zm, z1, z2 = _offsets(z, nz)
    um, u0, u1, u2 = _weights(fraction(x, a.shape[0]))
    vm, v0, v1, v2 = _weights(fraction(y, ny))
    wm, w0, w1, w2 = _weights(fraction(z, nz))
    ym *= nz
    y1 *= nz
    y2 *= nz
    size = ny * nz
    am, _, _ = _slice(flat, n + xm * size, ym, y1, y2, vm, v0, v1, v2, zm, z1, z2, wm, w0, w1, w2)
    a0, l0, h0 = _slice(flat, n, ym, y1, y2, vm, v0, v1, v2, zm, z1, z2, wm, w0, w1, w2)
    a1, l1, h1 = _slice(flat, n + x1 * size, ym, y1, y2, vm, v0, v1, v2, zm, z1, z2, wm, w0, w1, w2)
    a2, _, _ = _slice(flat, n + x2 * size, ym, y1, y2, vm, v0, v1, v2, zm, z1, z2, wm, w0, w1, w2)
    return um * am + u0 * a0 + u1 * a1 + u2 * a2, lesser(l0, l1), greater(h0, h1)


@wp.kernel
def _sample_back_cubic(
    rows: Rows,
    block: Block,
    dx: wp.array3d[float],
    dy: wp.array3d[float],
    dz: wp.array3d[float],
    a: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    ambient: float,
    a_out: wp.array3d[float],
):
    """a_out(x) = a(x + d) by cubic interpolation, within the range of the eight samples around x + d."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    x0 = beside(dx, block.before)
    y0 = beside(dy, block.before)
    z0 = beside(dz, block.before)
    x1 = beside(dx, block.after)
    y1 = beside(dy, block.after)
    z1 = beside(dz, block.after)
    out = dense_store(a_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x, y, z, inside = end_of_trace(x0, y0, z0, x1, y1, z1, i, j, k, a, lower, upper)
        value, low, high = sample_cubic(a, x, y, z)
        out[i, j, k] = bits(settle(ambient + inside * (within(value, low, high) - ambient)))
        k += 1


class CubicSemiLagrangian(SemiLagrangian):
    """Order 2 and better: each sample takes the cubic value where its trace began, within the range around."""

    _kernel = _sample_back_cubic
