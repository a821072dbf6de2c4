"""Times the preview's drawing off-screen, and writes docs/drawing.md.

    python scripts/benchmark_preview.py [REPEATS]

The stage is stages/plume.usda with 64 cells a side: a frame of its plume, and its domain full of smoke, which is the
most expensive to draw. Figures are medians.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter

import warp_smoke as ws
from warp_smoke.preview import STEP
from warp_smoke.preview.live_stage import LiveStage
from warp_smoke.preview.opengl import open_off_screen
from warp_smoke.preview.stage import Frame
from warp_smoke.preview.view import StageView
from warp_smoke.study.disclosure import processor

ROOT = Path(__file__).parents[1]
STAGE, CELLS, FRAME = ROOT / "stages" / "plume.usda", 64, 40
SIZE, REPEATS = (640, 480), 25


def milliseconds(work: Callable[[], object], repeats: int) -> str:
    """Measures the median time of some work [ms]."""
    times = []
    for _ in range(repeats):
        began = perf_counter()
        work()
        times.append(1e3 * (perf_counter() - began))
    return f"{median(times):.0f}"


def page(repeats: int) -> str:
    """Measures, and returns the results as Markdown."""
    scene = ws.Scene.open(STAGE)
    scene = replace(scene, domains=[replace(domain, resolution=CELLS) for domain in scene.domains])
    simulation = ws.Simulation(scene)
    for _ in range(FRAME):
        made = simulation.step()
    stage = LiveStage(scene)
    view = StageView(stage, open_off_screen(SIZE), STEP)

    def new_picture(frame: Frame) -> None:
        view.show(frame)
        view.picture()

    def turned_picture() -> None:
        view.plotter.camera.azimuth += 3.0
        view.picture()

    rows = [("ms", "a new frame", "the same from elsewhere"), ("---",) * 3]
    for name, frame in {f"frame {FRAME}": stage.frame(made), "full of smoke": stage.full_frame()}.items():
        new_picture(frame)  # compiles the driver's shaders
        rows.append((name, milliseconds(partial(new_picture, frame), repeats), milliseconds(turned_picture, repeats)))
    view.plotter.close()
    return "\n".join(
        [
            "# What drawing costs",
            "",
            f"Written by `python scripts/benchmark_preview.py` on {os.cpu_count()} cores ({processor()}), without a",
            f"graphics card: medians of {repeats} pictures of `stages/{STAGE.name}` with {CELLS} cells a side, drawn",
            f"off-screen with {'×'.join(map(str, SIZE))} pixels as the preview's window draws them. A new frame's",
            "smoke is first handed to VTK. Reading its files and finding its light, which the window does in the",
            "background, is not timed.",
            "",
            *(f"| {' | '.join(row)} |" for row in rows),
            "",
        ]
    )


if __name__ == "__main__":
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else REPEATS
    (ROOT / "docs" / "drawing.md").write_text(page(repeats), encoding="utf-8")
