"""Periodic sides: layers of ghost cells around a copy of a field, which repeat the cells at its other end.

With them, kernels that know nothing of periodic sides find neighbours everywhere. Faces on a periodic side are stored
twice, as the first and the last of their axis, and have the same velocity.
"""

import warp as wp

from warp_smoke.fluid.grid import Block, Box, Patch, beside, face_shape, ghost_samples, make_patch
from warp_smoke.launch import Launcher, Rows, bits, dense_store

wp.set_module_options({"enable_backward": False})

_Shape = tuple[int, int, int]


@wp.kernel
def _copy(rows: Rows, block: Block, a: wp.array3d[float], a_out: wp.array3d[float]):
    """Copy: a_out(x) = a(x − before)."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    src = beside(a, block.before)
    out = dense_store(a_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        out[i, j, k] = bits(src[i, j, k])
        k += 1


def copy_samples(launcher: Launcher, patches: list[Patch], field: wp.array, target: wp.array) -> None:
    """Copies to each sample of the patches the sample at sample − before.

    Args:
        launcher: where it runs.
        patches: patches to copy, one after the other.
        field: read.
        target: written; may be the field.
    """
    for shape, block in patches:
        launcher.launch(_copy, shape, block, field, target)


class Halo:
    """Ghost cells of one lattice.

    Attributes:
        layers: layers of ghost cells at both ends of each axis; 0 along axes that are not periodic.
        shape: cells along each axis, including ghosts.
        whole: all cells except ghosts, in indices that do not count ghosts.
    """

    def __init__(self, launcher: Launcher, shape: _Shape, sides: tuple[str, ...], width: int):
        """Prepares.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz).
            sides: open, closed or periodic for each of -x +x -y +y -z +z.
            width: layers at both ends of periodic axes.
        """
        self._launcher, self.whole = launcher, Box((0, 0, 0), tuple(shape))
        self.layers = tuple(width if side == "periodic" else 0 for side in sides[0::2])
        self.shape = tuple(n + 2 * g for n, g in zip(shape, self.layers, strict=True))
        self._ghosts = {axis: ghost_samples(self.shape, self.layers, axis) for axis in (None, 0, 1, 2)}

    def zeros(self, label: str, axis: int | None = None) -> wp.array:
        """Allocates an array with room for ghosts, at cell centres or on the faces across an axis."""
        return self._launcher.zeros(self.shape if axis is None else face_shape(self.shape, axis), label)

    def pad(self, field: wp.array, padded: wp.array, axis: int | None = None) -> wp.array:
        """Copies a field into an array with ghosts and fills the ghosts; returns that array."""
        patch = make_patch(self.layers, field.shape, self.layers, self.layers)
        copy_samples(self._launcher, [patch], field, padded)
        self.fill(padded, axis)
        return padded

    def fill(self, padded: wp.array, axis: int | None = None) -> None:
        """Fills the ghosts of a field, which repeat its ends."""
        copy_samples(self._launcher, self._ghosts[axis], padded, padded)

    def crop(self, padded: wp.array, field: wp.array) -> None:
        """Copies a field out of an array with ghosts."""
        back = tuple(-g for g in self.layers)
        copy_samples(self._launcher, [make_patch((0, 0, 0), field.shape, back, back)], padded, field)

    def pad_box(self, box: Box) -> Box:
        """Returns a box in indices with ghosts; along periodic axes that it fills, with the ghost cell before it."""
        lower, upper = [], []
        for low, high, n, g in zip(*box, self.whole.upper, self.layers, strict=True):
            lower.append(low + g - int(g > 0 and high - low == n))
            upper.append(high + g)
        return Box(tuple(lower), tuple(upper))


def join_seams(launcher: Launcher, shape: _Shape, sides: tuple[str, ...], velocity: tuple) -> None:
    """Gives the last faces of periodic axes the velocity of the first, which are the same faces.

    Args:
        launcher: where it runs.
        shape: cells along each axis (nx, ny, nz).
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        velocity: u, v, w on faces [m/s], changed.
    """
    for axis, component in enumerate(velocity):
        if sides[2 * axis] == "periodic":
            copy_samples(launcher, [last_faces(shape, axis)], component, component)


def last_faces(shape: _Shape, axis: int) -> Patch:
    """Returns the last faces across a periodic axis; `before` leads from them to the first."""
    back = tuple(n * (a == axis) for a, n in enumerate(shape))
    count = tuple(1 if a == axis else n for a, n in enumerate(shape))
    return make_patch(back, count, back, back)
