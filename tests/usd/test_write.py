import hashlib
from pathlib import Path

import pytest
import scenes
from pxr import Sdf, Usd, UsdGeom
from results import SET, write_all

import warp_smoke as ws
from warp_smoke.lattice import place_lattice
from warp_smoke.usd.find import find_stage
from warp_smoke.usd.volume import VolumeResult
from warp_smoke.usd.write import BakeResult, write_results


def contents(folder: Path) -> dict[str, bytes]:
    """Every file in a folder and what is in it."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_root_layer_stacks_results_over_the_users_stage(results, set_stage):
    """The sublayers are relative, results first, and everything of the user's stage is still there."""
    layer = Sdf.Layer.FindOrOpen(str(results.root))
    assert list(layer.subLayerPaths) == ["./set.results.usdc", "../user/set.usda"]
    stage, user = Usd.Stage.Open(layer), Usd.Stage.Open(str(set_stage))
    assert not stage.GetCompositionErrors()
    for prim in user.Traverse():
        assert stage.GetPrimAtPath(prim.GetPath()).GetTypeName() == prim.GetTypeName()


def test_what_a_stage_says_of_itself_is_kept(results, set_stage):
    """Metadata that USD reads from the root layer alone is the user's."""
    stage, user = Usd.Stage.Open(str(results.root)), Usd.Stage.Open(str(set_stage))
    assert stage.GetDefaultPrim().GetPath() == "/World"
    for key in ("metersPerUnit", "upAxis", "startTimeCode", "endTimeCode", "timeCodesPerSecond", "framesPerSecond"):
        assert stage.GetMetadata(key) == user.GetMetadata(key), key


def test_frames_stay_where_they_are_at_another_rate(results):
    """No layer of the stack scales time: a file's time code is its frame."""
    stage = Usd.Stage.Open(str(results.root))
    files = stage.GetAttributeAtPath("/World/Box_smoke/density.filePath")
    assert files.GetTimeSamples() == list(results.scene.frames)


def test_a_stage_that_names_no_unit_gets_the_scenes(tmp_path):
    """USD's own defaults, which the scene was run with, are written out where the user's stage is silent."""
    source = tmp_path / "bare.usda"
    source.write_text('#usda 1.0\n(\n    defaultPrim = "World"\n)\ndef Xform "World"\n{\n}\n')
    stage = Usd.Stage.Open(str(write_results(tmp_path / "out", "bare", ws.Scene.open(source))))
    assert UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.01
    assert stage.HasAuthoredMetadata("upAxis")
    assert UsdGeom.GetStageUpAxis(stage) == "Y"


def test_the_same_results_give_the_same_bytes(tmp_path):
    """Layers, volumes and pictures of two runs are equal, byte for byte."""
    written = []
    for name in ("a", "b"):
        source = tmp_path / name / "user" / "set.usda"
        source.parent.mkdir(parents=True)
        source.write_text(SET)
        write_all(source, tmp_path / name / "out")
        written.append(contents(tmp_path / name / "out"))
    assert written[0] == written[1]
    assert len(written[0]) == 2 + 3 + 3 + 1  # layers, volumes, lit pictures, shadow


def test_the_users_stage_is_left_alone(tmp_path, set_stage):
    """Nothing in its folder changes."""
    before = hashlib.sha256(set_stage.read_bytes()).hexdigest()
    write_all(set_stage, tmp_path / "out")
    assert hashlib.sha256(set_stage.read_bytes()).hexdigest() == before
    assert list(set_stage.parent.iterdir()) == [set_stage]


@pytest.mark.parametrize("name", ["set.usda", "set.results.usdc"])
def test_the_users_stage_is_never_overwritten(tmp_path, name):
    """An output folder in which a layer would have the name of the user's stage is refused."""
    source = tmp_path / name
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(SET)
    layer.Export(str(source))
    before = source.read_bytes()
    with pytest.raises(ValueError, match="own stage"):
        write_results(tmp_path, "set", ws.Scene.open(source))
    assert contents(tmp_path) == {name: before}


def test_an_error_in_the_results_leaves_the_last_ones(results):
    """A prim that is not on the stage is named, and no layer changes."""
    folder = results.root.parent
    before = contents(folder)
    ghost = ws.Surface(path="/World/Ghost", mesh=ws.Mesh.box())
    bake = BakeResult(surface=ghost, bake="lit", files="./textures/Ghost.png")
    with pytest.raises(ValueError, match="/World/Ghost: no such prim"):
        write_results(folder, "set", results.scene, bakes=[bake])
    assert contents(folder) == before


def test_a_full_disk_leaves_no_half_written_layer(tmp_path, set_stage, monkeypatch):
    """If a layer cannot take its place, neither it nor what was written of it stays."""

    def refuse(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(OSError, match="No space"):
        write_results(tmp_path / "out", "set", ws.Scene.open(set_stage))
    assert not list((tmp_path / "out").iterdir())


def test_an_open_stage_shows_new_results(results):
    """A stage that is open in the process follows when its results are written again."""
    stage = Usd.Stage.Open(str(results.root))
    assert stage.GetPrimAtPath("/World/Box_smoke")
    write_results(results.root.parent, "set", results.scene)
    assert not stage.GetPrimAtPath("/World/Box_smoke")


def test_a_scene_made_in_python_gets_a_stage_of_its_own(tmp_path):
    """The scene is written below the results, and the two together read back as the same scene."""
    scene = scenes.plume()
    (domain,) = scene.domains
    volume = VolumeResult(
        domain=domain, lattice=place_lattice(scene, domain), grids=("density",), files={1: "./volumes/Smoke.0001.vdb"}
    )
    root = write_results(tmp_path, "plume", scene, [volume])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plume.results.usdc", "plume.scene.usdc", "plume.usda"]
    assert Usd.Stage.Open(str(root)).GetPrimAtPath("/World/Smoke_smoke").GetTypeName() == "Volume"
    reread = ws.Scene.open(root)
    assert [record.path for record in reread.domains] == [domain.path]
    assert reread.frames == scene.frames


def test_a_folder_leads_to_its_stage(results, tmp_path):
    """Results are found by their folder; a folder without any is refused."""
    assert find_stage(results.root.parent) == results.root
    assert find_stage(results.root) == results.root
    with pytest.raises(ValueError, match="no such file"):
        find_stage(tmp_path)
