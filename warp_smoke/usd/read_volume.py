"""Reading of smoke: the density of each `UsdVol.Volume` at a frame, from its `.vdb` file."""

from dataclasses import replace

import numpy as np
from pxr import Usd, UsdGeom, UsdVol

from warp_smoke.lattice import Lattice, place_lattice
from warp_smoke.record import read_only
from warp_smoke.scene import Scene, SmokeDomain
from warp_smoke.usd.volume import DOMAIN_RELATIONSHIP
from warp_smoke.vdb import read_vdb

# Relative difference between a voxel's sides that counts as rounding.
_CUBE = 1e-4
# Voxels count as the domain's own cells if they lie within this fraction of a cell of them.
_COINCIDENT = 1e-3


def read_volumes(stage: Usd.Stage, scene: Scene, frame: int) -> list[tuple[SmokeDomain, Lattice, np.ndarray]]:
    """Reads the visible smoke on a stage at a frame.

    Args:
        stage: the stage.
        scene: the scene read from it.
        frame: the frame.

    Returns:
        For each volume with a field `density`: the domain that it belongs to (a default one for volumes from other
        programs), the lattice of its voxels, and the density before `densityScale`, [nx, ny, nz] float32. Files hold
        only the voxels with smoke: the arrays cover the whole domain, or, if the voxels do not fit a domain, one empty
        voxel more on each side.

    Raises:
        ValueError: a file is missing or damaged, or its voxels are not cubes.
        OSError: a file cannot be read.
    """
    domains = {domain.path: domain for domain in scene.domains}
    found = []
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdVol.Volume) or UsdGeom.Imageable(prim).ComputeVisibility(frame) == "invisible":
            continue
        target = UsdVol.Volume(prim).GetFieldPath("density")
        field = UsdVol.OpenVDBAsset(stage.GetPrimAtPath(target)) if target else None
        if not field:
            continue
        paths = map(str, prim.GetRelationship(DOMAIN_RELATIONSHIP).GetTargets())
        own = next(filter(None, map(domains.get, paths)), None)
        domain = own or SmokeDomain(path=str(prim.GetPath()))
        density, to_world = _read_density(field, frame)
        if density.size:
            to_world = to_world @ np.array(UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(frame))
            lattice = _lattice(str(prim.GetPath()), density.shape, to_world, scene)
            density, lattice = _with_empty_around(density, lattice, own, scene)
            found.append((domain, lattice, density / np.float32(domain.density_scale)))
    return found


def _read_density(field: UsdVol.OpenVDBAsset, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Reads a field's values, and the 4 × 4 row-vector matrix from cell coordinates to the volume's space."""
    asset = field.GetFilePathAttr().Get(frame)
    if not asset or not asset.resolvedPath:
        name = field.GetFilePathAttr().GetPath()
        raise ValueError(f"{name}: is {asset} at frame {frame}; allowed: a file that exists")
    grids, name = read_vdb(asset.resolvedPath), field.GetFieldNameAttr().Get(frame)
    if name not in grids:
        raise ValueError(f"{asset.resolvedPath}: has no grid {name!r}; its grids: {', '.join(grids)}")
    grid = grids[name]
    matrix = np.diag([*grid.voxel_size, 1.0])
    # Voxel (0, 0, 0) has its centre at `translation`.
    matrix[3, :3] = (np.asarray(grid.origin) - 0.5) * grid.voxel_size + grid.translation
    return np.maximum(grid.values, np.float32(0.0)), matrix


def _with_empty_around(
    density: np.ndarray, lattice: Lattice, domain: SmokeDomain | None, scene: Scene
) -> tuple[np.ndarray, Lattice]:
    """Returns the density over its domain's whole lattice, or for other volumes with one empty voxel around it."""
    whole = lattice if domain is None else _lattice_of(domain, lattice.voxel_size, scene)
    offset = (lattice.cells_to_world() @ whole.world_to_cells())[3, :3]
    before = np.rint(offset).astype(int)
    after = np.subtract(whole.shape, before) - lattice.shape
    between = lattice.voxel_size * lattice.axes - whole.voxel_size * whole.axes
    drift = [np.abs(between).max() / lattice.voxel_size, *np.abs(offset - before)]
    if domain is None or max(drift) > _COINCIDENT or min(*before, *after) < 0:
        to_world = np.array(lattice.to_world)
        to_world[3, :3] -= lattice.voxel_size * lattice.axes.sum(axis=0)
        whole = replace(lattice, shape=tuple(n + 2 for n in density.shape), to_world=read_only(to_world, np.float64))
        before = after = np.ones(3, int)
    return np.pad(density, np.stack([before, after], axis=1)), whole


def _lattice_of(domain: SmokeDomain, voxel_size: float, scene: Scene) -> Lattice:
    """Returns the lattice of a domain at the resolution of a run with voxels of this size."""
    sides = np.linalg.norm(domain.transform_at(scene.start)[:3, :3], axis=1) * np.subtract(domain.upper, domain.lower)
    return place_lattice(scene, replace(domain, resolution=int(np.clip(round(sides.max() / voxel_size), 1, 4096))))


def _lattice(path: str, shape: tuple[int, ...], to_world: np.ndarray, scene: Scene) -> Lattice:
    sizes = np.linalg.norm(to_world[:3, :3], axis=1)
    axes = to_world[:3, :3] / sizes[:, None]
    if np.ptp(sizes) > _CUBE * sizes.max() or np.abs(axes @ axes.T - np.eye(3)).max() > _CUBE:
        raise ValueError(f"{path}: voxels measure {sizes.tolist()} in the world; allowed: cubes")
    placed = np.eye(4)
    placed[:3, :3], placed[3, :3] = axes, to_world[3, :3]
    return Lattice(
        shape=tuple(shape),
        voxel_size=float(sizes.mean()),
        to_world=read_only(placed, np.float64),
        meters_per_unit=scene.meters_per_unit,
        sides=("open",) * 6,
        up=tuple(axes @ scene.up),
    )
