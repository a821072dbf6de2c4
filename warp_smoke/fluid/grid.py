"""Samples of a staggered (MAC) grid: which samples a launch covers, and which cells lie beside them.

Density and temperature sit at cell centres, [nx, ny, nz]; velocity components on faces, u [nx+1, ny, nz],
v [nx, ny+1, nz], w [nx, ny, nz+1] (F. H. Harlow, J. E. Welch, 1965). A kernel over a `Block` runs for any of them:

    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end: ...  # the sample is a[i, j, k], the cells beside it beside(b, block.before)[i, j, k] and … after
"""

from typing import NamedTuple

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Block:
    """A block of samples, and where the cells on either side of each lie: cell = sample − before, sample − after.

    At cell centres both are the cell itself.
    """

    first: wp.vec3i
    stop: int
    before: wp.vec3i
    after: wp.vec3i


@wp.func
def beside(a: wp.array3d[float], offset: wp.vec3i):
    """View of a field of the cells in which element (i, j, k) is its element (i, j, k) − offset.

    The offset goes into the pointer: in an index it would keep LLVM from vectorising.
    """
    shift = (offset[0] * a.shape[1] + offset[1]) * a.shape[2] + offset[2]
    start = a.ptr - wp.uint64(4) * wp.uint64(shift)
    return wp.array(ptr=start, shape=(a.shape[0], a.shape[1], a.shape[2]), dtype=float)


class Patch(NamedTuple):
    """A block and its size, for `Launcher.launch`."""

    shape: tuple[int, int, int]
    block: Block


def make_patch(first: tuple, shape: tuple, before: tuple, after: tuple) -> Patch:
    """The samples from `first` on."""
    block = Block()
    block.first, block.stop = wp.vec3i(*first), first[2] + shape[2]
    block.before, block.after = wp.vec3i(*before), wp.vec3i(*after)
    return Patch(tuple(shape), block)


def face_shape(shape: tuple[int, int, int], axis: int) -> tuple[int, int, int]:
    """Samples of the velocity component along an axis."""
    return tuple(n + (a == axis) for a, n in enumerate(shape))


def cell_patches(shape: tuple[int, int, int]) -> list[Patch]:
    """All cells, as one patch."""
    here = (0, 0, 0)
    return [make_patch(here, shape, here, here)]


def face_patches(shape: tuple[int, int, int], sides: tuple[str, ...], axis: int) -> list[Patch]:
    """The faces across an axis that air may pass: those between cells, and those on open sides (beside one cell)."""
    unit = tuple(int(a == axis) for a in range(3))
    here = (0, 0, 0)
    between = tuple(n - step for n, step in zip(shape, unit, strict=True))
    side = tuple(1 if step else n for n, step in zip(shape, unit, strict=True))
    patches = []
    if 0 not in between:
        patches.append(make_patch(unit, between, unit, here))
    if sides[2 * axis] == "open":
        patches.append(make_patch(here, side, here, here))
    if sides[2 * axis + 1] == "open":
        last = tuple(n * step for n, step in zip(shape, unit, strict=True))
        patches.append(make_patch(last, side, unit, unit))
    return patches
