"""Movies and pages: as many frames as the stage has, in their order, with what was drawn."""

import re
import shutil
import subprocess
from base64 import b64decode
from io import BytesIO

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image, ImageSequence

from warp_smoke.preview import movie, preview
from warp_smoke.preview.movie import write_movie

SIZE = (160, 120)


def test_gif_of_a_stage(results, tmp_path):
    """A picture for each frame in order, the floor as baked, at the stage's rate to 1/100 s; each is told of."""
    told = []
    preview(results, movie=tmp_path / "ball.gif", size=SIZE, on_frame=lambda *frame: told.append(frame))
    with Image.open(tmp_path / "ball.gif") as image:
        frames = [np.asarray(one.convert("RGB")).astype(int) for one in ImageSequence.Iterator(image)]
        assert image.info["duration"] == 40  # 1/24 s
        assert image.info["loop"] == 0
    assert told == [(3, 2), (4, 2)]
    assert [abs(frame[105:112, 18:23].mean() - grey) < 4 for frame, grey in zip(frames, (200, 100), strict=True)]
    assert frames[0].shape == (120, 160, 3)


def test_page_of_a_stage(results, tmp_path):
    """The page holds each frame as JPEG, near to what a screenshot shows, and refers to no other file."""
    preview(results, html=tmp_path / "ball.html", size=SIZE)
    preview(results, frame=4, screenshot=tmp_path / "ball.png", size=SIZE)
    text = (tmp_path / "ball.html").read_text()
    pictures = [Image.open(BytesIO(b64decode(code))) for code in re.findall(r'^    "([A-Za-z0-9+/=]+)"', text, re.M)]
    assert len(pictures) == 2
    error = np.asarray(pictures[1]).astype(int) - np.asarray(Image.open(tmp_path / "ball.png"))
    assert np.abs(error).mean() < 2  # of JPEG
    assert "const numbers = [3, 4];" in text
    assert not re.search(r"https?:|src=\"", text)


def test_mp4_plays(tmp_path, monkeypatch):
    """With imageio-ffmpeg alone: what it reads back are the frames in order; odd sizes lose a row and a column."""
    monkeypatch.setattr(movie.shutil, "which", lambda name: None)
    pictures = [np.full((61, 81, 3), grey, np.uint8) for grey in (20, 120, 220)]
    write_movie(tmp_path / "grey.mp4", pictures, 24.0)
    reader = imageio_ffmpeg.read_frames(tmp_path / "grey.mp4", pix_fmt="gray", bits_per_pixel=8)
    facts = next(reader)
    assert facts["fps"] == 24.0
    assert facts["size"] == (80, 60)
    frames = np.stack([np.frombuffer(frame, np.uint8) for frame in reader])
    np.testing.assert_allclose(frames.mean(axis=1), [20, 120, 220], atol=3)


@pytest.mark.skipif(not shutil.which("chromium"), reason="needs Debian's chromium")
def test_a_browser_shows_the_page(results, tmp_path):
    """Chromium, without a network, draws the first frame's picture, and finds the slider and the frame's number."""
    preview(results, html=tmp_path / "ball.html", size=SIZE)
    command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--host-resolver-rules=MAP * ~NOTFOUND", f"--screenshot={tmp_path / 'seen.png'}"]
    command += ["--window-size=640,520", "--dump-dom", (tmp_path / "ball.html").as_uri()]
    page = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
    assert "<output>frame 3</output>" in page
    assert 'max="1"' in page
    seen = np.asarray(Image.open(tmp_path / "seen.png").convert("RGB")).astype(int)
    floor = np.abs(seen - 200).max(axis=2) < 8  # as baked
    assert floor.sum() > 5000
    assert np.ptp(np.nonzero(floor)[1]) > 500  # the picture fills the window


def test_two_outputs_at_once(results, tmp_path):
    """A movie and a page of one call have the same frames."""
    preview(results, movie=tmp_path / "ball.gif", html=tmp_path / "ball.html", size=SIZE)
    assert Image.open(tmp_path / "ball.gif").n_frames == 2
    assert "const numbers = [3, 4];" in (tmp_path / "ball.html").read_text()


def test_no_ffmpeg_is_said_before_anything_is_drawn(results, tmp_path, monkeypatch):
    """Without ffmpeg an .mp4 is refused in one line that names the way out, and nothing is left behind."""
    monkeypatch.setattr(movie.shutil, "which", lambda name: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"an \.mp4 needs ffmpeg: .* \.gif and --html need neither"):
        preview(results, movie=tmp_path / "ball.mp4", size=SIZE)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("kind", "name", "allowed"),
    [
        ("movie", "ball.avi", r"\.mp4, \.gif"),
        ("html", "ball.txt", r"\.html, \.htm"),
        ("screenshot", "ball.gif", r"\.png,"),
    ],
)
def test_other_formats_are_refused(results, tmp_path, kind, name, allowed):
    """A name that says no known format is bad input, refused with the known ones before anything is drawn."""
    with pytest.raises(ValueError, match=rf"{kind} is .*{name}; allowed: a name that ends in {allowed}"):
        preview(results, **{kind: tmp_path / name})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.png", "a.gif", "a.html"])
def test_a_folder_that_is_not_there(results, tmp_path, name):
    """A file in no folder is refused before anything is drawn."""
    kind = {".png": "screenshot", ".gif": "movie", ".html": "html"}[name[1:]]
    with pytest.raises(FileNotFoundError, match="nowhere"):
        preview(results, **{kind: tmp_path / "nowhere" / name}, on_frame=pytest.fail)
