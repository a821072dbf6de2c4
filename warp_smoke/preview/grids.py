"""Grids of volume files, placed as on the stage."""

import numpy as np
from pxr import Usd, UsdVol

from warp_smoke.lattice import Lattice
from warp_smoke.vdb import read_vdb

# Voxels count as coincident within this share of a voxel.
_COINCIDENT = 1e-3


def vdb_field(volume: Usd.Prim, name: str) -> UsdVol.OpenVDBAsset | None:
    """Returns a field of a volume if it comes from a `.vdb` file, else None."""
    target = UsdVol.Volume(volume).GetFieldPath(name)
    field = UsdVol.OpenVDBAsset(volume.GetStage().GetPrimAtPath(target)) if target else None
    return field if field else None


def read_grid(volume: UsdVol.Volume, field: str, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Reads a volume's field at a frame: its values, and the matrix from voxel index to world position of the centre.

    Raises:
        ValueError: the volume has no such field, or its file no such grid.
    """
    asset = vdb_field(volume.GetPrim(), field)
    if asset is None:
        names = ", ".join(name.removeprefix("field:") for name in volume.GetPrim().GetPropertyNames() if ":" in name)
        raise ValueError(f"{volume.GetPath()}: has no field {field!r}; its fields: {names}")
    file = existing_file(asset.GetFilePathAttr(), number)
    name = asset.GetFieldNameAttr().Get(number)
    grids = read_vdb(file)
    if name not in grids:
        raise ValueError(f"{file}: has no grid {name!r}; its grids: {', '.join(grids)}")
    grid = grids[name]
    to_world = np.diag([*grid.voxel_size, 1.0])
    to_world[3, :3] = np.asarray(grid.origin) * grid.voxel_size + grid.translation
    return grid.values, to_world @ np.array(volume.ComputeLocalToWorldTransform(number))


def existing_file(asset: Usd.Attribute, number: int) -> str:
    """Returns the file that an attribute names at a frame.

    Raises:
        ValueError: there is none.
    """
    path = asset.Get(number)
    if not path or not path.resolvedPath:
        raise ValueError(f"{asset.GetPath()}: is {path} at frame {number}; allowed: a file that exists")
    return path.resolvedPath


def centers_to_world(lattice: Lattice) -> np.ndarray:
    """Returns the matrix from a cell's index (i, j, k) to its centre's world position, 4 × 4 row-vector, float64."""
    center_of_first = np.eye(4)
    center_of_first[3, :3] = 0.5
    return center_of_first @ lattice.cells_to_world()


def lay_over(
    shape: tuple[int, int, int], to_world: np.ndarray, values: np.ndarray, values_to_world: np.ndarray
) -> np.ndarray | None:
    """Copies another grid's values [nx, ny, nz, …] to the voxels of a grid of this shape, zero beyond its ends.

    Returns None if the grids' voxels do not coincide.
    """
    between = values_to_world @ np.linalg.inv(to_world)
    first = np.rint(between[3, :3]).astype(int)
    if np.abs(between - np.vstack([np.eye(4)[:3], [*first, 1]])).max() > _COINCIDENT:
        return None
    laid = np.zeros((*shape, *values.shape[3:]), np.float32)
    here, there = [], []
    for start, length, count in zip(first, values.shape, shape, strict=False):
        lower, upper = max(start, 0), max(min(start + length, count), 0)
        here.append(slice(lower, upper))
        there.append(slice(lower - start, max(upper - start, 0)))
    laid[tuple(here)] = values[tuple(there)]
    return laid
