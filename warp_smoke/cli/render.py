"""`warp-smoke render`: a ray-cast picture."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import warp_smoke
from warp_smoke.cli.console import say_written, warn
from warp_smoke.cli.load import load
from warp_smoke.cli.options import DeviceOptions, picture_size
from warp_smoke.usd.find import find_stage


def render(
    path: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    frame: int | None = None,
    camera: str | None = None,
    size: str = "640x360",
    quality: str | None = None,
    samples: int | None = None,
    shading: str = "pixel",
    device: DeviceOptions = DeviceOptions(),
):
    """Ray-cast a picture through the stage's camera: surfaces, their shadows, and smoke.

    Args:
        path: A USD stage, whose smoke is simulated up to the frame, or a folder written by `run`, whose smoke is read.
        output: The PNG file to write.
        frame: The frame to render; the middle one unless given.
        camera: Prim path of the camera to look through; the stage's own unless given.
        size: Width and height in pixels.
        quality: draft, preview or final: measured settings for the samples, and for smoke that has to be simulated.
        samples: Rays along each side of a pixel; 2, or the quality's number, unless given.
        shading: pixel or vertex: where lighting is computed.
        device: Where it runs.
    """
    load("warp_smoke.picture", "warp_smoke.usd.own_look", "warp_smoke.usd.read_volume")
    from warp_smoke.usd.probe import check_readable

    check_readable(find_stage(path))
    options = {"quality": quality, "samples": samples, "shading": shading} | asdict(device)
    options["on_warning"] = lambda text: warn([text])
    warp_smoke.render(path, output, frame=frame, camera=camera, size=picture_size(size), **options)
    say_written([output])
