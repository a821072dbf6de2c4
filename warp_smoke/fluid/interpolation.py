"""Trilinear interpolation that LLVM can vectorise: one integer base index into eight shifted flat views of a field."""

import warp as wp


@wp.func
def lesser(a: float, b: float):
    """Returns min(a, b) in one instruction: `wp.min` also checks for NaN."""
    return wp.where(a < b, a, b)


@wp.func
def greater(a: float, b: float):
    """Returns max(a, b) in one instruction; b if a is NaN."""
    return wp.where(a > b, a, b)


@wp.func
def within(x: float, low: float, high: float):
    """Clamps x to [low, high]; returns low for NaN."""
    return lesser(greater(x, low), high)


# Fields decay by a factor at each step until their floats are denormal, which are a hundred times slower.
_NEXT_TO_NOTHING = wp.constant(1e-20)


@wp.func
def settle(x: float):
    """Returns x, or 0 if x is negligible."""
    return wp.where(wp.abs(x) > _NEXT_TO_NOTHING, x, 0.0)


@wp.func
def base(x: float, n: int):
    """Returns the first of the two samples among 0 … n − 1 around x ≥ 0; 0 if there is only one."""
    return wp.min(int(x), wp.max(n - 2, 0))


@wp.func
def fraction(x: float, n: int):
    """Returns x minus its base, 0 to 1."""
    return x - float(base(x, n))


@wp.func
def shifted(a: wp.array3d[float], di: int, dj: int, dk: int):
    """Returns a flat view whose element n is the neighbour of a's element n; not shifted along axes of one sample."""
    ni = wp.where(a.shape[0] > 1, di, 0)
    nj = wp.where(a.shape[1] > 1, dj, 0)
    nk = wp.where(a.shape[2] > 1, dk, 0)
    shift = (ni * a.shape[1] + nj) * a.shape[2] + nk
    return wp.array(ptr=a.ptr + wp.uint64(4 * shift), shape=(a.shape[0] * a.shape[1] * a.shape[2],), dtype=float)


@wp.func
def corners(a: wp.array3d[float], x: float, y: float, z: float):
    """Returns the eight samples around (x, y, z), in sample indices within a: a_000 a_001 … a_111."""
    n = (base(x, a.shape[0]) * a.shape[1] + base(y, a.shape[1])) * a.shape[2] + base(z, a.shape[2])
    a000 = shifted(a, 0, 0, 0)
    a001 = shifted(a, 0, 0, 1)
    a010 = shifted(a, 0, 1, 0)
    a011 = shifted(a, 0, 1, 1)
    a100 = shifted(a, 1, 0, 0)
    a101 = shifted(a, 1, 0, 1)
    a110 = shifted(a, 1, 1, 0)
    a111 = shifted(a, 1, 1, 1)
    return a000[n], a001[n], a010[n], a011[n], a100[n], a101[n], a110[n], a111[n]


@wp.func
def blend(
    a000: float,
    a001: float,
    a010: float,
    a011: float,
    a100: float,
    a101: float,
    a110: float,
    a111: float,
    x: float,
    y: float,
    z: float,
):
    """Returns the trilinear interpolation of the corners of a unit cube at (x, y, z) in [0, 1]³."""
    a00 = a000 + z * (a001 - a000)
    a01 = a010 + z * (a011 - a010)
    a10 = a100 + z * (a101 - a100)
    a11 = a110 + z * (a111 - a110)
    a0 = a00 + y * (a01 - a00)
    a1 = a10 + y * (a11 - a10)
    return a0 + x * (a1 - a0)


@wp.func
def sample(a: wp.array3d[float], x: float, y: float, z: float):
    """Returns the trilinear value of a at (x, y, z), in sample indices within a."""
    a000, a001, a010, a011, a100, a101, a110, a111 = corners(a, x, y, z)
    fx = fraction(x, a.shape[0])
    fy = fraction(y, a.shape[1])
    fz = fraction(z, a.shape[2])
    return blend(a000, a001, a010, a011, a100, a101, a110, a111, fx, fy, fz)


@wp.func
def clamped_place(a: wp.array3d[float], x: float, y: float, z: float, lower: wp.vec3, upper: wp.vec3):
    """Clamps (x, y, z) to [lower, upper], then to the samples of a; returns that point and the weight of a there.

    The weight falls from 1 among the samples to 0 one sample outside them.
    """
    ex = within(x, lower[0], upper[0])
    ey = within(y, lower[1], upper[1])
    ez = within(z, lower[2], upper[2])
    cx = within(ex, 0.0, float(a.shape[0] - 1))
    cy = within(ey, 0.0, float(a.shape[1] - 1))
    cz = within(ez, 0.0, float(a.shape[2] - 1))
    return cx, cy, cz, (1.0 - wp.abs(ex - cx)) * (1.0 - wp.abs(ey - cy)) * (1.0 - wp.abs(ez - cz))


@wp.func
def mixed(ambient: float, value: float, inside: float):
    """Returns ambient outside (0), the value inside (1), and a mix in between."""
    return ambient + inside * (value - ambient)
