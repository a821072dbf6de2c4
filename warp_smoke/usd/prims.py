"""Access to prims, and animated values, for authoring results over a user's stage."""

from collections.abc import Mapping

from pxr import Sdf, Usd, UsdGeom

from warp_smoke.record import FieldError
from warp_smoke.uv_fit import BAKE_UVS

PAIRS = ("texCoord2f[]", "texCoord2d[]", "texCoord2h[]", "float2[]", "double2[]", "half2[]")


def editable(stage: Usd.Stage, path: str) -> Usd.Prim:
    """Returns the prim at a path, after making every native instance around it uninstanced, so that it can be edited.

    Raises:
        ValueError: there is no such prim.
    """
    prim = stage.GetPrimAtPath(path)
    if not prim:
        raise ValueError(f"{path}: no such prim on the stage, so it cannot be given results")
    while prim.IsInstanceProxy():
        instance = prim.GetParent()
        while instance.IsInstanceProxy():
            instance = instance.GetParent()
        instance.SetInstanceable(False)
        prim = stage.GetPrimAtPath(path)
    return prim


def free_path(parent: Usd.Prim, name: str) -> Sdf.Path:
    """Returns a free path for a new child: the name, with _2, _3, … appended if it is taken."""
    path = parent.GetPath().AppendChild(name)
    number = 2
    while parent.GetStage().GetPrimAtPath(path):
        path = parent.GetPath().AppendChild(f"{name}_{number}")
        number += 1
    return path


def check_frames(path: str, field: str, value: object) -> None:
    """Raises FieldError if a mapping over frames has a fractional frame, a gap, or no frame at all."""
    if not isinstance(value, Mapping):
        return
    frames = sorted(value)
    if not frames or frames != list(range(int(frames[0]), int(frames[0]) + len(frames))):
        raise FieldError(path, field, f"for frames {frames}", "whole frames without gaps, at least one")


def set_over_time(attribute: Usd.Attribute, value: object) -> None:
    """Sets a plain value; or of a mapping, the value at each frame, and the last one as the default.

    Readers that ignore time see the default. It is the last frame because smoke grows: the first would show none.
    """
    if not isinstance(value, Mapping):
        attribute.Set(value)
        return
    for frame in sorted(value):
        attribute.Set(value[frame], frame)
    attribute.Set(value[max(value)])


def uv_primvar(mesh: Usd.Prim) -> UsdGeom.Primvar | None:
    """Returns a mesh's own texture coordinates: the primvar `st`, else the first of pairs of numbers, else None."""
    primvars = [
        primvar
        for primvar in UsdGeom.PrimvarsAPI(mesh).FindPrimvarsWithInheritance()
        if primvar.HasValue() and str(primvar.GetTypeName()) in PAIRS and primvar.GetPrimvarName() != BAKE_UVS
    ]
    return next((one for one in primvars if one.GetPrimvarName() == "st"), primvars[0] if primvars else None)
