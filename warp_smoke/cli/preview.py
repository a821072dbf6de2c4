"""`warp-smoke preview`: a look at a stage or at results."""

from pathlib import Path

import warp_smoke
from warp_smoke.cli.console import progress_bar, say_written
from warp_smoke.cli.options import picture_size
from warp_smoke.usd.find import find_stage


def preview(
    path: Path,
    *,
    frame: int | None = None,
    camera: str | None = None,
    screenshot: Path | None = None,
    movie: Path | None = None,
    html: Path | None = None,
    show: str | None = None,
    marks: bool = False,
    size: str = "1280x720",
):
    """Look at a stage, or at the results in a folder: in a window (press h there), a picture, a movie or a web page.

    Args:
        path: A USD stage or a folder written by `run`.
        frame: Frame to show first; the middle one unless given.
        camera: Prim path of the camera to look through; the stage's own unless given.
        screenshot: Save a picture here instead of opening a window.
        movie: Save all frames as a movie here instead: .mp4 (needs ffmpeg or the package imageio-ffmpeg) or .gif.
        html: Save all frames here instead, as pictures in one web page that plays in any browser.
        show: density, temperature or speed: a coloured cut through the smoke, with a colour bar, instead of the smoke.
        marks: Mark lights, and before a run domains and emitters, in saved pictures too; the window marks them anyway,
            until g is pressed.
        size: Width and height in pixels.
    """
    from warp_smoke.usd.probe import check_readable

    pixels = picture_size(size)
    check_readable(find_stage(path))
    with progress_bar() as bar:
        outputs = [file for file in (movie, html) if file is not None]
        task = bar.add_task("Drawing", total=None, visible=bool(outputs))

        def show_frame(number: int, count: int) -> None:
            bar.update(task, advance=1, total=len(outputs) * count, description=f"Frame {number}")

        warp_smoke.preview(
            path,
            frame=frame,
            camera=camera,
            screenshot=screenshot,
            size=pixels,
            movie=movie,
            html=html,
            quantity=show,
            marks=marks,
            on_frame=show_frame,
        )
    say_written(filter(None, (screenshot, movie, html)))
