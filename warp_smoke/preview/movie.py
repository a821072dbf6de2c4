"""Pictures as a movie: `.mp4` through ffmpeg, or an animated `.gif`, which needs nothing but Pillow."""

import shutil
import subprocess
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np
from PIL import Image

from warp_smoke.files import replacing

FORMATS = (".mp4", ".gif")


def check_movie(file: Path) -> None:
    """Refuses, before anything is drawn, an .mp4 that could not be written.

    Raises:
        ImportError: there is no ffmpeg.
    """
    if file.suffix.lower() == ".mp4":
        _find_ffmpeg()


def write_movie(file: Path, pictures: Iterable[np.ndarray], rate: float) -> None:
    """Writes a movie.

    Args:
        file: .mp4 (H.264; an odd last row or column is cut off) or .gif (256 colours per frame, times in 1/100 s).
        pictures: [h, w, 3] uint8 sRGB each, top row first, all of one size.
        rate: pictures per second.

    Raises:
        ImportError: there is no ffmpeg for an .mp4.
        OSError: the file cannot be written.
    """
    with replacing(file) as partial:
        (_write_mp4 if file.suffix.lower() == ".mp4" else _write_gif)(partial, iter(pictures), rate)


def _write_gif(file: Path, pictures: Iterator[np.ndarray], rate: float) -> None:
    def palettes() -> Iterator[Image.Image]:
        for picture in pictures:
            yield Image.fromarray(picture).quantize(256, dither=Image.Dither.FLOYDSTEINBERG)

    images = palettes()
    first = next(images)
    first.save(file, "GIF", save_all=True, append_images=images, duration=max(10 * round(100 / rate), 20), loop=0)


def _write_mp4(file: Path, pictures: Iterator[np.ndarray], rate: float) -> None:
    first = next(pictures)
    height, width = first.shape[:2]
    command = [_find_ffmpeg(), "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", str(rate), "-i", "-", "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2"]
    command += ["-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(file)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        try:
            for picture in chain([first], pictures):
                process.stdin.write(np.ascontiguousarray(picture))
            process.stdin.close()
        except BrokenPipeError:  # ffmpeg says why on its way out
            pass
        said = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise OSError(f"{file}: ffmpeg failed: {said}")


def _find_ffmpeg() -> str:
    """Returns the system's ffmpeg, or else the one in the package imageio-ffmpeg."""
    found = shutil.which("ffmpeg")
    if found:
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError:
        raise ImportError(
            "an .mp4 needs ffmpeg: install it, or `pip install imageio-ffmpeg`; a .gif and --html need neither"
        ) from None
    return get_ffmpeg_exe()
