"""Records what a program that imports the results of a run should find, as read by usd-core and our own VDB reader.

    python scripts/blender_expected.py STAGE NAME

`NAME.json` has frames, grids, lights, camera and the baked floor; `NAME.npz` has the smoke of the last frame and the
floor's pictures. Positions are in the stage's world, Y up. `STAGE_dcc.usda`, next to the stage, selects the `dcc` look.
"""

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdShade, UsdVol

from warp_smoke.vdb import read_vdb


def main(path: str, name: str) -> None:
    """Writes both files, and the stage in its `dcc` look."""
    stage = Usd.Stage.Open(path)
    last = stage.GetEndTimeCode()
    prims = list(stage.Traverse())
    volume = next(UsdVol.Volume(prim) for prim in prims if prim.IsA(UsdVol.Volume))
    camera = next(UsdGeom.Camera(prim) for prim in prims if prim.IsA(UsdGeom.Camera))
    receiver = next(UsdGeom.Mesh(prim) for prim in prims if prim.HasAttribute("smokeBaked:lit"))
    expected = {
        "frames": [int(stage.GetStartTimeCode()), int(last)],
        "volume": describe_volume(volume),
        "lights": [describe_light(prim) for prim in prims if prim.HasAPI(UsdLux.LightAPI)],
        "camera": describe_camera(camera.GetPrim()),
        "receiver": describe_receiver(receiver.GetPrim()),
    }
    (grid,) = (grid for grid in read_vdb(file_at(stage, volume, "density", last)).values() if grid.name == "density")
    size = np.broadcast_to(grid.voxel_size, 3)
    place = np.diag([*size, 1.0])  # from voxel indices, whole numbers at centres
    place[3, :3] = grid.translation + size * grid.origin
    arrays = {"density": grid.values, "density_to_world": place @ to_world(volume.GetPrim())}
    for bake in ("lit", "smokeShadow"):
        file = receiver.GetPrim().GetAttribute(f"smokeBaked:{bake}").Get(last).resolvedPath
        arrays[bake] = np.asarray(Image.open(file))
    Path(f"{name}.json").write_text(json.dumps(expected, indent=2) + "\n")
    np.savez(f"{name}.npz", **arrays)

    other = Path(path).with_name(f"{Path(path).stem}_dcc.usda")
    stage.GetRootLayer().Export(str(other))
    look = Usd.Stage.Open(str(other))
    look.GetDefaultPrim().GetVariantSet("smokeLook").SetVariantSelection("dcc")
    look.Save()


def to_world(prim: Usd.Prim) -> np.ndarray:
    """Returns a prim's local-to-world matrix for row vectors, [4, 4]."""
    return np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))


def describe_volume(volume: UsdVol.Volume) -> dict:
    """Returns name, and the file of each frame by field."""
    files = {}
    for name, path in volume.GetFieldPaths().items():
        attribute = UsdVol.OpenVDBAsset.Get(volume.GetPrim().GetStage(), path).GetFilePathAttr()
        files[name] = {int(t): Path(attribute.Get(t).resolvedPath).name for t in attribute.GetTimeSamples()}
    return {"name": volume.GetPrim().GetName(), "files": files}


def file_at(stage: Usd.Stage, volume: UsdVol.Volume, field: str, time: float) -> str:
    """Returns the file that a field reads at a time."""
    asset = UsdVol.OpenVDBAsset.Get(stage, volume.GetFieldPath(field))
    return asset.GetFilePathAttr().Get(time).resolvedPath


def describe_light(prim: Usd.Prim) -> dict:
    """Returns name, type, intensity, colour, position and direction."""
    light, place = UsdLux.LightAPI(prim), to_world(prim)
    return {
        "name": prim.GetName(),
        "type": str(prim.GetTypeName()),
        "intensity": light.GetIntensityAttr().Get(),
        "color": list(light.GetColorAttr().Get()),
        "position": place[3, :3].tolist(),
        "direction": (-place[2, :3] / np.linalg.norm(place[2, :3])).tolist(),
    }


def describe_camera(prim: Usd.Prim) -> dict:
    """Returns position, direction and horizontal angle of view."""
    camera, place = UsdGeom.Camera(prim).GetCamera(Usd.TimeCode.Default()), to_world(prim)
    return {
        "position": place[3, :3].tolist(),
        "direction": (-place[2, :3]).tolist(),
        "degrees": camera.GetFieldOfView(Gf.Camera.FOVHorizontal),
    }


def describe_receiver(prim: Usd.Prim) -> dict:
    """Returns points, texture coordinates of corners, the picture at the default time, and the material."""
    mesh = UsdGeom.Mesh(prim)
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    name = next(name for name in ("st_bake", "st") if UsdGeom.PrimvarsAPI(prim).HasPrimvar(name))
    points = np.array(mesh.GetPointsAttr().Get(), float)
    return {
        "name": prim.GetName(),
        "material": material.GetPrim().GetName(),
        "points": (np.column_stack([points, np.ones(len(points))]) @ to_world(prim))[:, :3].tolist(),
        "uv_name": name,
        "uvs": np.array(UsdGeom.PrimvarsAPI(prim).GetPrimvar(name).Get(), float).tolist(),
        "picture": Path(prim.GetAttribute("smokeBaked:lit").Get().resolvedPath).name,
    }


if __name__ == "__main__":
    main(*sys.argv[1:])
