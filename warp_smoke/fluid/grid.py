"""Samples of a staggered (MAC) grid: which samples a launch covers, and which cells are adjacent to them.

Density and temperature sit at cell centres, [nx, ny, nz]; velocity components on faces, u [nx+1, ny, nz],
v [nx, ny+1, nz], w [nx, ny, nz+1] (F. H. Harlow, J. E. Welch, 1965). A kernel over a `Block` runs for any of them:

    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end: ...  # the sample is a[i, j, k], its cells are beside(b, block.before)[i, j, k] and … after
"""

from collections.abc import Iterable
from typing import NamedTuple

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Block:
    """A block of samples, and the cells on either side of each: cell = sample − before, sample − after.

    At cell centres both are the cell itself.
    """

    first: wp.vec3i
    stop: int
    before: wp.vec3i
    after: wp.vec3i


@wp.func
def beside(a: wp.array3d[float], offset: wp.vec3i):
    """Returns a view of a cell-centred field whose element (i, j, k) is the field's element (i, j, k) − offset.

    The offset is put into the pointer: in an index it would keep LLVM from vectorising.
    """
    shift = (offset[0] * a.shape[1] + offset[1]) * a.shape[2] + offset[2]
    start = a.ptr - wp.uint64(4) * wp.uint64(shift)
    return wp.array(ptr=start, shape=(a.shape[0], a.shape[1], a.shape[2]), dtype=float)


class Box(NamedTuple):
    """Samples from `lower` up to but excluding `upper`, each (i, j, k)."""

    lower: tuple[int, int, int]
    upper: tuple[int, int, int]


class Patch(NamedTuple):
    """A block and its size, for `Launcher.launch`."""

    shape: tuple[int, int, int]
    block: Block


def make_patch(first: tuple, shape: tuple, before: tuple, after: tuple) -> Patch:
    """Returns the patch of `shape` samples from `first` on."""
    block = Block()
    block.first, block.stop = wp.vec3i(*first), first[2] + shape[2]
    block.before, block.after = wp.vec3i(*before), wp.vec3i(*after)
    return Patch(tuple(shape), block)


def face_shape(shape: tuple[int, int, int], axis: int) -> tuple[int, int, int]:
    """Returns the shape of the velocity component along an axis."""
    return tuple(n + (a == axis) for a, n in enumerate(shape))


def all_cells(shape: tuple[int, int, int]) -> Patch:
    """Returns all cells; the cells beside each are the cell itself."""
    here = (0, 0, 0)
    return make_patch(here, shape, here, here)


def inner_faces(shape: tuple[int, int, int], axis: int) -> Patch:
    """Returns the faces across an axis that lie between two cells."""
    unit = _unit(axis)
    between = tuple(n - step for n, step in zip(shape, unit, strict=True))
    return make_patch(unit, between, unit, (0, 0, 0))


def side_faces(shape: tuple[int, int, int], sides: tuple[str, ...], axis: int) -> list[Patch]:
    """Returns the faces across an axis on each open side of the domain; both cells of a face are the one inside."""
    patches = []
    for first, count, _ in _open_sides(shape, sides, axis):
        inside = _unit(axis) if any(first) else (0, 0, 0)
        patches.append(make_patch(first, count, inside, inside))
    return patches


def side_faces_from_within(shape: tuple[int, int, int], sides: tuple[str, ...], axis: int) -> list[Patch]:
    """Like `side_faces`, but beside each is the next face inside, or the face itself in a domain one cell thick."""
    patches = []
    for first, count, inwards in _open_sides(shape, sides, axis):
        offset = tuple(-inwards * step * (shape[axis] > 1) for step in _unit(axis))
        patches.append(make_patch(first, count, offset, offset))
    return patches


def closed_ends(sides: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the sides with periodic ones closed, for code that treats periodic faces separately."""
    return tuple("closed" if side == "periodic" else side for side in sides)


def seam_faces(shape: tuple[int, int, int], sides: tuple[str, ...], axis: int) -> list[Patch]:
    """Returns both copies of the faces on a periodic side across an axis, if any; their two cells are the end cells."""
    if sides[2 * axis] != "periodic":
        return []
    unit = _unit(axis)
    n = shape[axis]
    count = tuple(1 if step else cells for cells, step in zip(shape, unit, strict=True))
    lower = make_patch((0, 0, 0), count, tuple((1 - n) * step for step in unit), (0, 0, 0))
    upper = make_patch(tuple(n * step for step in unit), count, unit, tuple(n * step for step in unit))
    return [lower, upper]


def ghost_samples(cells: tuple[int, int, int], layers: tuple[int, int, int], axis: int | None = None) -> list[Patch]:
    """Returns the ghost samples around a periodic field; `before` leads from each to the sample that it repeats.

    They must be filled in this order, as later ones repeat earlier ones.

    Args:
        cells: cells along each axis, including ghosts.
        layers: layers of ghost cells at both ends of each axis; 0 along axes that are not periodic.
        axis: axis across whose faces the field is sampled; None = at cell centres.
    """
    shape = list(cells if axis is None else face_shape(cells, axis))
    lower = list(layers)
    upper = [n - g if g else m for n, m, g in zip(cells, shape, layers, strict=True)]
    patches = []
    for a in (a for a in range(3) if layers[a]):
        first, stop, period = lower[a], upper[a], cells[a] - 2 * layers[a]
        back = tuple(period * step for step in _unit(a))
        ahead = tuple(-step for step in back)
        ends = [(max(end - period, 0), end, ahead) for end in range(first, 0, -period)]
        ends += [(start, min(start + period, shape[a]), back) for start in range(stop, shape[a], period)]
        for start, end, before in ends:
            lower[a], upper[a] = start, end
            count = tuple(high - low for low, high in zip(lower, upper, strict=True))
            patches.append(make_patch(tuple(lower), count, before, before))
        lower[a], upper[a] = 0, shape[a]
    return patches


def patch_of(box: Box, like: Patch) -> Patch:
    """Returns the samples in a box, with the same offsets to adjacent cells as another patch."""
    shape = tuple(max(high - low, 0) for low, high in zip(*box, strict=True))
    return make_patch(box.lower, shape, like.block.before, like.block.after)


def faces_of(box: Box, axis: int) -> Patch:
    """Returns all faces of a box of cells across an axis, without offsets to adjacent cells."""
    shape = tuple(high - low + (a == axis) for a, (low, high) in enumerate(zip(*box, strict=True)))
    return make_patch(box.lower, shape, (0, 0, 0), (0, 0, 0))


def box_of(patch: Patch) -> Box:
    """Returns the box of a patch's samples."""
    lower = tuple(patch.block.first)
    return Box(lower, tuple(low + n for low, n in zip(lower, patch.shape, strict=True)))


def hull(boxes: Iterable[Box | None]) -> Box | None:
    """Returns the smallest box around several; None if there are none."""
    some = [box for box in boxes if box is not None]
    if not some:
        return None
    lowers, uppers = zip(*some, strict=True)
    return Box(tuple(map(min, zip(*lowers, strict=True))), tuple(map(max, zip(*uppers, strict=True))))


def common(a: Box, b: Box) -> Box:
    """Returns the intersection of two boxes that overlap."""
    return Box(tuple(map(max, a.lower, b.lower)), tuple(map(min, a.upper, b.upper)))


def grown(box: Box, samples: int, shape: tuple[int, int, int]) -> Box:
    """Grows a box by a number of samples on each side, within a field of this shape."""
    lower = tuple(max(low - samples, 0) for low in box.lower)
    return Box(lower, tuple(min(high + samples, n) for high, n in zip(box.upper, shape, strict=True)))


def around(inner: Box, outer: Box) -> list[Box]:
    """Returns up to six boxes that make up a box without another one inside it."""
    boxes, (lower, upper) = [], outer
    for axis in range(3):
        for low, high in ((lower[axis], inner.lower[axis]), (inner.upper[axis], upper[axis])):
            if low < high:
                boxes.append(Box(_with(lower, axis, low), _with(upper, axis, high)))
        lower, upper = _with(lower, axis, inner.lower[axis]), _with(upper, axis, inner.upper[axis])
    return boxes


def _with(index: tuple, axis: int, value: int) -> tuple[int, int, int]:
    return (*index[:axis], value, *index[axis + 1 :])


def _unit(axis: int) -> tuple[int, int, int]:
    return tuple(int(a == axis) for a in range(3))


def _open_sides(shape: tuple[int, int, int], sides: tuple[str, ...], axis: int) -> list[tuple]:
    """Returns first face, shape and inward direction of each open side across an axis."""
    unit = _unit(axis)
    count = tuple(1 if step else n for n, step in zip(shape, unit, strict=True))
    last = tuple(n * step for n, step in zip(shape, unit, strict=True))
    both = ((0, 0, 0), count, 1), (last, count, -1)
    return [side for side, kind in zip(both, sides[2 * axis : 2 * axis + 2], strict=True) if kind == "open"]
