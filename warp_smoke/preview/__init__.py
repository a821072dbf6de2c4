"""A look at a stage: the window, and pictures of it; the only part of the package that imports pyvista."""

from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

if TYPE_CHECKING:
    from warp_smoke.output import Result

__all__ = ["preview"]

# Voxels between samples in the window and in pictures: two look like one, and on a CPU take two thirds of the time.
STEP, STEP_STILL = 2.0, 1.0
# A picture is drawn this many times larger along each side and averaged.
SUPERSAMPLES = 2


def preview(
    shown: "str | Path | Result",
    frame: int | None = None,
    screenshot: str | Path | None = None,
    size: tuple[int, int] = (1280, 720),
) -> None:
    """Shows a stage in a window, or saves a picture of it; everything is read from its files.

    Args:
        shown: a USD stage, a folder that a run wrote, or what `run` returned.
        frame: shown first; the middle one unless given.
        screenshot: the picture's file; then no window is opened and no display is needed.
        size: width and height [pixels].

    Raises:
        ValueError: bad input, or no display to open a window on.
        OSError: a file cannot be read or written.
        ImportError: a library of the system is missing.
    """
    from warp_smoke.preview import opengl
    from warp_smoke.preview.stage import PreviewStage
    from warp_smoke.preview.view import StageView
    from warp_smoke.preview.window import Window

    path = getattr(shown, "stage", shown)
    stage = PreviewStage(path)
    frames = stage.scene.frames
    if frame is None:
        frame = frames[len(frames) // 2]
    if frame not in frames:
        raise ValueError(f"{path}: frame is {frame}; allowed: {frames[0]} to {frames[-1]}")
    if screenshot is None:
        plotter = opengl.open_window(size)
        Window(stage, StageView(stage, plotter, STEP), frame).run()
        return
    plotter = opengl.open_off_screen((SUPERSAMPLES * size[0], SUPERSAMPLES * size[1]))
    view = StageView(stage, plotter, STEP_STILL)
    view.show(stage.load(frame))
    picture = view.picture()
    plotter.close()
    Image.fromarray(picture).resize(size, Image.Resampling.BOX).save(screenshot)
