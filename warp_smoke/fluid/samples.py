"""Which samples of a field are carried, which stay as they are, and which follow from others."""

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
    """Where a field is sampled.

    Attributes:
        shape: of the field.
        carried: the samples that are carried: those between cells that are active; faces on the domain's sides are not.
        kept: the others within the domain, which stay as they are.
        few: whether fewer are carried than kept.
        continued: faces on open sides, which go on as the next face inside; then ghosts.
        thin: whether there is no face inside, in a domain one cell thick.
        clamped: first and last sample along each axis, lower and upper.
        limits: the same, but one sample farther out on open sides.
    """

    def __init__(self, cells: tuple, sides: tuple[str, ...], layers: tuple[int, int, int], axis: int | None):
        self.shape = cells if axis is None else face_shape(cells, axis)
        self.continued = [] if axis is None else side_faces_from_within(cells, sides, axis)
        self.continued += ghost_samples(cells, layers, axis)
        every = all_cells(cells) if axis is None else inner_faces(cells, axis)
        # Of the faces on a periodic side the first are carried, and the last are ghosts.
        own = Box(layers, tuple(n - g if g else m for n, g, m in zip(cells, layers, self.shape, strict=True)))
        self._inside, self._layers, self._near = patch_of(common(box_of(every), own), every), layers, {}
        self._active = None  # the box of cells, once there is one
        self.carried, self.kept, self.few, self.thin = self._inside, [], False, 0 in self._inside.shape
        last = [n - 1 for n in self.shape]
        out = [int(side == "open") for side in sides]
        self.clamped = wp.vec3(0.0, 0.0, 0.0), wp.vec3(*last)
        self.limits = wp.vec3(*(-n for n in out[0::2])), wp.vec3(*(n + m for n, m in zip(last, out[1::2], strict=True)))

    def activate(self, cells: Box) -> None:
        """Carries those samples alone that lie in a box of cells, or between two of them."""
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
        """Those of the kept samples that lie up to a distance from the carried ones."""
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
        """The carried samples, without the cells beside them."""
        return patch_of(box_of(self.carried), all_cells(self.shape))
