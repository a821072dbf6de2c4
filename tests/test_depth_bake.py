"""Shadow maps as pictures, where a receiver bakes `depth`: the right maps, named on the stage, and nothing besides."""

from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdShade
from scenes import at, floor, shining

import warp_smoke as ws
from warp_smoke.usd.export import flatten_stage, package_stage
from warp_smoke.usd.validate import validate_stage

SIZE = 64  # of maps
CUBE = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.5), transform=at(0.0, 1.0, 0.0))
LAMP = ws.PointLight(path="/World/Lamp", transform=at(0.0, 3.0, 0.0), shadow_map_size=SIZE)
SUN = ws.DistantLight(path="/World/Sun", transform=shining((0.1, -1.0, 0.0)), shadow_map_size=SIZE)


def baking(*bakes: str, path: str = "/World/Floor") -> ws.Surface:
    """A floor that bakes these."""
    return replace(floor(), path=path, receiver=ws.Receiver(path=path, bake=bakes, texture_size=16))


def scene(*surfaces: ws.Surface, lights=(LAMP,), **fields) -> ws.Scene:
    """One frame of floors with a cube above them."""
    return ws.Scene(surfaces=[*surfaces, CUBE], lights=lights, **{"end": 1} | fields)


def pictures(folder: Path) -> dict[str, np.ndarray]:
    """All textures of a run, by file name."""
    return {path.name: np.asarray(Image.open(path)) for path in sorted((folder / "textures").iterdir())}


def named(file: Path, path: str = "/World/Floor", frame: int = 1) -> dict[str, str]:
    """The files that a receiver names as baked at a frame, by attribute."""
    stage = Usd.Stage.Open(str(file))
    attributes = stage.GetPrimAtPath(path).GetAuthoredPropertiesInNamespace("smokeBaked")
    return {each.GetName(): each.Get(frame).path for each in attributes}


def test_the_picture_is_the_stored_depth(tmp_path):
    """Straight below the lamp is the cube's top, 1.75 below it, over a farthest corner at √(3² + 3² + 3²).

    Every pixel is the depth that the map stores, to the half of a code; its sides, with neither, are white.
    """
    result = ws.run(scene(baking("depth")), tmp_path / "out")
    found = pictures(result.folder)
    assert list(found) == ["Lamp.depth.png"]
    cross = found["Lamp.depth.png"]
    assert cross.shape == (3 * SIZE, 4 * SIZE)
    assert cross.dtype == np.uint8
    below, towards_x = cross[2 * SIZE :, SIZE : 2 * SIZE], cross[SIZE : 2 * SIZE, 2 * SIZE : 3 * SIZE]
    middle = below[SIZE // 2 - 1 : SIZE // 2 + 1, SIZE // 2 - 1 : SIZE // 2 + 1]
    np.testing.assert_array_equal(middle, round(255 * 1.75 / 27**0.5))
    np.testing.assert_array_equal(towards_x, 255)
    simulation = ws.Simulation(scene(baking("depth")))
    simulation.step()
    stored = simulation._lighting._maps["/World/Lamp"].map.depth.numpy()
    np.testing.assert_allclose(below, 255 * stored[3], atol=0.5)


def test_only_the_maps_of_its_own_lights(tmp_path):
    """Of two lamps the one that is linked to the asking floor is written, and its picture is its own."""
    other = replace(LAMP, path="/World/Other", transform=at(1.0, 2.0, 0.5), illuminates=("/World/Second",))
    lamp = replace(LAMP, illuminates=("/World/Floor",))
    second = baking("lit", path="/World/Second")
    result = ws.run(scene(baking("depth"), second, lights=[other, lamp]), tmp_path / "out", depth_maps=True)
    found = pictures(result.folder)
    assert set(named(result.stage)) == {"smokeBaked:depth:Lamp"}
    assert set(named(result.stage, "/World/Second")) == {"smokeBaked:lit"}
    alone = ws.run(scene(baking("depth"), second, lights=[other, lamp]), tmp_path / "alone")
    assert set(pictures(alone.folder)) == {"Lamp.depth.png", "Second.lit.png"}
    np.testing.assert_array_equal(pictures(alone.folder)["Lamp.depth.png"], found["Lamp.depth.png"])
    assert np.any(found["Other.depth.png"] != found["Lamp.depth.png"])


def test_no_texture_coordinates_are_needed(tmp_path):
    """A mesh without them is not warned of, keeps its own look, and no memory for a bake is allocated."""
    bare = baking("depth")
    bare = replace(bare, mesh=replace(bare.mesh, uvs=None), material=ws.Material(path="/World/Looks/Paint"))
    result = ws.run(scene(bare, end=2), tmp_path / "out")
    assert result.report["warnings"] == []
    assert "bake" not in result.report["seconds"]["passes"]
    stage = Usd.Stage.Open(str(result.stage))
    material, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/World/Floor")).ComputeBoundMaterial()
    assert material.GetPath() == "/World/Looks/Paint"
    assert not stage.GetDefaultPrim().GetVariantSets().HasVariantSet("smokeLook")
    assert {each.source for each in validate_stage(result.stage)} == {"WeldChecker"}  # of the cube's own corners
    simulation = ws.Simulation(scene(bare))
    simulation.step()
    assert "bake" not in simulation.launcher.allocated
    assert sum(simulation.plan.bytes.values()) == pytest.approx(sum(simulation.launcher.allocated.values()), rel=0.15)


@pytest.mark.parametrize("uvs", [True, False])
def test_depth_beside_lit_changes_no_bake(tmp_path, uvs):
    """The lit floor is the same to the bit, also at points; the map is that of `depth_maps` for all lights."""
    plain, both = (
        replace(each, mesh=each.mesh if uvs else replace(each.mesh, uvs=None))
        for each in (baking("lit"), baking("lit", "depth"))
    )
    lit = ws.run(scene(plain, lights=[LAMP, SUN]), tmp_path / "lit", depth_maps=True)
    with_depth = ws.run(scene(both, lights=[LAMP, SUN]), tmp_path / "both")
    expected, found = pictures(lit.folder), pictures(with_depth.folder)
    assert expected.keys() == found.keys() == {"Lamp.depth.png", "Sun.depth.png", *["Floor.lit.png"] * uvs}
    for name in expected:
        np.testing.assert_array_equal(found[name], expected[name])
    if not uvs:
        stages = [Usd.Stage.Open(str(each.stage)) for each in (lit, with_depth)]
        values = [each.GetAttributeAtPath("/World/Floor.primvars:smokeLit").Get() for each in stages]
        np.testing.assert_array_equal(*values)


def test_receivers_share_a_picture(tmp_path):
    """Two receivers of one light name the same file."""
    floors = baking("depth"), baking("depth", path="/World/Other")
    result = ws.run(scene(*floors), tmp_path / "out")
    assert list(pictures(result.folder)) == ["Lamp.depth.png"]
    for each in floors:
        assert named(result.stage, each.path) == {"smokeBaked:depth:Lamp": "./textures/Lamp.depth.png"}


def test_lights_of_one_name(tmp_path):
    """Two lights that are called the same are told apart by their whole paths."""
    second = replace(LAMP, path="/World/Rig/Lamp", transform=at(0.5, 3.0, 0.0))
    result = ws.run(scene(baking("depth"), lights=[LAMP, second]), tmp_path / "out")
    assert set(pictures(result.folder)) == {"World_Lamp.depth.png", "World_Rig_Lamp.depth.png"}
    assert set(named(result.stage)) == {"smokeBaked:depth:World_Lamp", "smokeBaked:depth:World_Rig_Lamp"}


@pytest.fixture
def moving() -> ws.Scene:
    """Three frames in which a cube moves under the lamp, but not between the floor and the sun."""
    away = ws.Samples([1, 3], [at(0.0, 1.0, 0.0), at(0.6, 1.4, 0.0)])
    still = replace(CUBE, path="/World/Still", transform=at(-1.0, 1.0, 0.0))
    sun = replace(SUN, shadowed_by=("/World/Still",))
    return ws.Scene(
        surfaces=[baking("depth"), replace(CUBE, transform=away), still], lights=[LAMP, sun], start=1, end=3
    )


def test_a_map_that_moves_is_written_each_frame(moving, tmp_path):
    """The lamp's map is one picture a frame, each that of its frame; the sun's, which stands still, is one."""
    result = ws.run(moving, tmp_path / "out")
    found = pictures(result.folder)
    lamp = [f"Lamp.depth.{number:04d}.png" for number in (1, 2, 3)]
    assert set(found) == {*lamp, "Sun.depth.png"}
    simulation = ws.Simulation(moving)
    for name in lamp:
        simulation.step()
        np.testing.assert_array_equal(found[name], simulation.depth_pictures()["/World/Lamp"])
    assert np.any(found[lamp[0]] != found[lamp[2]])
    for number, name in zip((1, 2, 3), lamp, strict=True):
        assert named(result.stage, frame=number)["smokeBaked:depth:Lamp"] == f"./textures/{name}"
    assert {each.source for each in validate_stage(result.stage)} == {"WeldChecker"}  # of the cube's own corners


def test_depth_maps_beside_the_bake(moving, tmp_path):
    """`depth_maps` writes its picture of the last frame too, and no second one of a map that stands still."""
    found = pictures(ws.run(moving, tmp_path / "out", depth_maps=True).folder)
    assert set(found) == {*(f"Lamp.depth.{number:04d}.png" for number in (1, 2, 3)), "Lamp.depth.png", "Sun.depth.png"}
    np.testing.assert_array_equal(found["Lamp.depth.png"], found["Lamp.depth.0003.png"])


@pytest.mark.parametrize("last", [1, 2])
def test_a_run_that_goes_on(moving, tmp_path, last):
    """A run that was stopped goes on to the same stage and the same pictures as one that was not."""
    whole = ws.run(moving, tmp_path / "whole")

    def stop(made):
        if made.number == last:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        ws.run(moving, tmp_path / "out", on_frame=stop, checkpoint_every=1)
    result = ws.run(moving, tmp_path / "out", resume=True)
    assert result.report["resumed_after"] == last
    for folder in ("textures", "."):
        files = [path.name for path in sorted((whole.folder / folder).iterdir()) if path.suffix != ".json"]
        assert files == [path.name for path in sorted((result.folder / folder).iterdir()) if path.suffix != ".json"]
        for name in files:
            if (whole.folder / folder / name).is_file():
                assert (whole.folder / folder / name).read_bytes() == (result.folder / folder / name).read_bytes()


def test_the_next_run_takes_them_away(moving, tmp_path):
    """What a run wrote for `depth` goes with the rest of its files when the next one asks for none."""
    ws.run(moving, tmp_path / "out")
    lit = replace(moving, surfaces=[baking("lit"), *moving.surfaces[1:]])
    result = ws.run(lit, tmp_path / "out")
    assert {name.split(".")[1] for name in pictures(result.folder)} == {"lit"}


def test_one_layer_and_one_package(moving, tmp_path):
    """A flat stage names the pictures at every frame, and a package holds them, like all other textures."""
    result = ws.run(moving, tmp_path / "out")
    flat = flatten_stage(result.stage, result.stage.with_suffix(".flat.usdc"))
    for number in (1, 2, 3):
        assert named(flat, frame=number) == named(result.stage, frame=number)
    with ZipFile(package_stage(result.stage, tmp_path / "out" / "moving.usdz")) as archive:
        inside = {Path(name).name for name in archive.namelist()}
    assert set(pictures(result.folder)) <= inside


def test_a_stage_that_asks_for_depth(tmp_path):
    """The token is read from a stage, kept on the way through one, and run."""
    scene(baking("depth")).save(tmp_path / "shot.usda")
    opened = ws.Scene.open(tmp_path / "shot.usda")
    assert opened.warnings == ()
    assert opened.surfaces[0].receiver.bake == ("depth",)
    assert list(pictures(ws.run(opened, tmp_path / "out").folder)) == ["Lamp.depth.png"]


def test_no_other_tokens():
    """The error names what is allowed."""
    with pytest.raises(ValueError, match=r"bake is depths; allowed: .*normal, depth$"):
        ws.Receiver(path="/World/Floor", bake=("depths",))
