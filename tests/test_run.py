"""The whole way: a stage in, a finished stage out; files whole, reproducible, and none left behind by bad input."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdVol
from scenes import at, floor, plume

import warp_smoke as ws
from warp_smoke.usd.validate import validate_stage
from warp_smoke.vdb import read_vdb

STAGES = Path(__file__).parents[1] / "stages"


def digests(folder):
    """A hash of every file but the report, which holds times."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "report.json"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.parametrize("name", ["brazier", "plume", "obstacle", "room", "smoke_only", "columns", "mandelbrot"])
def test_example_stages(name, tmp_path):
    """Each example stage gives a stage that all validators accept, with every file that the plan promises."""
    source = STAGES / f"{name}.usda"
    before = source.read_bytes()
    scene = ws.Scene.open(source)
    assert not scene.warnings
    scene = replace(
        scene, end=min(scene.end, scene.start + 2), domains=[replace(d, resolution=24) for d in scene.domains]
    )
    result = ws.run(scene, tmp_path / name)
    assert source.read_bytes() == before
    assert validate_stage(result.stage) == []
    assert len(list(result.folder.glob("volumes/*.vdb"))) == len(scene.domains) * len(scene.frames)
    bakes = {(r.surface.path, bake): when for r in ws.make_plan(scene).receivers for bake, when in r.bakes.items()}
    count = sum(1 if when == "once" else len(scene.frames) for when in bakes.values())
    count += len({s.material.path for s in scene.surfaces if s.material and s.material.procedural})
    assert len(list(result.folder.glob("textures/*.png"))) == count
    assert [frame["frame"] for frame in result.report["frames"]] == list(scene.frames)
    assert not list(result.folder.rglob(".*"))  # no partial file


def test_results_hold_the_simulation(tmp_path):
    """Volumes and textures on disk are the simulation's arrays: density to half precision, pixels exactly."""
    scene = plume(resolution=24, frames=3)
    seen = []
    result = ws.run(scene, tmp_path / "out", on_frame=seen.append)
    stage = Usd.Stage.Open(str(result.stage))
    volume = next(UsdVol.Volume(prim) for prim in stage.Traverse() if prim.IsA(UsdVol.Volume))
    field = UsdVol.OpenVDBAsset(stage.GetPrimAtPath(volume.GetFieldPath("density")))
    for frame in seen:
        file = field.GetFilePathAttr().Get(frame.number).resolvedPath
        grid = read_vdb(file)["density"]
        expected = frame.smoke["/World/Smoke"].density
        dense = np.zeros_like(expected)
        place = tuple(slice(o, o + n) for o, n in zip(grid.origin, grid.values.shape, strict=True))
        dense[place] = grid.values
        # Half precision, and voxels that dim light by less than 1e-6 are dropped.
        np.testing.assert_allclose(dense, expected, rtol=2**-11, atol=1e-5)
        picture = np.asarray(Image.open(result.folder / f"textures/Floor.lit.{frame.number:04d}.png"))
        np.testing.assert_array_equal(picture, frame.pictures["/World/Floor", "lit"])


def test_same_scene_same_bytes(tmp_path):
    """Two runs, on one thread and on two, write the same bytes."""
    scene = plume(frames=2)
    runs = [ws.run(scene, tmp_path / str(threads), threads=threads) for threads in (1, 2)]
    assert digests(runs[0].folder) == digests(runs[1].folder)
    assert len(digests(runs[0].folder)) > 4


def test_report(tmp_path):
    """The report has the time of each pass, substeps, residuals, versions and the device, and is valid JSON."""
    result = ws.run(plume(frames=3), tmp_path / "out")
    report = json.loads((result.folder / "report.json").read_text())
    assert report == json.loads(json.dumps(result.report))
    assert {"advect_density", "project_pressure", "project_smoke", "bake"} <= set(report["seconds"]["passes"])
    assert report["environment"]["warp-lang"]
    assert report["device"] == "cpu"
    step = report["frames"][1]["domains"]["/World/Smoke"]
    assert step["substeps"] >= 1
    assert all(status["converged"] for status in step["pressure"])
    assert report["frames"][0]["domains"] == {}


def test_depth_maps_to_look_at(tmp_path):
    """Shadow maps are written as grey pictures: a cross for the point light, a square for the sun."""
    cube = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.5), transform=at(0.5, 1, 0))
    scene = replace(plume(frames=1), surfaces=[floor(), cube])
    scene = replace(scene, lights=[replace(light, shadow_map_size=64) for light in scene.lights])
    folder = ws.run(scene, tmp_path / "out", depth_maps=True).folder / "textures"
    cross, square = (np.asarray(Image.open(folder / f"{name}.depth.png")) for name in ("Lamp", "Sun"))
    assert cross.shape == (192, 256)
    assert square.shape == (64, 64)
    assert cross[128:, 64:128].min() < 200  # the face that looks down sees the cube
    assert square.min() < square.max()


def test_scene_without_anything(tmp_path):
    """An empty scene gives a valid stage and an empty plan."""
    result = ws.run(ws.Scene(end=2), tmp_path / "out")
    assert not [problem for problem in validate_stage(result.stage) if problem.severity == "error"]
    assert result.report["plan"] == []


def test_no_folder_after_bad_input(tmp_path):
    """A plan that cannot be made leaves no folder; nor does an unknown device."""
    spectral = replace(plume().domains[0], pressure_solver="spectral")
    ball = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 16))
    with pytest.raises(ValueError, match="pressure_solver"):
        ws.run(replace(plume(), domains=[spectral], colliders=[ball]), tmp_path / "a" / "b")
    with pytest.raises(ValueError, match="device"):
        ws.run(plume(), tmp_path / "a" / "b", device="abacus")
    assert list(tmp_path.iterdir()) == []


def test_empty_folders_go_when_a_run_fails(tmp_path):
    """A run that fails before its first file takes its folders with it, and keeps what was there."""
    (tmp_path / "kept").mkdir()
    texture = ws.Texture(file=str(tmp_path / "missing.png"))
    surface = floor(material=ws.Material(path="/World/Paint", diffuse_texture=texture))
    with pytest.raises(ValueError, match=r"/World/Paint.*missing.png"):
        ws.run(replace(plume(), surfaces=[surface]), tmp_path / "kept" / "out")
    assert list(tmp_path.rglob("*")) == [tmp_path / "kept"]


def test_own_stage_is_never_overwritten(tmp_path):
    """Results of shot.usda cannot go beside it, where shot.usda would be written."""
    source = tmp_path / "shot.usda"
    plume().save(source)
    before = source.read_bytes()
    with pytest.raises(ValueError, match="would overwrite"):
        ws.run(ws.Scene.open(source), tmp_path)
    assert source.read_bytes() == before


def test_frames_of_the_run_are_the_stage_s(tmp_path):
    """The written stage's time range is that of the frames that were run, not of the source."""
    source = tmp_path / "shot.usda"
    plume(frames=9).save(source)
    result = ws.run(replace(ws.Scene.open(source), start=101, end=102), tmp_path / "out")
    stage = Usd.Stage.Open(str(result.stage))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (101, 102)


def test_a_folder_holds_one_result(tmp_path):
    """Another stage's results are not written over."""
    for name in ("one", "two"):
        plume(frames=1).save(tmp_path / f"{name}.usda")
    ws.run(tmp_path / "one.usda", tmp_path / "out")
    before = digests(tmp_path / "out")
    with pytest.raises(ValueError, match=r"output folder is that of one\.results\.usdc"):
        ws.run(tmp_path / "two.usda", tmp_path / "out")
    assert digests(tmp_path / "out") == before


def test_a_run_cut_short_leaves_a_stage_of_its_own_frames(tmp_path):
    """A second run into the same folder that stops half way leaves its own frames alone: no mix of both runs."""
    result = ws.run(plume(frames=4), tmp_path / "out")

    def stop(frame):
        if frame.number == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ws.run(plume(resolution=24, frames=4), tmp_path / "out", on_frame=stop)
    stage = Usd.Stage.Open(str(result.stage))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 2)
    assert not [problem for problem in validate_stage(result.stage) if problem.severity == "error"]
    volumes = sorted((tmp_path / "out" / "volumes").iterdir())
    assert [path.name for path in volumes] == ["Smoke.0001.vdb", "Smoke.0002.vdb"]
    assert not (tmp_path / "out" / "report.json").exists()


def test_a_plan_that_does_not_fit_is_refused(tmp_path):
    """Nothing is allocated or made; the message names the resolution that would fit."""
    domain = replace(plume().domains[0], resolution=4096)
    with pytest.raises(
        MemoryError, match=r"needs \d+ MiB of memory and \d+ MiB are free; --resolution (\d+) would fit"
    ):
        ws.run(replace(plume(), domains=[domain]), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_stays_without_smoke_is_said(tmp_path):
    """A domain that never holds smoke and a bake without light are named in the report's warnings."""
    result = ws.run(replace(plume(frames=1), emitters=()), tmp_path / "out")
    assert any(warning.startswith("/World/Smoke: no emitter") for warning in result.report["warnings"])


def test_an_error_names_the_file(tmp_path):
    """What goes wrong with a file names that file, not the hidden one beside it."""
    target = tmp_path / "out" / "volumes"
    target.mkdir(parents=True)
    (target / "Smoke.0001.vdb").mkdir()
    with pytest.raises(OSError, match=r"volumes/Smoke\.0001\.vdb"):
        ws.run(plume(frames=1), tmp_path / "out")


def test_names_that_collide(tmp_path):
    """Two domains of the same name under different parents keep their files apart."""
    scene = plume(frames=1)
    twin = replace(scene.domains[0], path="/Other/Smoke")
    result = ws.run(replace(scene, domains=[*scene.domains, twin]), tmp_path / "out")
    names = {path.name for path in result.folder.glob("volumes/*")}
    assert names == {"World_Smoke.0001.vdb", "Other_Smoke.0001.vdb"}


def test_files_of_an_earlier_run_are_cleared(tmp_path):
    """A shorter run leaves no volume or texture of the longer one before it, and no other file is touched."""
    ws.run(plume(frames=4), tmp_path)
    (tmp_path / "volumes" / "mine.vdb").write_text("mine")
    longer = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    ws.run(plume(frames=2), tmp_path)
    left = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    gone = longer - left
    assert gone == {name for name in longer if ".0003." in name or ".0004." in name}
    assert {name.rsplit(".", 1)[1] for name in gone} == {"vdb", "png"}
    assert "mine.vdb" in left
