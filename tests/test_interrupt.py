"""Ctrl-C, SIGTERM and kill -9 at any moment: no traceback, the right exit status, nothing half written or lost."""

import hashlib
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Usd
from scenes import at, plume

import warp_smoke as ws
from warp_smoke.checkpoint import read_checkpoint
from warp_smoke.interrupt import Interrupted, Interruption

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143}


def command(stage, folder, *options, **settings):
    """The command line in a process of its own, with Ctrl-C as in a terminal."""
    args = [sys.executable, "-m", "warp_smoke_command", "run", stage, "-o", folder, "--threads", "1", *options]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(list(map(str, args)), **pipes, **settings)


def wait_for(process, path):
    """Waits until a process has made a file."""
    while not path.exists():
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.002)


def wait_for_handlers(process):
    """Waits until the command answers signals itself: before that Python has only begun to start."""
    caught = 0
    while not caught >> (signal.SIGTERM - 1) & 1:
        status = Path(f"/proc/{process.pid}/status").read_text()
        caught = int(status.partition("SigCgt:")[2].split()[0], 16)
        time.sleep(0.001)


def digests(folder):
    """A hash of every file that is not hidden, but the report, which holds times, and checkpoints."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.startswith(".")]
    files = [path for path in files if path.name != "report.json" and path.suffix != ".checkpoint"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """A stage of a second or so, the files that it gives, and how long its frames take."""
    path = tmp_path_factory.mktemp("shot") / "shot.usda"
    ball = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 16), transform=at(0.1, 1.4, 0))
    replace(plume(resolution=20, frames=24, vorticity=0.3), colliders=[ball]).save(path)
    result = ws.run(path, path.parent / "whole", threads=1)
    return path, digests(result.folder), result.report["seconds"]["frames"]


@pytest.fixture
def out(shot, request):
    """A folder for results beside those of the whole run, so that the stage is named by the same relative path."""
    return shot[0].parent / request.node.name


@pytest.mark.parametrize("number", STATUS)
@pytest.mark.parametrize("seconds", [0.0, 0.5])
def test_stops_while_everything_is_loaded(shot, tmp_path, number, seconds):
    """A signal in the first second, while Python, USD and Warp load, ends the command: a word, and no traceback."""
    process = command(shot[0], tmp_path / "out")
    wait_for_handlers(process)
    time.sleep(seconds)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == STATUS[number]
    assert out == ""
    assert err.splitlines()[-1].startswith("Stopp")
    assert "Traceback" not in err


@pytest.mark.parametrize("number", STATUS)
def test_stops_between_frames(shot, out, number):
    """A signal while frames are made: the frame in hand is kept, the stage opens, and --resume makes the same files."""
    stage, expected, _ = shot
    process = command(stage, out)
    wait_for(process, out / "volumes" / "Smoke.0004.vdb")
    process.send_signal(number)
    printed, err = process.communicate(timeout=60)
    assert (process.returncode, printed) == (STATUS[number], "")
    lines = err.splitlines()
    frame = read_checkpoint(out / "shot.checkpoint").frame
    assert lines == [
        "Stopping after the current frame; a second signal stops at once.",
        f"Stopped after frame {frame} of 24; --resume continues from there.",
    ]
    assert len(list((out / "volumes").iterdir())) == frame >= 4
    assert Usd.Stage.Open(str(out / "shot.usda")).GetEndTimeCode() == frame
    assert ws.run(stage, out, resume=True).report["resumed_after"] == frame
    assert digests(out) == expected


def test_a_second_signal_stops_at_once(tmp_path):
    """In the middle of a frame that takes long: the process is gone long before the frame would be."""
    stage = tmp_path / "slow.usda"
    plume(resolution=128, frames=30, max_courant=0.02, buoyancy_density=-30.0).save(stage)
    process = command(stage, tmp_path / "out")
    wait_for(process, tmp_path / "out" / "volumes" / "Smoke.0001.vdb")
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    time.sleep(0.3)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=5)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "Stopped."
    assert "Traceback" not in err


def test_python_callers_get_their_handlers_back(tmp_path):
    """`ws.run` raises a KeyboardInterrupt that says which signal came; the handlers from before are there again."""
    handlers = [signal.getsignal(number) for number in STATUS]

    def stop(frame):
        if frame.number == 2:
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(Interrupted, match="Stopped after frame 2 of 4") as stopped:
        ws.run(plume(), tmp_path, on_frame=stop)
    assert stopped.value.signal == signal.SIGTERM
    assert [signal.getsignal(number) for number in STATUS] == handlers
    assert read_checkpoint(tmp_path / "scene.checkpoint").frame == 2


def test_a_signal_in_the_last_frame_changes_nothing(tmp_path):
    """There is nothing left to stop: the run comes to its end."""

    def stop(frame):
        if frame.number == 4:
            signal.raise_signal(signal.SIGINT)

    assert ws.run(plume(), tmp_path, on_frame=stop).stage.exists()


def test_ignored_signals_stay_ignored():
    """What nohup, or a shell for its background jobs, has switched off does not stop a run."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Interruption() as interruption:
            signal.raise_signal(signal.SIGINT)
        assert interruption.signal is None
    finally:
        signal.signal(signal.SIGINT, before)


def kill_at_random(shot, folder, kills, seed):
    """Kills a run at random moments, looks at what is there, and goes on; gives how many frames each kill costs."""
    stage, expected, seconds = shot
    moments, again = random.Random(seed), []
    while len(again) < kills:
        process = command(stage, folder, "--resume", "--checkpoint-every", moments.choice([1, 2, 5]))
        if moments.random() < 0.8:
            process.stderr.readline()  # comes with the first frame; else most moments would be before it
        moment = moments.uniform(0.0, seconds)
        time.sleep(moment)
        process.kill()
        process.communicate()
        if (folder / "report.json").exists():
            assert digests(folder) == expected
            print("came to its end: every file the same; from the start again")
            for path in [path for path in folder.rglob("*") if path.is_file()]:
                path.unlink()
            continue
        found = digests(folder)
        frames = {name: digest for name, digest in found.items() if name.startswith(("volumes/", "textures/"))}
        assert frames.items() <= expected.items()  # each file that has its final name is whole
        checkpoint = folder / "shot.checkpoint"
        saved = read_checkpoint(checkpoint).frame if checkpoint.exists() else None
        if (folder / "shot.usda").exists():
            assert Usd.Stage.Open(str(folder / "shot.usda"))
        volumes = len(list((folder / "volumes").glob("[!.]*.vdb")))
        partial = len(list(folder.rglob(".*.partial.*")))
        assert saved is None or volumes >= saved
        again.append(volumes - (saved or 0))
        print(f"kill {len(again)}: {moment:.3f} s, {volumes} frames, checkpoint {saved}, {partial} partial files")
    print("last: going on after frame", ws.run(stage, folder, resume=True).report["resumed_after"])
    assert digests(folder) == expected
    assert not list(folder.rglob(".*"))
    return again


def test_killed_and_gone_on(shot, out):
    """After kill -9 every file under its final name is whole, and the run goes on to the same bytes."""
    kill_at_random(shot, out, kills=1, seed=3)


@pytest.mark.slow
def test_killed_twenty_times(shot, out, record_property):
    """After kill -9 at twenty random moments the same; frames since the last checkpoint are made again."""
    again = kill_at_random(shot, out, kills=20, seed=6)
    record_property("frames of 24 made again after a kill", max(again))


@pytest.mark.slow
@pytest.mark.parametrize("number", STATUS)
def test_stops_at_any_moment(shot, tmp_path, number):
    """Ten random moments between the first line of the command and the last frame: the status, and no traceback."""
    moments = random.Random(int(number))
    for attempt in range(10):
        process = command(shot[0], tmp_path / str(attempt))
        wait_for_handlers(process)
        moment = moments.uniform(0.0, 3.0)
        time.sleep(moment)
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
        print(f"{moment:.2f} s: status {process.returncode}, {err.splitlines()[-1] if err else 'finished'}")
        assert process.returncode in (STATUS[number], 0)
        assert "Traceback" not in err
        assert process.returncode == 0 or err.splitlines()[-1].startswith("Stopped")
