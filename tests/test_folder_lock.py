"""Two runs in one folder: the second is told which process is at work, and nothing is overwritten."""

import fcntl
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from scenes import plume

from warp_smoke.folder_lock import check_unlocked, locked

_HOLD = """
import sys, time
from pathlib import Path
from warp_smoke.folder_lock import locked

with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_folder_is_held_once(tmp_path):
    """Not by another block, of whatever thread; once it is let go of it is free, and no file stays."""
    check_unlocked(tmp_path)
    with locked(tmp_path):
        busy = f"output folder is in use by process {os.getpid()}; allowed: a folder that no other run writes to"
        with pytest.raises(ValueError, match=busy), locked(tmp_path):
            pytest.fail("held twice")
        with pytest.raises(ValueError, match=busy):
            check_unlocked(tmp_path)
    check_unlocked(tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_check_does_not_refuse_a_run(tmp_path):
    """A run that begins while another is looking whether the folder is free waits for that moment."""
    (tmp_path / ".run.lock").touch()
    with open(tmp_path / ".run.lock") as looking:
        fcntl.flock(looking, fcntl.LOCK_SH)
        threading.Timer(0.03, fcntl.flock, (looking, fcntl.LOCK_UN)).start()
        with locked(tmp_path):
            pass


def test_a_killed_process_holds_nothing(tmp_path):
    """While it lives it is named; after kill -9 its file is still there, but the folder is free."""
    process = subprocess.Popen([sys.executable, "-c", _HOLD, tmp_path], stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    with pytest.raises(ValueError, match=f"in use by process {process.pid}"):
        check_unlocked(tmp_path)
    process.kill()
    process.communicate()
    assert len(list(tmp_path.iterdir())) == 1
    check_unlocked(tmp_path)
    with locked(tmp_path):
        pass
    assert not list(tmp_path.iterdir())


def contents(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("options", [(), ("--resume",)], ids=["anew", "resume"])
def test_a_second_run_is_refused(tmp_path, options):
    """While a run is at work, halted here, a second one ends with status 2 and one line; the first comes to its end."""
    stage, out = tmp_path / "shot.usda", tmp_path / "out"
    plume(resolution=12, frames=40).save(stage)
    command = [sys.executable, "-m", "warp_smoke_command", "run", stage, "-o", out, "--threads", "1"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    first = subprocess.Popen(command, **pipes)
    while not (out / "volumes" / "Smoke.0003.vdb").exists():
        assert first.poll() is None
        time.sleep(0.002)
    first.send_signal(signal.SIGSTOP)
    os.waitpid(first.pid, os.WUNTRACED)  # until all of its threads stand still
    try:
        before = contents(out)
        second = subprocess.run([*command, *options], **pipes, check=False)
        assert contents(out) == before
    finally:
        first.send_signal(signal.SIGCONT)
    line = f"error {out}: output folder is in use by process {first.pid}; allowed: a folder that no other run writes to"
    assert (second.returncode, second.stdout, second.stderr) == (2, "", line + "\n")
    first.communicate(timeout=100)
    assert first.returncode == 0
    assert len(list((out / "volumes").iterdir())) == 40
    assert not list(out.rglob(".*"))
