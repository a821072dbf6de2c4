"""Semi-Lagrangian advection with cubic interpolation, limited to the range of the cell at the start of the trace.

R. Fedkiw, J. Stam, H. W. Jensen, *Visual Simulation of Smoke*, 2001, appendix B: cubic Hermite curves through the
samples with central differences for slopes (Catmull–Rom) along each axis. They limit the slopes; here the result is
limited instead, which is monotone in the same sense: no value leaves the range of its neighbours.
"""

import warp as wp

from warp_smoke.fluid.advection import SemiLagrangian, sampling_kernel
from warp_smoke.fluid.interpolation import base, fraction, greater, lesser, within

wp.set_module_options({"enable_backward": False})


@wp.func
def _weights(t: float):
    """Returns the Catmull–Rom weights of the samples at −1, 0, 1, 2 for a position t in [0, 1]."""
    t2 = t * t
    t3 = t2 * t
    return wp.vec4(
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * t3 - 0.5 * t2,
    )


@wp.func
def _offsets(x: float, n: int):
    """Returns the offsets from the base sample to those at −1, 1 and 2, clamped to 0 … n − 1."""
    b = base(x, n)
    return wp.vec3i(wp.max(b - 1, 0) - b, wp.min(b + 1, n - 1) - b, wp.min(b + 2, n - 1) - b)


@wp.func
def _mean(w: wp.vec4, a0: float, a1: float, a2: float, a3: float):
    """Returns the weighted sum."""
    return w[0] * a0 + w[1] * a1 + w[2] * a2 + w[3] * a3


@wp.func
def _row(a: wp.array[float], n: int, along_z: wp.vec3i, w: wp.vec4):
    """Returns the cubic interpolation of four samples of a row, and the range of the middle two."""
    a0 = a[n]
    a1 = a[n + along_z[1]]
    return _mean(w, a[n + along_z[0]], a0, a1, a[n + along_z[2]]), lesser(a0, a1), greater(a0, a1)


@wp.func
def _slice(a: wp.array[float], n: int, along_y: wp.vec3i, v: wp.vec4, along_z: wp.vec3i, w: wp.vec4):
    """Returns the cubic interpolation of four rows, and the range of the middle four samples."""
    am, _, _ = _row(a, n + along_y[0], along_z, w)
    a0, l0, h0 = _row(a, n, along_z, w)
    a1, l1, h1 = _row(a, n + along_y[1], along_z, w)
    a2, _, _ = _row(a, n + along_y[2], along_z, w)
    return _mean(v, am, a0, a1, a2), lesser(l0, l1), greater(h0, h1)


@wp.func
def sample_cubic(a: wp.array3d[float], x: float, y: float, z: float):
    """Returns the tricubic value of a at (x, y, z), in sample indices within a, and the range of the cell around it.

    Beyond the outermost samples the field is constant.
    """
    ny = a.shape[1]
    nz = a.shape[2]
    flat = wp.array(ptr=a.ptr, shape=(a.shape[0] * ny * nz,), dtype=float)
    n = (base(x, a.shape[0]) * ny + base(y, ny)) * nz + base(z, nz)
    along_x = ny * nz * _offsets(x, a.shape[0])
    along_y = nz * _offsets(y, ny)
    along_z = _offsets(z, nz)
    u = _weights(fraction(x, a.shape[0]))
    v = _weights(fraction(y, ny))
    w = _weights(fraction(z, nz))
    am, _, _ = _slice(flat, n + along_x[0], along_y, v, along_z, w)
    a0, l0, h0 = _slice(flat, n, along_y, v, along_z, w)
    a1, l1, h1 = _slice(flat, n + along_x[1], along_y, v, along_z, w)
    a2, _, _ = _slice(flat, n + along_x[2], along_y, v, along_z, w)
    return _mean(u, am, a0, a1, a2), lesser(l0, l1), greater(h0, h1)


@wp.func
def _sample_limited(a: wp.array3d[float], x: float, y: float, z: float):
    """Returns the tricubic value of a at (x, y, z), limited to the range of the eight samples around it."""
    value, low, high = sample_cubic(a, x, y, z)
    return within(value, low, high)


class CubicSemiLagrangian(SemiLagrangian):
    """Order 2 and better: each sample takes the limited cubic interpolation at the point where its trace began."""

    _kernel = sampling_kernel(_sample_limited, __name__)
