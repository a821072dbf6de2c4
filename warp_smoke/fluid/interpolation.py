"""Trilinear interpolation that LLVM vectorises: one integer base index into eight shifted flat views of a field."""

import warp as wp


@wp.func
def lesser(a: float, b: float):
    """min(a, b) as one instruction: `wp.min` also looks for NaN."""
    return wp.where(a < b, a, b)


@wp.func
def greater(a: float, b: float):
    """max(a, b) as one instruction; b where a is NaN."""
    return wp.where(a > b, a, b)


@wp.func
def within(x: float, low: float, high: float):
    """The number in [low, high] nearest to x; low for NaN."""
    return lesser(greater(x, low), high)


# Fields thin out by a factor at each step until their floats are denormal, which take a hundred times as long.
_NEXT_TO_NOTHING = wp.constant(1e-20)


@wp.func
def settle(x: float):
    """The number x, or 0 where that makes no difference."""
    return wp.where(wp.abs(x) > _NEXT_TO_NOTHING, x, 0.0)


@wp.func
def base(x: float, n: int):
    """First of the two samples 0 … n − 1 around x ≥ 0; 0 if there is only one."""
    return wp.min(int(x), wp.max(n - 2, 0))


@wp.func
def fraction(x: float, n: int):
    """How far x lies beyond its base, 0 to 1."""
    return x - float(base(x, n))


@wp.func
def shifted(a: wp.array3d[float], di: int, dj: int, dk: int):
    """Flat view in which element n is the neighbour of a's element n; not shifted along axes of one sample."""
    ni = wp.where(a.shape[0] > 1, di, 0)
    nj = wp.where(a.shape[1] > 1, dj, 0)
    nk = wp.where(a.shape[2] > 1, dk, 0)
    shift = (ni * a.shape[1] + nj) * a.shape[2] + nk
    return wp.array(ptr=a.ptr + wp.uint64(4 * shift), shape=(a.shape[0] * a.shape[1] * a.shape[2],), dtype=float)


@wp.func
def corners(a: wp.array3d[float], x: float, y: float, z: float):
    """The eight samples around (x, y, z), in sample indices within those of a: a_000 a_001 … a_111."""
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
    """Trilinear mean of the corners of a unit cube at (x, y, z) in [0, 1]³."""
    a00 = a000 + z * (a001 - a000)
    a01 = a010 + z * (a011 - a010)
    a10 = a100 + z * (a101 - a100)
    a11 = a110 + z * (a111 - a110)
    a0 = a00 + y * (a01 - a00)
    a1 = a10 + y * (a11 - a10)
    return a0 + x * (a1 - a0)


@wp.func
def sample(a: wp.array3d[float], x: float, y: float, z: float):
    """The value of a at (x, y, z), in sample indices within those of a."""
    a000, a001, a010, a011, a100, a101, a110, a111 = corners(a, x, y, z)
    fx = fraction(x, a.shape[0])
    fy = fraction(y, a.shape[1])
    fz = fraction(z, a.shape[2])
    return blend(a000, a001, a010, a011, a100, a101, a110, a111, fx, fy, fz)


@wp.func
def clamped_place(a: wp.array3d[float], x: float, y: float, z: float, lower: wp.vec3, upper: wp.vec3):
    """The place among the samples of a that is nearest to (x, y, z), and how much of that lies inside of them.

    Before that (x, y, z) is kept within [lower, upper].
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
    """Ambient outside, the value inside, and a share of each between."""
    return ambient + inside * (value - ambient)
