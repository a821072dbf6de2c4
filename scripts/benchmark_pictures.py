"""Times `warp-smoke render` on stages/columns.usda, and writes docs/pictures.md.

    python scripts/benchmark_pictures.py [REPEATS]

The command is timed as a complete process, as a user waits for it; its steps are timed in separate processes that do
the same step by step. Kernels have been compiled before. Figures are medians.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

from warp_smoke.study.disclosure import processor

ROOT = Path(__file__).parents[1]
STAGE, SIZE, REPEATS = ROOT / "stages" / "columns.usda", (640, 360), 15
SAMPLES = (1, 2)
STEPS = f"""
import gc, json
from time import perf_counter
laps = [perf_counter()]
def lap(): laps.append(perf_counter())
import sys
gc.disable()
import warp_smoke.cli
from warp_smoke.cli.load import load
load("warp_smoke.picture", "warp_smoke.usd.own_look", "warp_smoke.usd.read_volume")
from warp_smoke.usd.own_look import open_in_own_look
from warp_smoke.launch import Launcher, load_kernels
from warp_smoke.picture import PictureRenderer, render_kernels
lap()
_, scene = open_in_own_look(sys.argv[1])
lap()
launcher = Launcher("cpu")
renderer = PictureRenderer(launcher, scene, {SIZE[0]}, {SIZE[1]}, samples=int(sys.argv[2]))
load_kernels(render_kernels(scene, ()), "cpu")
lap()
renderer.render(scene.start)
lap()
print(json.dumps([b - a for a, b in zip(laps, laps[1:])]))
"""
NAMES = ("loading Python's modules, Warp and USD", "reading the stage", "textures and kernels", "rendering")


def time_command(samples: int, folder: str) -> float:
    """Measures the time of the complete command [s]."""
    file = Path(folder) / "picture.png"
    options = ["--size", "x".join(map(str, SIZE)), "--samples", str(samples), "-o", file]
    start = perf_counter()
    command = [sys.executable, "-m", "warp_smoke_command", "render", STAGE, *options]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - start


def time_steps(samples: int) -> list[float]:
    """Measures the time of each step in `NAMES` [s]."""
    command = [sys.executable, "-c", STEPS, STAGE, str(samples)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def page(repeats: int) -> str:
    """Measures, and returns the results as Markdown."""
    rows = {name: [] for name in ("the whole command", *NAMES)}
    with tempfile.TemporaryDirectory() as folder:
        time_command(1, folder)
        for samples in SAMPLES:
            whole, steps = [], []
            for _ in range(repeats):
                whole.append(time_command(samples, folder))
                steps.append(time_steps(samples))
            for name, seconds in zip(rows, (whole, *zip(*steps, strict=True)), strict=True):
                rows[name].append(f"{median(seconds):.2f}")
    head = " | ".join(("seconds", *(f"{n * n} ray{'s' * (n > 1)} a pixel" for n in SAMPLES)))
    table = [f"| {head} |", "|---" * (1 + len(SAMPLES)) + "|"]
    table += [f"| {' | '.join((name, *cells))} |" for name, cells in rows.items()]
    size = "×".join(map(str, SIZE))
    return "\n".join(
        [
            "# What a picture costs",
            "",
            f"Written by `python scripts/benchmark_pictures.py` on {os.cpu_count()} cores ({processor()}): medians of",
            f"{repeats} processes for a picture of `stages/{STAGE.name}`, {size} pixels. The rest of the whole",
            "command is Python's own start and end, and the PNG.",
            "",
            *table,
            "",
        ]
    )


if __name__ == "__main__":
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else REPEATS
    (ROOT / "docs" / "pictures.md").write_text(page(repeats), encoding="utf-8")
