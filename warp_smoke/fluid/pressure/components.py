"""Bodies of fluid that no open side touches: the net divergence of each must be 0, for no pressure can change it."""

import numpy as np
import scipy.ndimage
import scipy.sparse.csgraph
import warp as wp

from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})

_CHUNK = 1024
_ALL = slice(None)
# Along an axis: the cells before each inner face, those after it, and the face itself.
_CUTS = slice(None, -1), slice(1, None), slice(1, -1)


@wp.func
def _flat(a: wp.array3d[float]):
    """The same array as one row of cells."""
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
    """Numbers the bodies of fluid: cells in one are connected through open faces.

    Args:
        fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz].
        shares: wx, wy, wz, the open share of each face.

    Returns:
        The number of each cell's body from 1, 0 in solid cells, [nx, ny, nz]; and how many there are.
    """
    cells = fluid > 0
    pairs = []  # per axis: the cells before and after each inner face, and which of these are open and which walls
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
    # Cells beside walls inside the fluid start on their own; then bodies that meet through an open face are joined.
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


class ClosedComponents:
    """The components of fluid, connected through open faces, that no open side touches, as lists of cells in chunks."""

    def __init__(self, launcher: Launcher, sides: tuple[str, ...]):
        """Starts without any.

        Args:
            launcher: where it runs.
            sides: open or closed for each of -x +x -y +y -z +z.
        """
        self._launcher, self._sides = launcher, sides
        self._sizes = np.zeros(0, int)
        self._chunk_component = np.zeros(0, int)
        # Room for as many as there ever were: cells, the first of each chunk, sums and means of the chunks.
        self._cells, self._first = (launcher.zeros(0, "pressure", int) for _ in range(2))
        self._sums, self._means = launcher.zeros(0, "pressure", wp.float64), launcher.zeros(0, "pressure")

    def find(self, fluid: np.ndarray, shares: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Finds them.

        Args:
            fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz].
            shares: wx, wy, wz, the open share of each face, [nx+1, ny, nz], [nx, ny+1, nz], [nx, ny, nz+1].
        """
        labels, found = label_components(fluid, shares)
        closed = np.ones(found + 1, bool)
        closed[0] = False
        for side, token in enumerate(self._sides):
            if token == "open":
                last, axis = -(side % 2), side // 2
                closed[labels.take(last, axis)[shares[axis].take(last, axis) > 0]] = False
        inside = np.flatnonzero(closed[labels])
        component = (np.cumsum(closed) - 1)[labels.ravel()[inside]]
        self._sizes = np.bincount(component)
        order = np.argsort(component.astype(np.min_scalar_type(found)), kind="stable")  # small integers sort fast
        ends = np.cumsum(self._sizes)
        starts = [np.arange(end - size, end, _CHUNK) for size, end in zip(self._sizes, ends, strict=True)]
        self._chunk_component = np.repeat(np.arange(len(starts)), [len(each) for each in starts])
        first = np.concatenate([*starts, [len(inside)]])
        chunks = len(self._chunk_component)
        if len(inside) > self._cells.size:
            self._cells = self._launcher.zeros(len(inside), "pressure", int)
        if chunks > self._sums.size:
            self._first = self._launcher.zeros(chunks + 1, "pressure", int)
            self._sums = self._launcher.zeros(chunks, "pressure", wp.float64)
            self._means = self._launcher.zeros(chunks, "pressure")
        if chunks:
            self._cells[: len(inside)].assign(inside[order].astype(np.int32))
            self._first[: chunks + 1].assign(first.astype(np.int32))

    def remove_means(self, field: wp.array) -> float:
        """Takes its mean over each component off a field [nx, ny, nz].

        Returns:
            The largest absolute mean.
        """
        chunks = len(self._chunk_component)
        if not chunks:
            return 0.0
        self._launcher.launch_each(_sum_chunks, chunks, self._cells, self._first, field, self._sums)
        means = np.bincount(self._chunk_component, weights=self._sums.numpy()[:chunks]) / self._sizes
        self._means[:chunks].assign(means[self._chunk_component].astype(np.float32))
        self._launcher.launch_each(_subtract_from_chunks, chunks, self._cells, self._first, self._means, field)
        return float(np.abs(means).max())
