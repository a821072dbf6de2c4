"""Images of colliders in periodic domains: a part that leaves through a periodic side enters at the other end."""

from dataclasses import replace
from itertools import product
from math import floor

import numpy as np

from warp_smoke.geometry import transform_points
from warp_smoke.lattice import Lattice
from warp_smoke.record import each_value, read_only
from warp_smoke.scene import Collider


def images(lattice: Lattice, prim: Collider) -> list[Lattice]:
    """Returns one lattice for each image of a mesh in it, shifted by whole domains along periodic axes.

    Along an axis on which the mesh is longer than the domain there is only the mesh itself.
    """
    if "periodic" not in lattice.sides:
        return [lattice]
    lower, upper = _reach(lattice, prim)
    shifts = []
    for n, side, low, high in zip(lattice.shape, lattice.sides[0::2], lower, upper, strict=True):
        # A mesh half a cell outside may still close the faces on a side.
        first, last = floor((low.min() - 0.5) / n), floor((high.max() + 0.5) / n)
        once = side != "periodic" or (high - low).max() > n
        shifts.append((0,) if once else range(first, last + 1))
    return [_shifted(lattice, shift) for shift in product(*shifts)]


def _reach(lattice: Lattice, prim: Collider) -> tuple[np.ndarray, np.ndarray]:
    """Returns the bounds of all points at all times, along each axis for every transform sample, [3, t] [cells]."""
    points = each_value(prim.mesh.points).reshape(-1, 3)
    if not len(points):
        return np.zeros((3, 1)), np.zeros((3, 1))
    ends = points.min(axis=0).astype(float), points.max(axis=0).astype(float)
    corners = np.where(np.indices((2, 2, 2)).reshape(3, 8).T, ends[1], ends[0])
    to_cells = lattice.world_to_cells()
    placed = np.array([transform_points(matrix @ to_cells, corners) for matrix in each_value(prim.transform)])
    return placed.min(axis=1).T - prim.thickness, placed.max(axis=1).T + prim.thickness


def _shifted(lattice: Lattice, shift: tuple[int, int, int]) -> Lattice:
    """Returns the lattice shifted by a number of domains along each axis."""
    if not any(shift):
        return lattice
    to_world = lattice.to_world.copy()
    to_world[3, :3] += np.multiply(shift, lattice.shape) * lattice.voxel_size @ lattice.axes
    return replace(lattice, to_world=read_only(to_world, np.float64))
