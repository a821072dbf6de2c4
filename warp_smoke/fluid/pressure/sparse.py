"""Matrices of multigrid levels, on the host: of a level, of the next where walls split cells, and their inverses.

Coarse cells are pieces of 2 × 2 × 2 blocks that walls divide (C. Dick, M. Rogowsky, R. Westermann, 2015).
"""

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph

from warp_smoke.fluid.pressure.levels import Level


def level_matrix(level: Level, sides: tuple[str, ...]) -> scipy.sparse.csr_array:
    """−L over the cells of a level's arrays, between such sides; those around it are among them, with empty rows."""
    size, (_, ny, nz) = level.inverse.size, level.inverse.shape
    inner = np.zeros(level.inverse.shape, bool)
    inner[tuple(slice(1, n + 1) for n in level.shape)] = True
    inner = inner.ravel()
    same = np.arange(size).reshape(level.inverse.shape)  # as a cell that is a ghost
    for axis, n in enumerate(level.shape):
        if sides[2 * axis] == "periodic":
            along = np.moveaxis(same, axis, 0)
            along[0] = along[n]
    same = same.ravel()
    diagonal, rows, columns, values = np.zeros(size), [], [], []
    for axis, (weights, stride) in enumerate(zip(level.weights, (ny * nz, nz, 1), strict=True)):
        w = weights.numpy()
        if sides[2 * axis] == "periodic":  # its last faces are the first again
            w = w.copy()
            np.moveaxis(w, axis, 0)[level.shape[axis] + 1] = 0.0
        w = w.ravel()
        here = np.flatnonzero(w)
        below, w = same[here - stride], w[here].astype(np.float64)
        for cells in (here, below):
            diagonal += np.bincount(cells, weights=w * inner[cells], minlength=size)
        between = inner[here] & inner[below]
        here, below, w = here[between], below[between], w[between]
        rows += [here, below]
        columns += [below, here]
        values += [-w, -w]
    used = np.flatnonzero(diagonal)
    rows, columns = np.concatenate([*rows, used]), np.concatenate([*columns, used])
    entries = (np.concatenate([*values, diagonal[used]]), (rows, columns))
    return scipy.sparse.coo_array(entries, shape=(size, size)).tocsr()


def find_members(matrix, position: np.ndarray, upper: np.ndarray) -> scipy.sparse.csr_array:
    """1 where a cell (row) is a member of a coarse cell (column)."""
    block = position // 2
    key = np.ravel_multi_index((block - block.min(0)).T, np.ptp(block, 0) + 1)
    links = scipy.sparse.triu(matrix, 1).tocoo()
    inside = key[links.row] == key[links.col]
    pairs = (links.row[inside], links.col[inside])
    graph = scipy.sparse.coo_array((np.ones(len(pairs[0]), np.int8), pairs), shape=matrix.shape)
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    used = np.flatnonzero((matrix.diagonal() > 0) & np.all(position < upper, axis=1))
    _, column = np.unique(label[used], return_inverse=True)
    shape = (len(position), column.max(initial=-1) + 1)
    return scipy.sparse.csr_array((np.ones(len(used)), (used, column)), shape=shape)


def coarsen(matrix, position: np.ndarray, members: scipy.sparse.csr_array, period: np.ndarray) -> tuple:
    """−L of the coarse level, the prolongation to the fine one, and the coarse positions.

    Weights are means of four; a fine cell takes E + ¼ Σ W (E_neighbour − E) over the coarse neighbours on its side.
    """
    coarse = (0.25 * (members.T @ matrix @ members)).tocsr()
    coarse.data[np.abs(coarse.data) < 1e-6] = 0.0  # cells of which nothing leads out
    coarse.eliminate_zeros()
    rows, columns = members.nonzero()
    coarse_position = np.zeros((members.shape[1], 3), int)
    coarse_position[columns] = position[rows] // 2
    links = coarse.tocoo()
    step = coarse_position[links.col] - coarse_position[links.row]
    for axis, n in enumerate((period + 1) // 2):
        if n:  # around a periodic axis, the shorter way
            step[:, axis] = (step[:, axis] + n // 2) % n - n // 2
    neighbours = scipy.sparse.csr_array(members.shape)
    for axis in range(3):
        # Neighbours one further along this axis, and none along the others; for cells on that side.
        for side, away in enumerate((-1, 1)):
            chosen = (step[:, axis] == away) & (np.abs(step).sum(axis=1) == 1)
            entries = (-0.25 * links.data[chosen], (links.row[chosen], links.col[chosen]))
            on_side = scipy.sparse.diags_array((position[:, axis] % 2 == side).astype(float))
            neighbours += on_side @ members @ scipy.sparse.csr_array(entries, shape=coarse.shape)
    to_outside = 0.25 * np.clip(matrix.sum(axis=1), 0.0, 2.0)
    own = 1.0 - neighbours.sum(axis=1) - to_outside
    prolongation = (scipy.sparse.diags_array(own) @ members + neighbours).tocsr()
    prolongation.eliminate_zeros()
    return coarse, prolongation, coarse_position


def pseudo_inverse(matrix: np.ndarray) -> np.ndarray:
    """L⁺ of a symmetric semidefinite matrix L, float32, whose null space is constants on connected components.

    With their unit vectors N and any s ≠ 0, L⁺ = (L + s N Nᵀ)⁻¹ − N Nᵀ / s: several times faster than eigenvectors.
    """
    count, label = scipy.sparse.csgraph.connected_components(scipy.sparse.csr_array(matrix), directed=False)
    sums = np.bincount(label, matrix.sum(axis=1), minlength=count)
    closed = np.abs(sums) <= 1e-6 * np.abs(matrix).max(initial=0.0)
    null = (label[:, None] == np.flatnonzero(closed)) / np.sqrt(np.bincount(label, minlength=count))[closed]
    s = matrix.trace() / len(matrix) or 1.0
    return (np.linalg.inv(matrix + s * null @ null.T) - null @ null.T / s).astype(np.float32)
