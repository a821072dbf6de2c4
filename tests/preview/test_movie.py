"""Movies and pages: as many frames as the stage has, in their order, with what was drawn."""

import re
import shutil
import subprocess
from base64 import b64decode
from io import BytesIO

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


@pytest.mark.skipif(not shutil.which("ffmpeg"), reason="needs ffmpeg")
def test_mp4_plays(tmp_path):
    """What ffmpeg reads back are the frames that were given, in order; odd sizes lose a row and a column."""
    pictures = [np.full((61, 81, 3), grey, np.uint8) for grey in (20, 120, 220)]
    write_movie(tmp_path / "grey.mp4", pictures, 24.0)
    command = [
        "ffmpeg",
        "-loglevel",
        "error",
        "-i",
        str(tmp_path / "grey.mp4"),
        "-f",
        "rawvideo",
        "-pix_fmt",
        "gray",
        "-",
    ]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    frames = np.frombuffer(raw, np.uint8).reshape(3, 60, 80)
    np.testing.assert_allclose(frames.mean(axis=(1, 2)), [20, 120, 220], atol=3)


def test_no_ffmpeg_is_said_before_anything_is_drawn(results, tmp_path, monkeypatch):
    """Without ffmpeg an .mp4 is refused in one line that names the way out, and nothing is left behind."""
    monkeypatch.setattr(movie.shutil, "which", lambda name: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"an \.mp4 needs ffmpeg: .* \.gif and --html need neither"):
        preview(results, movie=tmp_path / "ball.mp4", size=SIZE)
    assert not list(tmp_path.iterdir())


def test_other_formats_are_refused(results, tmp_path):
    """A name that says no known format is bad input."""
    with pytest.raises(ValueError, match=r"movie is .*ball\.avi; allowed: a name that ends in \.mp4 or \.gif"):
        preview(results, movie=tmp_path / "ball.avi")
