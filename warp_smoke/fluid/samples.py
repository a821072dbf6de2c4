"""Which samples of a field are advected, which are left unchanged, and which are copied from others."""

from math import prod

import warp as wp

from warp_smoke.fluid.grid import (
    Box,
    Patch,
    all_cells,
    around,
    box_of,
    common,
    face_shape,
    ghost_samples,
    grown,
    inner_faces,
    patch_of,
    side_faces_from_within,
)


class Samples:
    """The samples of one field.

    Attributes:
        shape: shape of the field.
        carried: the samples to advect: active cells, or faces between active cells; no faces on the domain's sides.
        kept: the other samples within the domain, which are left unchanged.
        few: whether fewer are carried than kept.
        continued: faces on open sides, which copy the next face inside; then ghosts.
        thin: whether there is no face inside, in a domain one cell thick.
        clamped: first and last sample along each axis, as lower and upper limits.
        limits: the same, but one sample farther out on open sides.
    """

    def __init__(self, cells: tuple, sides: tuple[str, ...], layers: tuple[int, int, int], axis: int | None):
        self.shape = cells if axis is None else face_shape(cells, axis)
        self.continued = [] if axis is None else side_faces_from_within(cells, sides, axis)
        self.continued += ghost_samples(cells, layers, axis)
        every = all_cells(cells) if axis is None else inner_faces(cells, axis)
        # Of the two copies of faces on a periodic side, the first are carried and the last are ghosts.
        own = Box(layers, tuple(n - g if g else m for n, g, m in zip(cells, layers, self.shape, strict=True)))
        self._inside, self._layers, self._near = patch_of(common(box_of(every), own), every), layers, {}
        self._active = None  # the box of cells, once there is one
        self.carried, self.kept, self.few, self.thin = self._inside, [], False, 0 in self._inside.shape
        last = [n - 1 for n in self.shape]
        out = [int(side == "open") for side in sides]
        self.clamped = wp.vec3(0.0, 0.0, 0.0), wp.vec3(*last)
        self.limits = wp.vec3(*(-n for n in out[0::2])), wp.vec3(*(n + m for n, m in zip(last, out[1::2], strict=True)))

    def activate(self, cells: Box) -> None:
        """Limits the carried samples to cells in a box, or faces between two cells in it."""
        if cells == self._active:
            return
        self._active = cells
        inside, before = box_of(self._inside), tuple(self._inside.block.before)
        lower = tuple(max(a, b + step) for a, b, step in zip(inside.lower, cells.lower, before, strict=True))
        upper = (max(a, min(b, c)) for a, b, c in zip(lower, inside.upper, cells.upper, strict=True))
        active = Box(lower, tuple(upper))
        self.carried = patch_of(active, self._inside)
        self.kept, self._near = self._around(active, inside), {}
        self.few = 2 * prod(self.carried.shape) < prod(self._inside.shape)

    def near(self, distance: int) -> list[Patch]:
        """Returns the kept samples within a distance of the carried ones."""
        if distance not in self._near:
            active, inside = box_of(self.carried), box_of(self._inside)
            close = common(grown(active, distance, self.shape), inside)
            # Ghosts beside the box repeat samples from the other end of a periodic axis.
            ends = zip(*close, *inside, self._layers, strict=True)
            spans = [(first, stop) if ghosts else (low, high) for low, high, first, stop, ghosts in ends]
            lower, upper = zip(*spans, strict=True)
            self._near[distance] = self._around(active, Box(lower, upper))
        return self._near[distance]

    def _around(self, inner: Box, outer: Box) -> list[Patch]:
        return [patch_of(box, all_cells(self.shape)) for box in around(inner, outer)]

    @property
    def alone(self) -> Patch:
        """The carried samples, without offsets to adjacent cells."""
        return patch_of(box_of(self.carried), all_cells(self.shape))
