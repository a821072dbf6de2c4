"""Of several cameras the one that is asked for, in pictures, in the preview and on the command line."""

import numpy as np
import pytest
from PIL import Image
from stage_text import write_stage

import warp_smoke as ws
from warp_smoke import cli
from warp_smoke.preview.stage import PreviewStage

WALLS = """
def DomeLight "Sky" { float inputs:intensity = 1 }
def Camera "First" {
    float2 clippingRange = (0.1, 10)
    float3 xformOp:rotateXYZ = (0, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"] }
def Camera "Second" {
    float2 clippingRange = (0.1, 10)
    float3 xformOp:rotateXYZ = (0, 180, 0)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"] }
def Cube "Front" {
    color3f[] primvars:displayColor = [(1, 0, 0)]
    double3 xformOp:translate = (0, 0, -3)
    uniform token[] xformOpOrder = ["xformOp:translate"] }
def Cube "Back" {
    color3f[] primvars:displayColor = [(0, 1, 0)]
    double3 xformOp:translate = (0, 0, 3)
    uniform token[] xformOpOrder = ["xformOp:translate"] }
"""
SEEN = {None: (255, 0, 0), "/World/First": (255, 0, 0), "/World/Second": (0, 255, 0)}


@pytest.fixture
def walls(tmp_path):
    """A stage with a red wall before its first camera, and a green one behind, before the second."""
    return write_stage(tmp_path, WALLS)


def _middle(file):
    picture = np.asarray(Image.open(file))
    return tuple(picture[picture.shape[0] // 2, picture.shape[1] // 2].tolist())


@pytest.mark.parametrize("camera", SEEN)
def test_pictures_and_preview(walls, tmp_path, camera):
    """Both look through it; the preview also when it reads the stage again."""
    ws.render(walls, tmp_path / "seen.png", camera=camera, size=(8, 8), samples=1)
    ws.preview(walls, screenshot=tmp_path / "preview.png", camera=camera, size=(32, 32))
    assert _middle(tmp_path / "seen.png") == _middle(tmp_path / "preview.png") == SEEN[camera]
    stage = PreviewStage(walls, camera)
    assert stage.reopened().scene.camera.path == stage.scene.camera.path == (camera or "/World/First")


def test_the_command_line(walls, tmp_path, monkeypatch, capfd):
    """`render`, `preview`, `run` and `plan` take it; a path without a camera is one line with those that are there."""

    def call(*words):
        monkeypatch.setattr("sys.argv", ["warp-smoke", *map(str, words)])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        return stopped.value.code, capfd.readouterr().err

    seen, looked = tmp_path / "seen.png", tmp_path / "preview.png"
    second = ("--camera", "/World/Second")
    assert call("render", walls, "-o", seen, "--size", "8x8", *second) == (0, "")
    assert call("preview", walls, "--screenshot", looked, "--size", "32x32", *second) == (0, "")
    assert _middle(seen) == _middle(looked) == SEEN["/World/Second"]
    assert call("run", walls, "-o", tmp_path / "out", "--frames", "1:1", *second)[0] == 0
    for command in (("plan", walls), ("run", walls), ("preview", walls), ("render", walls, "-o", seen)):
        status, error = call(*command, "--camera", "/World/Third")
        assert status != 0
        assert error.strip().endswith("camera is /World/Third; allowed: /World/First, /World/Second")
