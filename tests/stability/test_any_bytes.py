"""Fuzzed files: damaged copies of real stages, volumes and pictures are read, or refused in one line without a crash.

Noise as a stage is in tests/usd/test_read.py; damage and noise as a volume are in tests/vdb/test_vdb_read.py.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from damage import damaged, with_count
from hard_cases import refusal
from PIL import Image
from pxr import Sdf
from scenes import plume

import warp_smoke as ws
from warp_smoke import cli
from warp_smoke.shading.textures import Picture, read_texture

STAGES = Path(__file__).parents[2] / "stages"
READER = Path(__file__).parents[1] / "damage.py"


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
@pytest.mark.parametrize(
    ("first", "end"), [pytest.param(0, 80, id="80"), pytest.param(80, 880, id="800", marks=pytest.mark.slow)]
)
def test_damaged_stages(tmp_path, suffix, first, end, record_property):
    """80 (slow: 800) damaged copies of an example stage, as text and as binary: read, or refused in one line."""
    stage = tmp_path / f"stage{suffix}"
    shutil.copytree(STAGES / "textures", tmp_path / "textures")
    Sdf.Layer.FindOrOpen(str(STAGES / "plume.usda")).Export(str(stage))
    command = [sys.executable, READER, stage, tmp_path, str(first), str(end)]
    alone = os.environ | {"PXR_WORK_THREAD_LIMIT": "1"}  # as a command is before its first stage; else forks may stall
    done = subprocess.run(command, env=alone, capture_output=True, text=True, errors="replace", check=False)
    assert done.returncode == 0, done.stdout[-100:] + done.stderr[-2000:]
    results = done.stdout.split()
    assert results.count("refused") + results.count("taken") == end - first
    record_property(f"{suffix} copies refused, of {end - first}", results.count("refused"))
    assert results.count("refused")


def check_picture(picture: Picture) -> None:
    """All its texels are finite."""
    assert np.all(np.isfinite(picture.linear()))


@pytest.mark.filterwarnings("ignore::UserWarning")  # Pillow speaks of damaged tags
@pytest.mark.parametrize("kind", ["grey.png", "rgba.png", "grey16.png", "palette.png", "photo.jpg", "scan.tif"])
@pytest.mark.parametrize("count", [25, pytest.param(400, marks=pytest.mark.slow)])
def test_damaged_pictures(tmp_path, kind, count):
    """25 (slow: 400) damaged copies of a picture of each kind: read, or refused by material and file."""
    rng = np.random.default_rng(3)
    codes = rng.integers(0, 256, (13, 17, 4), np.uint8)
    pictures = {
        "grey.png": Image.fromarray(codes[..., 0]),
        "rgba.png": Image.fromarray(codes),
        "grey16.png": Image.fromarray(codes[..., 0].astype(np.uint16) * 257),
        "palette.png": Image.fromarray(codes[..., 0] % 8).convert("P"),
        "photo.jpg": Image.fromarray(codes[..., :3]),
        "scan.tif": Image.fromarray(codes[..., :3]),
    }
    file = tmp_path / kind
    pictures[kind].save(file)
    data, refused = file.read_bytes(), 0
    material = ws.Material(path="/Look", diffuse_texture=ws.Texture(file=str(file)))
    for seed in range(count):
        file.write_bytes(damaged(data, seed))
        line = refusal(lambda: check_picture(read_texture(material, "diffuse_texture")))
        if line:
            refused += 1
            assert line.startswith(f"/Look: diffuse_texture is {file} (")
    assert refused


@pytest.fixture
def command(monkeypatch, capfd, tmp_path):
    """Runs the command line in an empty folder; gives status and what it prints on standard error."""
    monkeypatch.chdir(tmp_path)

    def call(*args):
        monkeypatch.setattr("sys.argv", ["warp-smoke", *map(str, args)])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        return stopped.value.code, capfd.readouterr().err

    return call


@pytest.mark.parametrize("name", ["plan", "validate", "run"])
def test_command_on_damaged_stages(command, tmp_path, name):
    """10 damaged stages given to a command: done, or status 2 and one line; no traceback, no word of USD's."""
    data = (STAGES / "smoke_only.usda").read_bytes()
    options = ["--resolution", 4, "--frames", "1:1", "--threads", 1] if name == "run" else []
    for seed in range(10):
        (tmp_path / "damaged.usda").write_bytes(damaged(data, seed))
        status, said = command(name, "damaged.usda", *options)
        assert status in (0, 1, 2), said
        assert "Traceback" not in said
        if status == 2:
            assert said.startswith("error damaged.usda: ")
            assert said.count("\n") == 1


@pytest.mark.parametrize("name", ["run", "plan", "validate", "study", "preview", "render"])
def test_command_on_a_stage_that_brings_usd_down(tmp_path, name):
    """A binary stage for which USD takes gigabytes: every command that reads stages ends with status 2 and one line."""
    stage = tmp_path / "stage.usdc"
    Sdf.Layer.FindOrOpen(str(STAGES / "plume.usda")).Export(str(stage))
    stage.write_bytes(with_count(stage.read_bytes(), "PATHS", 2**30))
    options = {"preview": ["--screenshot", "a.png"], "render": ["-o", "a.png"]}.get(name, [])
    line = [sys.executable, "-m", "warp_smoke_command", name, stage, *options]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith(f"error {stage}: not a USD stage: ")
    assert [path.name for path in tmp_path.iterdir()] == ["stage.usdc"]


def test_command_on_damaged_volumes(command, tmp_path):
    """20 damaged volumes in a results folder that a picture is made of: done, or status 2 and one line."""
    plume(resolution=8, frames=1).save(tmp_path / "small.usda")
    result = ws.run(ws.Scene.open(tmp_path / "small.usda"), tmp_path / "out", threads=1)
    (volume,) = (tmp_path / "out/volumes").iterdir()
    data = volume.read_bytes()
    for seed in range(20):
        volume.write_bytes(damaged(data, seed))
        status, said = command("render", result.folder, "--frame", 1, "-o", "picture.png", "--size", "8x8")
        assert status in (0, 2), said
        assert said.count("\n") == (status == 2)
        assert "Traceback" not in said
