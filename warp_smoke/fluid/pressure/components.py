"""Components of fluid that touch no open side: the net divergence of each must be 0, as no pressure can change it."""

import numpy as np
import scipy.ndimage
import scipy.sparse.csgraph
import warp as wp

from warp_smoke.fluid.grid import Box, grown
from warp_smoke.fluid.pressure.sums import Sums, clear_part, dense_parts
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})

_CHUNK = 1024
# Capacity of lists is a multiple of this many cells and chunks, so that moving solids seldom need more.
_GRAIN, _CHUNK_GRAIN = 4096, 64
_ALL = slice(None)
# Along an axis: the cells before each inner face, those after it, and the face itself.
_CUTS = slice(None, -1), slice(1, None), slice(1, -1)


@wp.kernel
def _sum_rows(rows: Rows, field: wp.array3d[float], parts_out: wp.array3d[wp.float64]):
    """Computes the parts of Σ field."""
    i, _, c = wp.tid()
    i += rows.first
    a = dense(field)
    parts = dense_parts(parts_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, field.shape[2])
    clear_part(parts, 0, i, start, end)
    j = wp.int32(0)
    while j < field.shape[1]:
        k = start
        while k < end:
            parts[0, i, k] = parts[0, i, k] + wp.float64(a[i, j, k])
            k += 1
        j += 1


@wp.kernel
def _subtract_mean(rows: Rows, mean: float, fluid: wp.array3d[float], field_inout: wp.array3d[float]):
    """Subtracts fluid · mean from field."""
    i, j, c = wp.tid()
    i += rows.first
    f = dense(fluid)
    a = dense(field_inout)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, field_inout.shape[2])
    while k < end:
        a[i, j, k] = a[i, j, k] - f[i, j, k] * mean
        k += 1


@wp.func
def _flat(a: wp.array3d[float]):
    """Returns the same array as one row of cells."""
    return wp.array(ptr=a.ptr, shape=(a.shape[0] * a.shape[1] * a.shape[2],), dtype=float)


@wp.kernel
def _sum_chunks(
    rows: Rows,
    cells: wp.array[int],
    first: wp.array[int],
    field: wp.array3d[float],
    sums_out: wp.array[wp.float64],
):
    """sums_n = Σ field over cells first_n … first_(n+1) − 1 of the list."""
    n = rows.first + wp.tid()
    values = _flat(field)
    total = wp.float64(0.0)
    for m in range(first[n], first[n + 1]):
        total += wp.float64(values[cells[m]])
    sums_out[n] = total


@wp.kernel
def _subtract_from_chunks(
    rows: Rows, cells: wp.array[int], first: wp.array[int], means: wp.array[float], field_inout: wp.array3d[float]
):
    """Subtracts means_n from field at cells first_n … first_(n+1) − 1 of the list."""
    n = rows.first + wp.tid()
    values = _flat(field_inout)
    for m in range(first[n], first[n + 1]):
        values[cells[m]] = values[cells[m]] - means[n]


def label_components(fluid: np.ndarray, shares: tuple[np.ndarray, np.ndarray, np.ndarray]) -> tuple[np.ndarray, int]:
    """Numbers the components of fluid: cells of one are connected through open faces.

    Args:
        fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz].
        shares: wx, wy, wz, the open share of each face.

    Returns:
        The number of each cell's component from 1, 0 in solid cells, [nx, ny, nz]; and how many components there are.
    """
    cells = fluid > 0
    pairs = []  # per axis: the cells before and after each inner face, and which of these faces are open, which walls
    for axis, share in enumerate(shares):
        before, after, inner = (tuple(cut if a == axis else _ALL for a in range(3)) for cut in _CUTS)
        between = cells[before] & cells[after]
        opened = share[inner] > 0.0
        pairs.append((before, after, between & opened, between & ~opened))
    walled = np.zeros_like(cells)
    for before, after, _, walls in pairs:
        walled[before] |= walls
        walled[after] |= walls
    if not walled.any():
        return scipy.ndimage.label(cells)
    # Cells beside walls inside the fluid start on their own; then components that share an open face are joined.
    labels, found = scipy.ndimage.label(cells & ~walled)
    count = found + np.count_nonzero(walled)
    labels[walled] = np.arange(found + 1, count + 1)
    joined = []
    for before, after, opened, _ in pairs:
        meets = opened & (walled[before] | walled[after])
        joined.append((labels[before][meets], labels[after][meets]))
    a, b = (np.concatenate(ends) for ends in zip(*joined, strict=True))
    graph = scipy.sparse.coo_array((np.ones(len(a), bool), (a, b)), shape=(count + 1, count + 1))
    found, body = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return body[labels], found - 1


def _join_across_seams(
    labels: np.ndarray, found: int, shares: list[np.ndarray], sides: tuple[str, ...]
) -> tuple[np.ndarray, int]:
    """Joins components that share an open face on a periodic side."""
    pairs = [(np.zeros(0, int),) * 2]
    for axis, share in enumerate(shares):
        if sides[2 * axis] == "periodic":
            meets = share.take(0, axis) > 0.0
            pairs.append((labels.take(0, axis)[meets], labels.take(-1, axis)[meets]))
    a, b = (np.concatenate(ends) for ends in zip(*pairs, strict=True))
    graph = scipy.sparse.coo_array((np.ones(len(a), bool), (a, b)), shape=(found + 1, found + 1))
    count, body = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return body[labels], count - 1


class ClosedComponents:
    """The components of fluid, connected through open faces, that touch no open side.

    The main one, around all solids, is stored as the fluid minus the others, which are lists of cells in chunks.
    """

    def __init__(self, launcher: Launcher, sides: tuple[str, ...], fluid: wp.array):
        """Starts without any.

        Args:
            launcher: where it runs.
            sides: open, closed or periodic for each of -x +x -y +y -z +z.
            fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz]; read again by each `find`.
        """
        self._launcher, self._sides, self._fluid = launcher, sides, fluid
        self._main_size = 0  # cells of the main component if it is closed, else 0
        self._sizes, self._closed = np.zeros(0, int), np.zeros(0, bool)  # of the others
        self._chunk_component = np.zeros(0, int)
        self._total = Sums(launcher, fluid.shape, 1, "pressure")
        # Sized for the most there ever were: cells, first index of each chunk, sums and means of the chunks.
        self._cells, self._first = (launcher.zeros(0, "pressure", int) for _ in range(2))
        self._sums, self._means = launcher.zeros(0, "pressure", wp.float64), launcher.zeros(0, "pressure")

    def find(self, shares: tuple[wp.array, wp.array, wp.array], solids: Box) -> None:
        """Finds the components.

        Args:
            shares: wx, wy, wz, the open share of each face, [nx+1, ny, nz], [nx, ny+1, nz], [nx, ny, nz+1].
            solids: box outside which all cells are fluid and no face is closed except on sides of the domain.
        """
        if "periodic" in self._sides:  # the fluid around solids at one end may be divided by those at the other
            solids = Box((0, 0, 0), self._fluid.shape)
        # Around the solids is a layer of fluid that is connected in the same way as all the fluid beyond it.
        shape, part = self._fluid.shape, grown(solids, 1, self._fluid.shape)
        cells = tuple(slice(*ends) for ends in zip(*part, strict=True))
        faces = [
            share.numpy()[tuple(slice(cut.start, cut.stop + (a == axis)) for a, cut in enumerate(cells))]
            for axis, share in enumerate(shares)
        ]
        labels, found = label_components(self._fluid.numpy()[cells], faces)
        if "periodic" in self._sides:
            labels, found = _join_across_seams(labels, found, faces, self._sides)
        closed, goes_on = np.ones(found + 1, bool), np.zeros(found + 1, bool)
        closed[0] = False
        for side, token in enumerate(self._sides):
            last, axis = -(side % 2), side // 2
            outermost = labels.take(last, axis)
            ends_before = part.upper[axis] < shape[axis] if side % 2 else part.lower[axis] > 0
            if ends_before:
                goes_on[outermost] = True
            elif token == "open":
                outermost = outermost[faces[axis].take(last, axis) > 0]
            if token == "open":
                closed[outermost] = False
        if np.count_nonzero(goes_on) > 1:  # solids that reach from side to side divide the fluid beyond
            self.find(shares, Box((0, 0, 0), shape))
            return
        sizes = np.bincount(labels.ravel(), minlength=found + 1)
        main = int(np.argmax(goes_on)) or (1 + int(np.argmax(sizes[1:])) if found else 0)
        self._main_size = int(closed[main]) * int(sizes[main] + self._fluid.size - labels.size)
        listed = closed | bool(self._main_size)
        listed[[0, main]] = False
        self._list(labels, listed, closed, part)

    def _list(self, labels: np.ndarray, listed: np.ndarray, closed: np.ndarray, part: Box) -> None:
        """Stores lists of the cells of some components in a part of the domain."""
        inside = np.flatnonzero(listed[labels])
        component = (np.cumsum(listed) - 1)[labels.ravel()[inside]]
        self._sizes, self._closed = np.bincount(component), closed[listed]
        order = np.argsort(component.astype(np.min_scalar_type(len(listed))), kind="stable")  # small integers sort fast
        ends = np.cumsum(self._sizes)
        starts = [np.arange(end - size, end, _CHUNK) for size, end in zip(self._sizes, ends, strict=True)]
        self._chunk_component = np.repeat(np.arange(len(starts)), [len(each) for each in starts])
        chunks = len(self._chunk_component)
        if not chunks:
            return
        if len(inside) > self._cells.size:
            self._cells = self._launcher.zeros(-(-len(inside) // _GRAIN) * _GRAIN, "pressure", int)
        if chunks > self._sums.size:
            room = -(-chunks // _CHUNK_GRAIN) * _CHUNK_GRAIN
            self._first = self._launcher.zeros(room + 1, "pressure", int)
            self._sums = self._launcher.zeros(room, "pressure", wp.float64)
            self._means = self._launcher.zeros(room, "pressure")
        place = np.unravel_index(inside[order], labels.shape)
        cells = np.ravel_multi_index([n + low for n, low in zip(place, part.lower, strict=True)], self._fluid.shape)
        self._cells[: len(inside)].assign(cells.astype(np.int32))
        self._first[: chunks + 1].assign(np.concatenate([*starts, [len(inside)]]).astype(np.int32))

    def remove_means(self, field: wp.array) -> float:
        """Subtracts the mean over each closed component from a field [nx, ny, nz] that is 0 in solid cells.

        Returns:
            The largest absolute mean.
        """
        chunks, launcher, sums, main = len(self._chunk_component), self._launcher, np.zeros(0), 0.0
        if chunks:
            launcher.launch_each(_sum_chunks, chunks, self._cells, self._first, field, self._sums)
            sums = np.bincount(self._chunk_component, weights=self._sums.numpy()[:chunks])
        if self._main_size:
            launcher.launch(_sum_rows, self._total.launch_shape, field, self._total.parts)
            main = (self._total.sum(0) - sums.sum()) / self._main_size
            launcher.launch(_subtract_mean, field.shape, main, self._fluid, field)
        means = np.where(self._closed, sums / self._sizes, 0.0)
        if chunks:
            self._means[:chunks].assign((means - main)[self._chunk_component].astype(np.float32))
            launcher.launch_each(_subtract_from_chunks, chunks, self._cells, self._first, self._means, field)
        return float(np.abs([main, *means]).max())
