"""Checks of what DCCs need from a stage but the public validators do not look at.

Tests with planted faults showed what usd-core 26.11 and usd-validation-nvidia 1.22 miss: files missing at one frame,
volume fields, tokens, unknown inputs.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache

import numpy as np
from pxr import Sdf, Sdr, Usd, UsdGeom, UsdLux, UsdShade, UsdVol

from warp_smoke.usd.schema import schema_attributes
from warp_smoke.vdb import read_grid_bounds

SOURCE = "warp-smoke"
# An extent may be too small by this fraction of its size: points are stored in single precision.
EXTENT_TOLERANCE = 1e-5
GridBounds = Callable[[str], dict[str, np.ndarray | None]]
_ASSETS = (Sdf.ValueTypeNames.Asset, Sdf.ValueTypeNames.AssetArray)
_TOKENS = (Sdf.ValueTypeNames.Token, Sdf.ValueTypeNames.TokenArray)


@dataclass(frozen=True)
class Problem:
    """Something wrong with a stage.

    Attributes:
        severity: error (some DCC reads it wrongly or not at all), warning or info.
        where: prim, property or file.
        message: what is wrong.
        source: the check that found it.
        part: where it comes from: the stage (`stage`), or the layers that a run wrote over it (`results`).
    """

    severity: str
    where: str
    message: str
    source: str = SOURCE
    part: str = "stage"

    def __str__(self) -> str:
        return f"{self.severity}: {self.where}: {self.message} [{self.source}]"


def check_stage(stage: Usd.Stage) -> Iterator[Problem]:
    """Yields the problems with asset paths, tokens, shader and light inputs, volumes and extents."""
    grid_bounds = cache(read_grid_bounds)  # fields share files
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        for attribute in prim.GetAuthoredAttributes():
            yield from _check_assets(attribute)
            yield from _check_tokens(attribute)
        yield from _check_inputs(prim)
        if prim.IsA(UsdVol.Volume):
            yield from _check_fields(prim)
            yield from _check_volume_extent(UsdVol.Volume(prim), grid_bounds)
        elif prim.IsA(UsdVol.OpenVDBAsset):
            yield from _check_frames(UsdVol.OpenVDBAsset(prim).GetFilePathAttr())
            yield from _check_grids(UsdVol.OpenVDBAsset(prim), grid_bounds)
        if prim.IsA(UsdGeom.Gprim):
            yield from _check_extent(UsdGeom.Boundable(prim))


def _values(attribute: Usd.Attribute) -> list[object]:
    """Returns the default and the time samples, those that exist; for an array, their elements."""
    times = (Usd.TimeCode.Default(), *attribute.GetTimeSamples())
    values = [value for value in map(attribute.Get, times) if value is not None]
    if attribute.GetTypeName().isArray:
        return [element for value in values for element in value]
    return values


def _check_assets(attribute: Usd.Attribute) -> Iterator[Problem]:
    """Checks that each file that an attribute names exists; for `<UDIM>`, at least one tile."""
    # Renderers find the sources of their own shaders in places that only they know.
    if attribute.GetTypeName() not in _ASSETS or attribute.GetNamespace().startswith("info"):
        return
    layers = [spec.layer for spec in attribute.GetPropertyStack()]
    for asset in dict.fromkeys(asset for asset in _values(attribute) if asset.path and not asset.resolvedPath):
        udim = UsdShade.UdimUtils.IsUdimIdentifier(asset.path)
        if not (udim and any(UsdShade.UdimUtils.ResolveUdimPath(asset.path, layer) for layer in layers)):
            yield Problem("error", str(attribute.GetPath()), f"there is no file {asset.path}")


def _check_tokens(attribute: Usd.Attribute) -> Iterator[Problem]:
    """Checks that a token is one of those that the schema allows."""
    if attribute.GetTypeName() not in _TOKENS:
        return
    allowed = attribute.GetMetadata("allowedTokens") or _smoke_tokens().get(attribute.GetName())
    yield from _check_allowed(attribute, allowed)


def _check_allowed(attribute: Usd.Attribute, allowed: list[str] | None) -> Iterator[Problem]:
    for value in dict.fromkeys(_values(attribute)):
        if allowed and value not in allowed:
            yield Problem("error", str(attribute.GetPath()), f"is {value}; allowed: {', '.join(allowed)}")


@cache
def _smoke_tokens() -> dict[str, tuple[str, ...]]:
    """Returns the smoke schemas' tokens, unknown to USD if a stage was opened before the schemas were registered."""
    return {
        name: attribute.allowed_tokens
        for attributes in schema_attributes().values()
        for name, attribute in attributes.items()
        if attribute.allowed_tokens
    }


def _check_inputs(prim: Usd.Prim) -> Iterator[Problem]:
    """Checks that shaders and lights have only `inputs:`, and shaders only values, that their definition lists."""
    inputs = prim.GetAuthoredPropertiesInNamespace("inputs")
    if prim.IsA(UsdShade.Shader):
        identifier = UsdShade.Shader(prim).GetShaderId()
        node = Sdr.Registry().GetShaderNodeByIdentifier(identifier) if identifier else None
        if not node:
            return  # a renderer's own
        names = node.GetShaderInputNames()
        for attribute in inputs:
            name = attribute.GetName().removeprefix("inputs:")
            if name not in names:
                text = f"{node.GetIdentifier()} has no such input; most renderers ignore it"
                yield Problem("warning", str(attribute.GetPath()), text)
            else:
                yield from _check_allowed(attribute, [value for value, _ in node.GetShaderInput(name).GetOptions()])
    elif prim.HasAPI(UsdLux.LightAPI):
        names = prim.GetPrimDefinition().GetPropertyNames()
        for attribute in inputs:
            if attribute.GetName() not in names:
                yield Problem("warning", str(attribute.GetPath()), "UsdLux has no such input; most renderers ignore it")


def _check_fields(volume: Usd.Prim) -> Iterator[Problem]:
    """Checks that each field of a volume is one prim, that all read the same files, and that there is an extent."""
    files = set()
    for relationship in volume.GetAuthoredPropertiesInNamespace("field"):
        targets = [volume.GetStage().GetPrimAtPath(path) for path in relationship.GetForwardedTargets()]
        if len(targets) != 1 or not targets[0] or not targets[0].IsA(UsdVol.VolumeFieldBase):
            yield Problem("error", str(relationship.GetPath()), "does not lead to a volume field")
        else:
            files.add(tuple(path.path for path in _values(UsdVol.FieldAsset(targets[0]).GetFilePathAttr())))
    if len(files) > 1:
        message = "its fields are in different files; Arnold reads only the first field's"
        yield Problem("warning", str(volume.GetPath()), message)
    if files and not UsdGeom.Boundable(volume).GetExtentAttr().HasAuthoredValue():
        yield Problem("error", str(volume.GetPath()), "a volume without an extent is not drawn")


def _check_frames(files: Usd.Attribute) -> Iterator[Problem]:
    """Checks that a volume's files are `.vdb`, one for each whole frame without gaps, and that there is a default."""
    where = str(files.GetPath())
    times = files.GetTimeSamples()
    if any(time != round(time) for time in times):
        yield Problem("error", where, "has a file between frames; Blender cannot play it")
    elif len(times) > 1 and list(times) != list(np.arange(times[0], times[0] + len(times))):
        missing = sorted(set(np.arange(times[0], times[-1])) - set(times))
        yield Problem("error", where, f"has no file for frame {missing[0]:g}; Blender cannot play it")
    if times and files.Get() is None:
        yield Problem("warning", where, "has no default value; readers that know no time find no file")
    if files.GetResolveInfo(times[0] if times else 0.0).GetSource() == Usd.ResolveInfoSourceValueClips:
        yield Problem("error", where, "comes from value clips; Blender cannot play it")
    for name in dict.fromkeys(path.path for path in _values(files)):
        if not name.endswith(".vdb"):
            yield Problem("error", where, f"is {name}; most DCCs read only .vdb")


def _check_grids(field: UsdVol.OpenVDBAsset, grid_bounds: GridBounds) -> Iterator[Problem]:
    """Checks that every file of a field can be read and holds its grid."""
    name = field.GetFieldNameAttr().Get()
    for path in _vdb_files(field):
        try:
            names = grid_bounds(path)
        except ValueError as error:
            yield Problem("error", path, str(error).removeprefix(f"{path}: "))
            continue
        if name not in names:
            message = f"has no grid {name}, which {field.GetPath()} reads; it has {', '.join(names)}"
            yield Problem("error", path, message)


def _check_volume_extent(volume: UsdVol.Volume, grid_bounds: GridBounds) -> Iterator[Problem]:
    """Checks that the extent of a volume holds the active voxels of all its files."""
    extent = volume.GetExtentAttr()
    if not extent.HasAuthoredValue() or extent.ValueMightBeTimeVarying():
        return
    for path in volume.GetFieldPaths().values():
        field = UsdVol.OpenVDBAsset.Get(volume.GetPrim().GetStage(), path)
        if not field or UsdGeom.Xformable(field).GetOrderedXformOps():
            continue
        for file in _vdb_files(field):
            with suppress(ValueError):  # reported by `_check_grids`
                needed = grid_bounds(file).get(field.GetFieldNameAttr().Get())
                if needed is not None and not _holds(extent.Get(), needed):
                    message = f"does not hold the grid {field.GetFieldNameAttr().Get()} of {file}; it would be culled"
                    yield Problem("error", str(extent.GetPath()), message)
                    return


def _vdb_files(field: UsdVol.OpenVDBAsset) -> list[str]:
    """Returns the existing `.vdb` files of a field, each once."""
    paths = [path.resolvedPath for path in _values(field.GetFilePathAttr())]
    return [path for path in dict.fromkeys(paths) if path.endswith(".vdb")]


def _check_extent(boundable: UsdGeom.Boundable) -> Iterator[Problem]:
    """Checks that an extent is authored, and holds the geometry at every sample of either."""
    extent = boundable.GetExtentAttr()
    points = UsdGeom.PointBased(boundable).GetPointsAttr()
    if not extent.HasAuthoredValue():
        if points:
            yield Problem("warning", str(boundable.GetPath()), "has no extent; every reader has to work it out")
        return
    times = {*extent.GetTimeSamples(), *(points.GetTimeSamples() if points else ())}
    for time in sorted(times) or [Usd.TimeCode.Default()]:
        needed = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, time)
        if needed and not _holds(extent.Get(time), needed):
            at = "" if isinstance(time, Usd.TimeCode) else f" at time {time:g}"
            yield Problem("error", str(extent.GetPath()), f"does not hold the geometry{at}; it would be culled")
            return


def _holds(extent: object, needed: object) -> bool:
    outer, inner = np.array(extent, np.float64), np.array(needed, np.float64)
    if outer.shape != (2, 3):
        return False
    slack = EXTENT_TOLERANCE * max(np.ptp(inner, axis=0).max(), np.abs(inner).max())
    return bool(np.all(outer[0] <= inner[0] + slack) and np.all(outer[1] >= inner[1] - slack))
