"""One layer or one package instead of layers over layers: they hold the same stage."""

import os
import shutil
from zipfile import ZipFile

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdShade, UsdUtils, UsdVol

import warp_smoke as ws
from warp_smoke.files import write_png
from warp_smoke.scene import Scene
from warp_smoke.usd.export import flatten_stage, package_stage, result_files
from warp_smoke.usd.validate import validate_stage


def picture_at(stage, frame):
    """The file of the baked picture on the floor at a frame, as it is resolved."""
    floor = stage.GetPrimAtPath("/World/Floor")
    material, _ = UsdShade.MaterialBindingAPI(floor).ComputeBoundMaterial()
    texture = stage.GetPrimAtPath(material.GetPath().AppendChild("lit"))
    return UsdShade.Shader(texture).GetInput("file").Get(frame).resolvedPath


def test_a_flat_stage_is_the_same_stage(results, tmp_path):
    """One layer, without sublayers, reads as the same scene, is as valid, and names the same files at every frame."""
    flat = flatten_stage(results.root, results.root.with_suffix(".flat.usdc"))
    stage, layered = Usd.Stage.Open(str(flat)), Usd.Stage.Open(str(results.root))
    assert stage.GetRootLayer().GetCompositionAssetDependencies() == []
    assert Scene.open(flat) == Scene.open(results.root)
    assert validate_stage(flat) == validate_stage(results.root)
    for frame in (5, 6, 7):
        assert picture_at(stage, frame) == picture_at(layered, frame)
    # Relative, so that the folder can be moved.
    moved = tmp_path / "moved"
    shutil.copytree(results.root.parent, moved)
    assert str(moved) in picture_at(Usd.Stage.Open(str(moved / flat.name)), 6)


def test_the_same_stage_gives_the_same_bytes(results):
    """A flat stage and a package written again, also of files with other times, are the same to the byte."""
    files = (results.root.with_suffix(".flat.usdc"), results.root.with_suffix(".usdz"))
    written = []
    for time in (10**9, 1.5 * 10**9):
        for path in results.root.parent.rglob("*.png"):
            os.utime(path, (time, time))
        flatten_stage(results.root, files[0])
        package_stage(results.root, files[1])
        written.append([file.read_bytes() for file in files])
    assert written[0] == written[1]
    with ZipFile(files[1]) as archive:
        assert archive.testzip() is None
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_a_package_holds_everything_but_the_smoke(results, tmp_path):
    """The `.usdz` opens anywhere with the meshes and every frame's picture in it, and with no volume."""
    package = package_stage(results.root, tmp_path / "set.usdz")
    alone = tmp_path / "elsewhere" / "set.usdz"
    alone.parent.mkdir()
    shutil.move(package, alone)
    shutil.rmtree(results.root.parent)
    stage = Usd.Stage.Open(str(alone))
    assert stage.GetPrimAtPath("/World/Floor")
    assert not any(prim.IsA(UsdVol.Volume) or prim.IsA(UsdVol.FieldBase) for prim in stage.TraverseAll())
    names = ZipFile(alone).namelist()
    assert names[0] == "set.usdc"
    assert sum(name.endswith(".png") for name in names) == 4
    assert not any(name.endswith(".vdb") for name in names)
    for frame in (5, 6, 7):
        assert picture_at(stage, frame).startswith(f"{alone}[")
    layers, assets, unresolved = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(alone)))
    assert unresolved == []
    assert len(layers) == 1
    assert len(assets) == 4
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_textures_from_elsewhere_are_packed_in_silence(tmp_path, capfd):
    """The user's own textures lie beside the set, not below the results; USD has nothing to say of them."""
    surfaces = []
    for folder in ("set", "out"):
        (tmp_path / folder).mkdir()
    for n in range(8):  # of one texture, USD complains now and then
        write_png(tmp_path / f"set/wood{n}.png", np.full((4, 4, 3), 90, np.uint8))
        texture = ws.Texture(file=str(tmp_path / f"set/wood{n}.png"))
        material = ws.Material(path=f"/World/Wood{n}", diffuse_texture=texture)
        mesh = ws.Mesh.grid((-1, n, 1), (2, 0, 0), (0, 0, -2))
        surfaces.append(ws.Surface(path=f"/World/Floor{n}", mesh=mesh, material=material))
    ws.Scene(surfaces=surfaces).save(tmp_path / "set/set.usda")
    package = package_stage(tmp_path / "set/set.usda", tmp_path / "out/set.usdz")
    assert capfd.readouterr().err == ""
    packed = {name for name in ZipFile(package).namelist() if name.endswith(".png")}
    assert packed == {f"0/wood{n}.png" for n in range(8)}


def test_files_that_results_name(results):
    """All volumes and textures, at every frame, and nothing else; a layer that cannot be read names none."""
    layer = results.root.with_name("set.results.usdc")
    folder = results.root.parent
    assert result_files(layer) == {*folder.glob("volumes/*"), *folder.glob("textures/*")}
    layer.write_bytes(b"noise")
    assert result_files(layer) == set()
    assert result_files(folder / "nothing.usdc") == set()


@pytest.mark.parametrize("path", ["../outside.png", "./textures/../../outside.png", "./other/file.png", "/etc/passwd"])
def test_files_elsewhere_are_not_the_results(tmp_path, path):
    """Whatever a layer names outside of its own two folders is none of its results."""
    layer = Sdf.Layer.CreateNew(str(tmp_path / "odd.results.usdc"))
    stage = Usd.Stage.Open(layer)
    stage.DefinePrim("/A").CreateAttribute("file", Sdf.ValueTypeNames.Asset).Set(path)
    layer.Save()
    assert result_files(tmp_path / "odd.results.usdc") == set()


def test_same_stage_same_package(results, tmp_path):
    """Two packages of one stage have equal bytes."""
    first, second = (package_stage(results.root, tmp_path / name / "set.usdz") for name in _made(tmp_path, "ab"))
    np.testing.assert_array_equal(*(np.frombuffer(path.read_bytes(), np.uint8) for path in (first, second)))


def _made(folder, names):
    for name in names:
        (folder / name).mkdir()
    return names
