"""The preview of a stage: a window, and pictures, movies and pages; the only part that imports pyvista."""

import errno
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

if TYPE_CHECKING:
    from warp_smoke.output import Result
    from warp_smoke.preview.live import LivePreview
    from warp_smoke.preview.stage import PreviewStage
    from warp_smoke.preview.view import Look
    from warp_smoke.scene import Scene

__all__ = ["live_preview", "preview"]

# Voxels between samples in the window and in pictures. At 2.5 a plume differs by 0.5 of 255 (root mean square) from
# one with two samples per voxel, and smoke takes half the time that it takes at 1.
STEP, STEP_STILL = 2.5, 1.0
# Suffixes of picture files.
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")
# A picture is drawn this many times larger along each side and averaged.
SUPERSAMPLES = 2


def preview(
    shown: "str | Path | Result",
    frame: int | None = None,
    screenshot: str | Path | None = None,
    size: tuple[int, int] = (1280, 720),
    *,
    camera: str | None = None,
    movie: str | Path | None = None,
    html: str | Path | None = None,
    quantity: str | None = None,
    marks: bool = False,
    on_frame: Callable[[int, int], None] | None = None,
) -> None:
    """Shows a stage in a window, or saves pictures of it; everything is read from its files.

    In a Jupyter notebook the picture appears below the cell instead of in a window.

    Args:
        shown: a USD stage, a folder that a run wrote, or what `run` returned.
        frame: shown first, or in the picture; the middle one unless given.
        screenshot: the picture's file; then no window is opened and no display is needed.
        size: width and height [pixels].
        camera: prim path of the camera to look through; the stage's own unless given.
        movie: file of a movie of all frames, .mp4 or .gif; opens no window either.
        html: file of a web page with pictures of all frames; opens no window either.
        quantity: density, temperature or speed, to show on a slice through the smoke.
        marks: whether pictures mark lights, and before a run domains and emitters; in the window `g` toggles them.
        on_frame: called for each frame of a movie or page once it is drawn, with its number and how many there are.

    Raises:
        ValueError: bad input, or no display to open a window on.
        OSError: a file cannot be read or written.
        KeyboardInterrupt: Ctrl-C; it closes the window.
        ImportError: a system library or program is missing.
    """
    from warp_smoke.preview import movie as movies
    from warp_smoke.preview import opengl
    from warp_smoke.preview import page as pages
    from warp_smoke.preview.slices import QUANTITIES
    from warp_smoke.preview.stage import PreviewStage
    from warp_smoke.preview.view import Look, StageView
    from warp_smoke.preview.window import Window

    path = getattr(shown, "stage", shown)
    stage = PreviewStage(path, camera)
    frames = stage.scene.frames
    if frame is None:
        frame = stage.scene.middle_frame
    if frame not in frames:
        raise ValueError(f"{path}: frame is {frame}; allowed: {frames[0]} to {frames[-1]}")
    if quantity is not None and quantity not in QUANTITIES:
        raise ValueError(f"quantity is {quantity}; allowed: {', '.join(QUANTITIES)}")
    files = (("screenshot", screenshot, PICTURES), ("movie", movie, movies.FORMATS), ("html", html, pages.FORMATS))
    for kind, file, formats in files:
        if file is not None:
            _check_file(kind, Path(file), formats)
    rate, look = stage.scene.time_codes_per_second, Look(marks=marks)
    if movie is not None:
        movies.check_movie(Path(movie))
        movies.write_movie(Path(movie), _draw(stage, frames, size, look, quantity, on_frame), rate)
    if html is not None:
        pictures = _draw(stage, frames, size, look, quantity, on_frame)
        pages.write_page(Path(html), pictures, frames, rate, Path(path).name)
    notebook = screenshot is None and movie is None and html is None and _in_notebook()
    if screenshot is not None or notebook:
        (pixels,) = _draw(stage, [frame], size, look, quantity, None)
        if notebook:
            _display(pixels)
        else:
            Image.fromarray(pixels).save(screenshot)
    elif movie is None and html is None:
        plotter = opengl.open_window(size, f"{Path(path).name} - warp-smoke")
        window = Window(stage, StageView(stage, plotter, STEP), frame)
        if quantity is not None:
            window.show_quantity(quantity)
        window.run()


def live_preview(scene: "Scene", size: tuple[int, int] = (640, 480)) -> "LivePreview":
    """Opens a window for `run(scene, on_frame=live_preview(scene))`; drawing adds at most a tenth to the run's time.

    Raises:
        ValueError: there is no display.
        ImportError: a system library is missing.
    """
    from warp_smoke.preview import opengl
    from warp_smoke.preview.live import LivePreview

    name = scene.source.name if scene.source else "scene"
    return LivePreview(scene, opengl.open_window(size, f"{name} - warp-smoke, running"))


def _check_file(kind: str, file: Path, formats: tuple[str, ...]) -> None:
    """Refuses, before anything is drawn, a file of unknown format or in a folder that does not exist."""
    if file.suffix.lower() not in formats:
        raise ValueError(f"{kind} is {file}; allowed: a name that ends in {', '.join(formats)}")
    if not file.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(file.parent))


def _draw(
    stage: "PreviewStage",
    frames: "range | list[int]",
    size: tuple[int, int],
    look: "Look",
    quantity: str | None,
    on_frame: Callable[[int, int], None] | None,
) -> Iterator[np.ndarray]:
    """Yields a picture of each frame, [h, w, 3] uint8."""
    from warp_smoke.preview import opengl
    from warp_smoke.preview.view import StageView

    plotter = opengl.open_off_screen((SUPERSAMPLES * size[0], SUPERSAMPLES * size[1]))
    try:
        view = StageView(stage, plotter, STEP_STILL, look)
        for number in frames:
            view.show(stage.load(number, quantity=quantity))
            yield np.asarray(Image.fromarray(view.picture()).resize(size, Image.Resampling.BOX))
            if on_frame:
                on_frame(number, len(frames))
    finally:
        plotter.close()


def _in_notebook() -> bool:
    try:
        from IPython import get_ipython
    except ImportError:
        return False
    shell = get_ipython()
    return shell is not None and hasattr(shell, "kernel")


def _display(pixels: np.ndarray) -> None:
    from IPython.display import display

    display(Image.fromarray(pixels))
