"""Smoke in the form that DCCs read: a `.vdb` file for each frame, and a `UsdVol.Volume` prim that names them."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdVol, Vt

from warp_smoke.lattice import Lattice
from warp_smoke.record import Record, one_of
from warp_smoke.scene import GRIDS, SmokeDomain
from warp_smoke.usd.prims import check_frames, editable, free_path, set_over_time
from warp_smoke.vdb import Grid, write_vdb
from warp_smoke.vdb.grid import FLOAT_MAX
from warp_smoke.vdb.layout import LEAF

# Grid names that Blender, Houdini and Karma recognize.
GRID_NAMES = {"density": "density", "temperature": "temperature", "velocity": "vel", "light": "light"}
# On a volume: the domain whose smoke it holds, for what a volume cannot express, such as the extinction.
DOMAIN_RELATIONSHIP = "smokeVolume:domain"
# Voxels that dim light by less than this are left out; 100 of them in a row would dim it by 0.0001.
FAINTEST = 1e-6
# Velocity is kept this far around the smoke [voxels], for motion blur.
VELOCITY_MARGIN = 2
# Air that departs from the ambient temperature by less than this fraction of the largest departure is left out.
TEMPERATURE_SHARE = 1e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class VolumeResult(Record):
    """The volume files of one domain.

    Attributes:
        domain: the domain that holds the smoke.
        lattice: the placement of its voxels.
        grids: fields in the files: density, temperature, velocity, light.
        files: path of each frame's `.vdb`, relative to the results layer (`./volumes/…`); frames without gaps, since
            DCCs count through them.
    """

    domain: SmokeDomain
    lattice: Lattice
    grids: tuple[str, ...]
    files: Mapping[int, str]

    def __post_init__(self):
        for token in self.grids:
            one_of(self.domain.path, "grids", token, GRIDS)
        check_frames(self.domain.path, "files", self.files)


def write_volume(
    path: Path,
    domain: SmokeDomain,
    lattice: Lattice,
    density: np.ndarray | None,
    temperature: np.ndarray | None,
    velocity: np.ndarray | None,
    light: np.ndarray | None = None,
    threads: int = 1,
) -> int:
    """Writes one frame's smoke to a `.vdb` file, completely or not at all.

    The file is in lattice space: voxel (i, j, k) has its centre at (i + ½, j + ½, k + ½) · voxel_size. Velocities are
    along the lattice's axes in stage units per second of the stage, since renderers rotate them with the prim.

    Args:
        path: the file; its folder must exist.
        domain: for its density_scale, time_scale, extinction and ambient_temperature.
        lattice: the domain's cells.
        density: [nx, ny, nz] float32 at cell centres, or None to leave it out.
        temperature: [nx, ny, nz] float32 at cell centres, or None.
        velocity: [nx, ny, nz, 3] float32 at cell centres, along the lattice's axes [m/s], or None.
        light: [nx, ny, nz, 3] float32 at cell centres, linear RGB, black where there is no smoke, or None.
        threads: number of threads for compression.

    Returns:
        Size of the file [bytes].
    """
    grids = []
    place = {"voxel_size": lattice.voxel_size, "translation": (lattice.voxel_size / 2,) * 3}
    box, smoky = (slice(None),) * 3, None
    if density is not None:
        faintest = FAINTEST / (domain.extinction * lattice.h) if domain.extinction else 0.0
        smoky = ~(density <= faintest)  # NaN counts as smoke, so that it is not dropped silently
        box = _box_around(smoky, VELOCITY_MARGIN)
        smoky = smoky[box]
        scaled = density[box] * np.float32(domain.density_scale)
        grids.append(Grid(GRID_NAMES["density"], scaled, _first(box), active=smoky, **place))
    if temperature is not None:
        ambient = domain.ambient_temperature
        hottest = min(max(temperature.max() - ambient, ambient - temperature.min()), FLOAT_MAX)
        still = temperature <= np.float32(ambient + TEMPERATURE_SHARE * hottest)
        still &= temperature >= np.float32(ambient - TEMPERATURE_SHARE * hottest)
        warm = ~still
        around = _box_around(warm, 0)
        kind = {"background": ambient, "active": warm[around]}
        grids.append(Grid(GRID_NAMES["temperature"], temperature[around], _first(around), **kind, **place))
    if velocity is not None:
        near = None if smoky is None else _grown(smoky, VELOCITY_MARGIN)
        scaled = velocity[box] * np.float32(domain.time_scale / lattice.meters_per_unit)
        kind = {"grid_class": "unknown", "vector_type": "contravariant relative"}
        grids.append(Grid(GRID_NAMES["velocity"], scaled, _first(box), active=near, **kind, **place))
    if light is not None:
        grids.append(Grid(GRID_NAMES["light"], light, grid_class="unknown", **place))
    return write_vdb(path, grids, threads=threads)


def _box_around(mask: np.ndarray, margin: int) -> tuple[slice, slice, slice]:
    """Returns the smallest box of whole leaves around the mask [nx, ny, nz] and a margin of cells around it."""
    in_i = mask.any(axis=(1, 2))
    in_jk = mask.any(axis=0)
    return tuple(_span(line, margin) for line in (in_i, in_jk.any(axis=1), in_jk.any(axis=0)))


def _span(line: np.ndarray, margin: int) -> slice:
    found = line.nonzero()[0]
    if not len(found):
        return slice(0, 0)
    return slice(max(found[0] - margin, 0) // LEAF * LEAF, -(-(found[-1] + 1 + margin) // LEAF) * LEAF)


def _first(box: tuple[slice, slice, slice]) -> tuple[int, int, int]:
    return tuple(int(span.start or 0) for span in box)


def _grown(mask: np.ndarray, cells: int) -> np.ndarray:
    """Returns the mask [nx, ny, nz] dilated by a number of cells along each axis."""
    for axis in range(3):
        along = np.moveaxis(mask, axis, 0)
        mask = mask.copy()
        grown = np.moveaxis(mask, axis, 0)
        for cell in range(1, cells + 1):
            grown[cell:] |= along[:-cell]
            grown[:-cell] |= along[cell:]
    return mask


def define_volume(stage: Usd.Stage, result: VolumeResult) -> UsdVol.Volume:
    """Authors the volume of a domain in the stage's edit target.

    The domain's own prim is used if it is a Volume under a parent at rest, else a new `<Domain>_smoke` under the
    nearest ancestor at rest; a box that marks the domain is then no longer drawn. The lattice's transform is written
    relative to the parent, since Blender ignores `!resetXformStack!`.
    """
    domain = editable(stage, result.domain.path)
    parent = _resting_parent(domain)
    if domain.IsA(UsdVol.Volume) and parent == domain.GetParent():
        volume = UsdVol.Volume(domain)
    else:
        volume = UsdVol.Volume.Define(stage, free_path(parent, f"{domain.GetName()}_smoke"))
        if domain.IsA(UsdGeom.Gprim):
            UsdGeom.Imageable(domain).CreatePurposeAttr(UsdGeom.Tokens.guide)

    lattice = result.lattice
    parent_to_world = UsdGeom.XformCache(min(result.files)).GetLocalToWorldTransform(parent)
    operation = UsdGeom.XformOp(
        volume.GetPrim().CreateAttribute("xformOp:transform:lattice", Sdf.ValueTypeNames.Matrix4d, False)
    )
    operation.Set(Gf.Matrix4d(lattice.to_world.tolist()) * parent_to_world.GetInverse())
    volume.SetXformOpOrder([operation])
    upper = [n * lattice.voxel_size for n in lattice.shape]
    volume.CreateExtentAttr(Vt.Vec3fArray([Gf.Vec3f(0.0), Gf.Vec3f(upper)]))
    volume.GetPrim().CreateRelationship(DOMAIN_RELATIONSHIP).SetTargets([domain.GetPath()])
    for token in result.grids:
        _define_field(volume, token, result.files)
    return volume


def _define_field(volume: UsdVol.Volume, token: str, files: Mapping[int, str]) -> None:
    name = GRID_NAMES[token]
    field = UsdVol.OpenVDBAsset.Define(volume.GetPrim().GetStage(), volume.GetPath().AppendChild(name))
    volume.CreateFieldRelationship(name, field.GetPath())
    field.CreateFieldNameAttr(name)
    if token == "velocity":
        field.CreateFieldDataTypeAttr("half3")
        field.CreateVectorDataRoleHintAttr("Vector")
    elif token == "light":
        field.CreateFieldDataTypeAttr("half3")
        field.CreateVectorDataRoleHintAttr("Color")
    else:
        field.CreateFieldDataTypeAttr("half")
        field.CreateFieldClassAttr("fogVolume")
    set_over_time(field.CreateFilePathAttr(), files)


def _resting_parent(prim: Usd.Prim) -> Usd.Prim:
    """Returns the nearest ancestor at rest: neither it nor anything above it moves or is a gprim."""
    prefixes = prim.GetPath().GetParentPath().GetPrefixes()
    ancestors = map(prim.GetStage().GetPrimAtPath, prefixes)
    resting = list(takewhile(_rests, ancestors))
    return resting[-1] if resting else prim.GetStage().GetPseudoRoot()


def _rests(prim: Usd.Prim) -> bool:
    moves = UsdGeom.Xformable(prim) and UsdGeom.Xformable(prim).TransformMightBeTimeVarying()
    return not moves and not prim.IsA(UsdGeom.Gprim)
