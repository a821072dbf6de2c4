"""A disk that fills up, and folders that cannot be written: one clear line, exit status, and no half file."""

import os
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from scenes import floor, plume

import warp_smoke as ws
from warp_smoke.usd.write import write_results
from warp_smoke.vdb import read_vdb


def command(*args, **settings):
    """The command line in a process of its own: its status, output and errors."""
    line = [sys.executable, "-m", "warp_smoke_command", *map(str, args)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=100, check=False, **settings)
    return done.returncode, done.stdout, done.stderr


@pytest.fixture
def stage(tmp_path):
    """A stage whose volumes grow past 27 000 bytes after ten frames."""
    path = tmp_path / "shot.usda"
    lit = replace(floor(texture_size=8), material=None)
    replace(plume(resolution=12, frames=40), surfaces=[lit], lights=()).save(path)
    return path


def check_folder(folder, stage):
    """Whole frames stay, with a stage that shows them and nothing hidden; the run goes on where there is room again."""
    assert not list(folder.rglob(".*.partial.*"))
    volumes = sorted((folder / "volumes").iterdir())
    assert volumes
    for path in volumes:
        assert "density" in read_vdb(path)
    result = ws.run(stage, folder, resume=True)
    assert len(list((folder / "volumes").iterdir())) == 40
    assert [each["frame"] for each in result.report["frames"]] == list(range(1, 41))


def test_a_file_that_cannot_be_written(stage, tmp_path):
    """A limit on the size of files stands for the disk: exit status 1, one line that names the file and the reason."""
    out = tmp_path / "out"
    limit = 27_000
    status, printed, err = command(
        *("run", stage, "-o", out, "--checkpoint-every", 0),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert (status, printed, err.count("\n")) == (1, "", 1)
    assert err.startswith(f"error {out}/volumes/Smoke.")
    assert "File too large" in err
    check_folder(out, stage)


def test_a_full_disk(stage, tmp_path):
    """The same on a disk of 200 KiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a small disk")
    try:
        status, printed, err = command("run", stage, "-o", disk / "out", "--checkpoint-every", 0)
        assert (status, printed, err.count("\n")) == (1, "", 1)
        assert err.startswith(f"error {disk}/out/")
        assert "No space left on device" in err
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        check_folder(disk / "out", stage)
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_for_layers(tmp_path):
    """USD's own errors come as one OSError that names the file, and no part of it stays."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a small disk")
    try:
        (disk / "other").write_bytes(bytes(16384))
        with pytest.raises(OSError, match="No space left on device") as failed:
            write_results(disk, "shot", plume())
        assert Path(failed.value.filename) == disk / "shot.scene.usdc"
        assert [path.name for path in disk.iterdir()] == ["other"]
    finally:
        subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.parametrize("inside", ["", "below/out"])
def test_a_folder_that_may_not_be_written(stage, tmp_path, inside):
    """Exit status 2 before anything is simulated, and a line that speaks of the permission."""
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    mounted = os.geteuid() == 0  # root may write to any folder but those of a disk that is read-only
    if mounted and subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "tmpfs", str(locked)], check=False).returncode:
        pytest.skip("root that may not mount")
    try:
        status, printed, err = command("run", stage, "-o", locked / inside)
    finally:
        if mounted:
            subprocess.run(["umount", str(locked)], check=True)
    line = (
        f"error {locked / inside}: output folder is without permission to write; allowed: a folder that may be written"
    )
    assert (status, printed, err) == (2, "", line + "\n")
