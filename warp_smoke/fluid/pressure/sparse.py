"""Operators of multigrid levels as graphs, on the host: of a level, of the next one if walls split cells; inverses.

Coarse cells are pieces of 2 × 2 × 2 blocks that walls divide (C. Dick, M. Rogowsky, R. Westermann, 2015).
"""

from math import prod
from typing import NamedTuple

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph

from warp_smoke.fluid.pressure.levels import Level


class Graph(NamedTuple):
    """The operator L e = Σ w (e_neighbour − e) of n cells.

    Attributes:
        links: w ≠ 0 between cells a < b, upper triangular [n, n].
        outside: Σ w of each cell over its faces to where e = 0, [n].
        position: position of each cell, [3, n]; neighbours are one apart along one axis.
        upper: position along each axis from which on cells have no coarse cell, as they are at an open side, [3, 1].
        period: number of cells along each periodic axis, 0 for other axes, [3].
    """

    links: scipy.sparse.csr_array
    outside: np.ndarray
    position: np.ndarray
    upper: np.ndarray
    period: np.ndarray

    def diagonal(self) -> np.ndarray:
        """Returns Σ w of each cell, [n]."""
        return self.links.sum(axis=0) + self.links.sum(axis=1) + self.outside

    def neighbours(self) -> scipy.sparse.csr_array:
        """Returns the links in both directions, [n, n]."""
        return (self.links + self.links.T).tocsr()

    def inverse(self) -> np.ndarray:
        """Returns the pseudo-inverse L⁺, [n, n] float32."""
        return pseudo_inverse((self.neighbours() - scipy.sparse.diags_array(self.diagonal())).toarray())


def level_graph(level: Level, sides: tuple[str, ...]) -> Graph:
    """Returns the operator of a level with these sides of the domain, with the cells in array order."""
    shape = level.shape
    cells = np.arange(prod(shape), dtype=np.int32).reshape(shape)
    outside = np.zeros(shape)
    ends = [], [], []
    for axis, (weights, n) in enumerate(zip(level.weights, shape, strict=True)):
        inside = tuple(slice(1, m + 1 + (a == axis)) for a, m in enumerate(shape))
        w = np.moveaxis(weights.numpy()[inside], axis, 0)
        along, leak = np.moveaxis(cells, axis, 0), np.moveaxis(outside, axis, 0)
        faces = [(along[:-1], along[1:], w[1:-1])]
        if sides[2 * axis] == "periodic":  # its last faces are the first ones
            faces.append((along[0], along[-1], w[0]))
        else:
            leak[0] += w[0]
            leak[-1] += w[n]
        for before, after, between in faces:
            opened = between != 0.0
            for part, values in zip(ends, (before, after, between), strict=True):
                part.append(values[opened])
    before, after, w = (np.concatenate(part) for part in ends)
    open_ends = list(zip(shape, sides[1::2], strict=True))
    upper = np.array([[n - n % 2 if side == "open" else n] for n, side in open_ends], np.int32)
    period = np.array([n if side == "periodic" else 0 for n, side in open_ends])
    position = np.indices(shape, np.int32).reshape(3, -1)
    return Graph(_upper_triangle(before, after, w, cells.size), outside.ravel(), position, upper, period)


def find_members(graph: Graph) -> np.ndarray:
    """Returns the coarse cell of each cell, −1 if it has none."""
    block = graph.position // 2
    key = np.ravel_multi_index(block, block.max(axis=1) + 1)
    links = graph.links.tocoo()
    inside = key[links.row] == key[links.col]
    pairs = (links.row[inside], links.col[inside])
    connected = scipy.sparse.coo_array((np.ones(len(pairs[0]), np.int8), pairs), shape=links.shape)
    count, label = scipy.sparse.csgraph.connected_components(connected, directed=False)
    used = (graph.diagonal() > 0.0) & np.all(graph.position < graph.upper, axis=0)
    taken = np.zeros(count, bool)
    taken[label[used]] = True
    return np.where(used, (np.cumsum(taken, dtype=np.int32) - 1)[label], -1)


def coarsen(graph: Graph, members: np.ndarray) -> tuple[Graph, scipy.sparse.csr_array]:
    """Returns the coarse level whose cells have these members, and the prolongation from it.

    Weights are means of four; a fine cell takes E + ¼ Σ W (E_neighbour − E) over the coarse neighbours on its side.
    """
    used = np.flatnonzero(members >= 0)
    own, size = members[used], members.max(initial=-1) + 1
    links = graph.links.tocoo()
    a, b = members[links.row], members[links.col]
    between = (a != b) & (a >= 0) & (b >= 0)
    coarse_links = _upper_triangle(a[between], b[between], 0.25 * links.data[between], size)
    outside = np.bincount(own, graph.outside[used], size)
    for inner, outer, ends in ((a, b, links.row), (b, a, links.col)):
        left = (inner >= 0) & (outer < 0)
        outside += np.bincount(members[ends[left]], links.data[left], size)
    position = np.zeros((3, size), np.int32)
    position[:, own] = graph.position[:, used] // 2
    coarse = Graph(coarse_links, 0.25 * outside, position, graph.upper // 2, (graph.period + 1) // 2)
    return coarse, _prolongation(graph, members, coarse)


def _prolongation(graph: Graph, members: np.ndarray, coarse: Graph) -> scipy.sparse.csr_array:
    """Returns the matrix of E + ¼ Σ W (E_neighbour − E) over the coarse neighbours on each cell's side of each axis."""
    used, size = np.flatnonzero(members >= 0), len(coarse.outside)
    own = members[used]
    links = coarse.neighbours().tocoo()
    step = coarse.position[:, links.col] - coarse.position[:, links.row]
    for axis, n in enumerate(coarse.period):
        if n:  # along a periodic axis, the shorter way round
            step[axis] = (step[axis] + n // 2) % n - n // 2
    # Links of a coarse cell in six directions, numbered 2 axis + 1 upwards and 2 axis downwards.
    straight = np.flatnonzero(np.abs(step).sum(axis=0) == 1)
    step = step[:, straight]
    direction = 2 * np.abs(step).argmax(axis=0) + (step.sum(axis=0) > 0)
    entries = (0.25 * links.data[straight], (6 * links.row[straight] + direction, links.col[straight]))
    directed = scipy.sparse.coo_array(entries, shape=(6 * size, size)).tocsr()
    # The three directions on a cell's side of each axis.
    wanted = 6 * own + 2 * np.arange(3, dtype=np.int32)[:, None] + graph.position[:, used] % 2
    sides = scipy.sparse.csr_array(
        (np.ones(wanted.size), wanted.T.ravel(), np.arange(0, wanted.size + 1, 3)), shape=(len(used), 6 * size)
    )
    neighbours = sides @ directed
    here = 1.0 - neighbours.sum(axis=1) - 0.25 * np.clip(graph.outside[used], 0.0, 2.0)
    itself = scipy.sparse.csr_array((here, own, np.arange(len(used) + 1)), shape=neighbours.shape)
    return spread_rows(itself + neighbours, used, len(members))


def spread_rows(matrix: scipy.sparse.csr_array, place: np.ndarray, room: int) -> scipy.sparse.csr_array:
    """Returns the matrix with its rows moved to ascending indices `place` among `room` rows, the others empty."""
    entries = np.zeros(room + 1, int)
    entries[place + 1] = np.diff(matrix.indptr)
    return scipy.sparse.csr_array((matrix.data, matrix.indices, np.cumsum(entries)), shape=(room, matrix.shape[1]))


def _upper_triangle(a: np.ndarray, b: np.ndarray, w: np.ndarray, size: int) -> scipy.sparse.csr_array:
    """Returns the links from the lower to the higher cell number; links between the same two cells are summed."""
    entries = (w.astype(np.float64), (np.minimum(a, b), np.maximum(a, b)))
    return scipy.sparse.coo_array(entries, shape=(size, size)).tocsr()


def pseudo_inverse(matrix: np.ndarray) -> np.ndarray:
    """Returns L⁺, float32, of a symmetric semidefinite L whose null space is constants on connected components.

    With N the unit vectors of that space and s ≠ 0, L⁺ = (L + s N Nᵀ)⁻¹ − N Nᵀ / s: several times faster than by
    eigenvectors.
    """
    count, label = scipy.sparse.csgraph.connected_components(scipy.sparse.csr_array(matrix), directed=False)
    sums = np.bincount(label, matrix.sum(axis=1), minlength=count)
    closed = np.abs(sums) <= 1e-6 * np.abs(matrix).max(initial=0.0)
    null = (label[:, None] == np.flatnonzero(closed)) / np.sqrt(np.bincount(label, minlength=count))[closed]
    s = matrix.trace() / len(matrix) or 1.0
    return (np.linalg.inv(matrix + s * null @ null.T) - null @ null.T / s).astype(np.float32)
