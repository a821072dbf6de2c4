"""The window on a real screen, Xvfb's, with real keys and a real mouse: xdotool's."""

import ctypes
import os
import re
import shutil
import signal
import subprocess
import sys
from io import BytesIO
from time import monotonic, sleep

import numpy as np
import pytest
from PIL import Image
from pxr import Usd
from scenes import plume

from warp_smoke.preview import preview
from warp_smoke.preview.stage import PreviewStage
from warp_smoke.usd.author import author_scene

PROGRAMS = ("Xvfb", "xdotool", "import")
pytestmark = [
    pytest.mark.skipif(
        not all(map(shutil.which, PROGRAMS)),
        reason="needs Xvfb, xdotool and ImageMagick's import (apt-get install xvfb xdotool imagemagick)",
    ),
    pytest.mark.xdist_group("screen"),  # two servers that start at once may be given one display's number
]
WIDTH, HEIGHT = 400, 300
PATIENCE = 60.0  # for a busy machine [s]
LIT, DARK = 200, 100  # of the floor in the frames 3 and 4
# Pixels on the baked floor beside the ball of smoke, and in the ball's middle.
FLOOR, BALL = (45, 235), (200, 150)


class Screen:
    """A display of its own on which one command at a time has its window at (0, 0)."""

    def __init__(self):
        reads, writes = os.pipe()
        options = ["-displayfd", str(writes), "-screen", "0", "640x480x24", "-nolisten", "tcp", "-noreset"]
        self._server = subprocess.Popen(["Xvfb", *options], pass_fds=[writes], stderr=subprocess.DEVNULL)
        os.close(writes)
        with os.fdopen(reads) as pipe:
            self.environment = {**os.environ, "DISPLAY": f":{pipe.readline().strip()}"}

    def run(self, *arguments):
        """Starts `warp-smoke` with these arguments."""
        command = [sys.executable, "-c", "from warp_smoke.cli import main; main()", *map(str, arguments)]
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        self._shows = subprocess.Popen(command, env=self.environment, start_new_session=True, **options)
        return self._shows

    def act(self, *arguments):
        """What xdotool answers."""
        command = ["xdotool", *map(str, arguments)]
        return subprocess.run(command, env=self.environment, capture_output=True, text=True).stdout

    def press(self, key):
        """Presses a key with the mouse over the window, where keys go without a window manager."""
        self.act("mousemove", WIDTH // 2, HEIGHT // 2, "key", key)

    def drag(self, start, end):
        """Moves the mouse with its left button held."""
        self.act("mousemove", *start, "mousedown", 1)
        for share in (0.3, 0.6, 1.0):
            self.act("mousemove", *(round(a + share * (b - a)) for a, b in zip(start, end, strict=True)))
            sleep(0.1)
        self.act("mouseup", 1)

    def picture(self):
        """What is on the screen where the window is, [h, w, 3] int."""
        command = ["import", "-window", "root", "-crop", f"{WIDTH}x{HEIGHT}+0+0", "-depth", "8", "ppm:-"]
        shot = subprocess.run(command, env=self.environment, capture_output=True, check=True).stdout
        return np.asarray(Image.open(BytesIO(shot)).convert("RGB")).astype(int)

    def wait_for(self, condition, what):
        """The picture for which a condition holds, once it does."""
        until = monotonic() + PATIENCE
        while monotonic() < until:
            picture = self.picture()
            if condition(picture):
                return picture
            if self._shows.poll() is not None:
                raise AssertionError(f"ended with {self._shows.returncode}: {self._shows.stdout.read()}")
            sleep(0.1)
        raise AssertionError(f"not seen within {PATIENCE} s: {what}")

    def settled(self):
        """The picture once it no longer changes."""
        picture = self.picture()
        while (before := picture) is not None:
            sleep(0.5)
            if np.array_equal(before, picture := self.picture()):
                return picture

    def ask_to_close(self, title):
        """What a window manager does when its button is clicked: sends WM_DELETE_WINDOW."""
        window = int(self.act("search", "--name", title).split()[-1])
        x11 = ctypes.CDLL("libX11.so.6")
        x11.XOpenDisplay.restype = ctypes.c_void_p
        display = ctypes.c_void_p(x11.XOpenDisplay(self.environment["DISPLAY"].encode()))
        protocols, delete = (x11.XInternAtom(display, name, 0) for name in (b"WM_PROTOCOLS", b"WM_DELETE_WINDOW"))
        event = (ctypes.c_long * 24)()
        client_message, thirty_two_bits = 33, 32
        event[0], event[4], event[5], event[6], event[7] = client_message, window, protocols, thirty_two_bits, delete
        x11.XSendEvent(display, ctypes.c_ulong(window), 0, ctypes.c_long(0), ctypes.byref(event))
        x11.XSync(display, 0)
        x11.XCloseDisplay(display)

    def close(self):
        """Ends the display."""
        self._server.terminate()
        self._server.wait()


@pytest.fixture(scope="module")
def screen():
    """A screen without anything else on it."""
    screen = Screen()
    yield screen
    screen.close()


@pytest.fixture
def start(screen):
    """Starts commands on the screen, and ends those that a failed test has left."""
    started = []

    def start_one(*arguments):
        started.append(screen.run(*arguments))
        return started[-1]

    yield start_one
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


def _is(grey):
    return lambda picture: (np.abs(picture[FLOOR[1], FLOOR[0]] - grey) <= 2).all()


def _differs(before, at_least=200):
    return lambda picture: (np.abs(picture - before).max(axis=2) > 20).sum() >= at_least


def _ended(process):
    """Status and output of a process once it ends."""
    output, _ = process.communicate(timeout=PATIENCE)
    return process.returncode, output


def test_keys_and_mouse(results, screen, start):
    """Keys step, switch and play, sliders are dragged, the mouse turns and c looks through the camera again, q ends."""
    process = start("preview", results, "--frame", 3, "--size", f"{WIDTH}x{HEIGHT}")
    first = screen.wait_for(_is(LIT), "frame 3")
    assert screen.act("search", "--name", f"^{results.name} - warp-smoke$").split()

    screen.press("Right")
    dark = screen.wait_for(_is(DARK), "frame 4")
    for key in ("s", "h", "g", "1", "d", "l", "F1"):  # no lamp's mark is in the picture, so that g changes nothing
        screen.press(key)
        if key != "g":
            screen.wait_for(_differs(dark), f"what {key} changes")
        screen.press("0" if key == "1" else key)
        screen.wait_for(lambda picture: not _differs(dark, 1)(picture), f"what it was before {key}")

    y = round(HEIGHT * 0.93)
    screen.drag((round(WIDTH * 0.66), y), (round(WIDTH * 0.3), y))
    screen.wait_for(_is(LIT), "frame 3, by its slider")
    screen.drag((round(WIDTH * 0.885), y), (round(WIDTH * 0.82), y))
    screen.wait_for(lambda picture: picture[FLOOR[1], FLOOR[0]].max() < LIT - 40, "a lower exposure")
    screen.drag((round(WIDTH * 0.82), y), (round(WIDTH * 0.885), y))
    screen.wait_for(lambda picture: picture[FLOOR[1], FLOOR[0]].max() > LIT - 20, "the exposure as it was")

    straight = screen.settled()
    screen.drag((200, 60), (290, 90))
    screen.wait_for(_differs(straight), "another side of the stage")
    screen.press("c")
    screen.wait_for(lambda picture: not _differs(straight, 1)(picture), "the camera's picture again")

    seen = set()
    screen.press("space")
    screen.wait_for(
        lambda picture: seen.add(picture[FLOOR[1], FLOOR[0]].sum()) or len(seen) > 1, "a play of the frames"
    )
    assert process.poll() is None
    assert first.shape == (HEIGHT, WIDTH, 3)
    screen.press("q")
    assert _ended(process) == (0, "")


def test_closed_by_the_window_manager(results, screen, start):
    """The button that closes the window ends the command as q does."""
    process = start("preview", results, "--frame", 3, "--size", f"{WIDTH}x{HEIGHT}")
    screen.wait_for(_is(LIT), "frame 3")
    screen.ask_to_close("warp-smoke")
    assert _ended(process) == (0, "")


def test_ctrl_c_closes_the_window(results, screen, start):
    """Ctrl-C in the terminal ends the command as it ends the others: one line, status 130."""
    process = start("preview", results, "--frame", 3, "--size", f"{WIDTH}x{HEIGHT}")
    screen.wait_for(_is(LIT), "frame 3")
    process.send_signal(signal.SIGINT)
    assert _ended(process) == (130, "Stopped.\n")


def test_a_stage_that_changes_on_disk(results, tmp_path, screen, start):
    """The window says that its files have changed, and r shows them as they are."""
    shutil.copytree(results.parent, tmp_path / "copy")
    path = tmp_path / "copy" / results.name
    process = start("preview", path, "--frame", 3, "--size", f"{WIDTH}x{HEIGHT}")
    before = screen.wait_for(_is(LIT), "frame 3")
    stage = Usd.Stage.Open(str(path))
    stage.GetPrimAtPath("/World/Smoke_smoke").SetActive(False)
    stage.Save()
    said = screen.wait_for(_differs(before, 50), "word of the change")
    assert not (np.abs(said - before).max(axis=2) > 20)[40:].any()
    screen.press("r")
    x, y = BALL
    screen.wait_for(lambda picture: np.abs(picture[y, x] - before[y, x]).max() > 20, "no smoke")
    screen.press("q")
    assert _ended(process) == (0, "")


def test_a_watched_run_whose_window_is_closed(tmp_path, screen, start):
    """The run goes on without its window; Ctrl-C ends it after a frame, and its frames so far can be looked at."""
    author_scene(plume(frames=20000), tmp_path / "plume.usda")
    folder = tmp_path / "out"
    process = start("run", tmp_path / "plume.usda", "-o", folder, "--preview")
    screen.wait_for(lambda picture: picture.max() > 20, "the window")
    screen.ask_to_close("running")
    screen.wait_for(lambda picture: picture.max() == 0, "no window")
    made = len(list((folder / "volumes").iterdir()))
    until = monotonic() + PATIENCE
    while len(list((folder / "volumes").iterdir())) < made + 10:
        assert process.poll() is None
        assert monotonic() < until
        sleep(0.1)
    process.send_signal(signal.SIGINT)
    status, output = _ended(process)
    assert status == 130
    last = int(re.search(r"Stopped after frame (\d+) of 20000", output)[1])
    assert last >= made + 10
    assert PreviewStage(folder).scene.frames == range(1, last + 1)
    preview(folder, frame=last, screenshot=tmp_path / "last.png", size=(WIDTH, HEIGHT))
