"""Stages that bring USD down: tried in a child process, refused in one line; sound ones pass, text is not tried."""

import os
import signal
import time
from pathlib import Path

import pytest
from damage import with_count
from pxr import Sdf, Usd, UsdGeom

from warp_smoke.usd import probe
from warp_smoke.usd.probe import check_readable

STAGES = Path(__file__).parents[2] / "stages"
SECTIONS = ("TOKENS", "STRINGS", "FIELDS", "FIELDSETS", "PATHS", "SPECS")


@pytest.fixture
def binary(tmp_path):
    """An example stage as a binary file."""
    path = tmp_path / "stage.usdc"
    Sdf.Layer.FindOrOpen(str(STAGES / "plume.usda")).Export(str(path))
    return path


@pytest.mark.parametrize("section", SECTIONS)
def test_counts_beyond_all_bounds_are_refused(binary, section):
    """A section said to have 2³⁰ entries, for which USD alone takes gigabytes: one line that names the file."""
    binary.write_bytes(with_count(binary.read_bytes(), section, 2**30))
    with pytest.raises(ValueError, match=r"stage\.usdc: not a USD stage: ") as refused:
        check_readable(binary)
    assert "\n" not in str(refused.value)


def test_sound_stages_pass(binary, tmp_path):
    """A sound binary stage, a text that names it, and a stage with moving points are found readable."""
    check_readable(binary)
    (tmp_path / "shot.usda").write_text("#usda 1.0\n(\n    subLayers = [@./stage.usdc@]\n)\n")
    check_readable(tmp_path / "shot.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "moving.usdc"))
    points = UsdGeom.Points.Define(stage, "/Points").GetPointsAttr()
    for frame in range(5):
        points.Set([(frame, 0, 0)], frame)
    stage.Save()
    check_readable(tmp_path / "moving.usdc")


def test_a_damaged_layer_of_a_text_is_found(binary, tmp_path):
    """A text is refused that names a damaged binary layer through another text."""
    binary.write_bytes(with_count(binary.read_bytes(), "PATHS", 2**30))
    (tmp_path / "set.usda").write_text('#usda 1.0\ndef "Set" (\n    references = @./stage.usdc@</World>\n)\n{\n}\n')
    (tmp_path / "shot.usda").write_text("#usda 1.0\n(\n    subLayers = [@./set.usda@]\n)\n")
    with pytest.raises(ValueError, match=r"shot\.usda: not a USD stage"):
        check_readable(tmp_path / "shot.usda")


def test_text_is_not_tried(monkeypatch, tmp_path):
    """For stages of text, folders, and what is not there, no process is forked."""
    monkeypatch.setattr(os, "fork", lambda: pytest.fail("forked"))
    check_readable(STAGES / "plume.usda")
    (tmp_path / "shot.usda").write_text(f"#usda 1.0\n(\n    subLayers = [@{STAGES}/plume.usda@, @./shot.usda@]\n)\n")
    check_readable(tmp_path / "shot.usda")
    check_readable(tmp_path)
    check_readable(tmp_path / "none.usdc")


def test_crashes_and_endless_loops_are_told(monkeypatch, binary):
    """A crash of USD is told with its signal; a file that it never comes to the end of is given up."""
    monkeypatch.setattr(probe, "_try", lambda path: signal.raise_signal(signal.SIGKILL))
    with pytest.raises(ValueError, match=r"stage\.usdc: not a USD stage: it is damaged: USD crashes on it \(SIGKILL\)"):
        check_readable(binary)

    def loop(path):
        while True:
            pass

    monkeypatch.setattr(probe, "_try", loop)
    monkeypatch.setattr(probe, "_SECONDS", 0.1)
    monkeypatch.setattr(probe, "_SECONDS_PER_BYTE", 0.0)
    with pytest.raises(ValueError, match=r"USD does not finish opening it in \d+ s"):
        check_readable(binary)


def test_a_child_that_falls_asleep_is_tried_again(monkeypatch, binary, tmp_path):
    """By chance a child inherits a lock that nobody opens: the next one finds the damage."""
    monkeypatch.setattr(probe, "_ASLEEP", 0.1)
    slept = tmp_path / "slept"

    def sleep_once(path):
        if not slept.exists():
            slept.touch()
            time.sleep(60.0)
        return "its names are not UTF-8"

    monkeypatch.setattr(probe, "_try", sleep_once)
    with pytest.raises(ValueError, match=r"stage\.usdc: not a USD stage: its names are not UTF-8"):
        check_readable(binary)
    assert slept.exists()


def test_large_or_slow_files_are_left_to_the_reader(monkeypatch, binary):
    """A stage that takes long because there is much of it, or because the disk is slow, is not called damaged."""
    monkeypatch.setattr(probe, "_try", lambda path: time.sleep(60.0))
    monkeypatch.setattr(probe, "_ASLEEP", 0.1)
    check_readable(binary)
    assert probe._judge(11.0, 0, 2**27) == ""
    assert probe._judge(11.0, 0, 10**6) is None
    assert probe._judge(13.0, 0, 10**6).endswith("in 13 s")
    assert probe._judge(1.0, 2**30, 10**6).endswith("1.0 GiB of memory to open it")
    assert probe._judge(1.0, 2**30, 10**7) is None
