"""Views of the rows of the smoke's slices in memory."""

import warp as wp

wp.set_module_options({"enable_backward": False})

# Loops over rows use views that begin at their first element: LLVM then vectorises them. Views need a length.
_LONG = wp.constant(2**31 - 1)


@wp.struct
class Slices:
    """Where the density's elements (z, s, t) are in memory: at first + z · z_step + s · s_step + t.

    Attributes:
        smoky: whether row (z, s) has any smoke.
        size: number of cells along t.
    """

    smoky: wp.array2d[int]
    first: int
    z_step: int
    s_step: int
    size: int


@wp.func
def row_from(a: wp.array3d[float], first: int):
    """The elements of a contiguous array from `first` on."""
    return wp.array(ptr=a.ptr + wp.uint64(4) * wp.uint64(first), shape=(_LONG,), dtype=float)


@wp.func
def integers(a: wp.array2d[int], n: int):
    """The elements of row n of a contiguous table."""
    return wp.array(ptr=a.ptr + wp.uint64(4) * wp.uint64(n * a.shape[1]), shape=(_LONG,), dtype=int)


@wp.func
def flags_from(a: wp.array3d[int], n: int, p: int, first: int):
    """The elements of row (n, p) of a contiguous array of flags from `first` on."""
    offset = (n * a.shape[1] + p) * a.shape[2] + first
    return wp.array(ptr=a.ptr + wp.uint64(4) * wp.uint64(offset), shape=(_LONG,), dtype=int)


@wp.func
def row_store(a: wp.array3d[float], n: int, p: int, first: int):
    """The elements of row (n, p) of a contiguous array from `first` on, as integers: see `dense_store`."""
    offset = (n * a.shape[1] + p) * a.shape[2] + first
    return wp.array(ptr=a.ptr + wp.uint64(4) * wp.uint64(offset), shape=(_LONG,), dtype=wp.int32)
