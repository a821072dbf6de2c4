"""Measures the cost of checkpoints and safety checks on stages/plume.usda: writes docs/long_runs.json, prints figures.

Usage: python scripts/long_runs.py
"""

import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from statistics import median
from time import perf_counter

import warp_smoke as ws

ROOT = Path(__file__).parents[1]
FRAMES, REPEATS = 16, 3
# Probes a stage as a command does: with USD loaded and nothing opened yet.
PROBE = """
import sys
from pathlib import Path
from time import perf_counter
from warp_smoke.usd.probe import check_readable

began = perf_counter()
check_readable(Path(sys.argv[1]))
print(perf_counter() - began)
"""


def scene_at(resolution: int) -> ws.Scene:
    """Returns the stage's first frames at a resolution."""
    scene = ws.Scene.open(ROOT / "stages/plume.usda")
    domains = [replace(each, resolution=resolution) for each in scene.domains]
    return replace(scene, domains=domains, end=scene.start + FRAMES - 1)


def seconds_a_frame(scene: ws.Scene, checkpoint_every: int | None) -> tuple[float, int, int]:
    """Measures the time per frame with all files, the number of checkpoints, and the size of the largest [bytes]."""
    seen, written = [], {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "plume.checkpoint")

        def look(frame: ws.Frame) -> None:
            if file.exists():
                written[file.stat().st_mtime_ns] = file.stat().st_size
            seen.append(perf_counter())

        ws.run(scene, folder, checkpoint_every=checkpoint_every, on_frame=look)
    return (seen[-1] - seen[0]) / (len(seen) - 1), len(written), max(written.values(), default=0)


def guard_share(scene: ws.Scene) -> float:
    """Measures the share of a frame's time that the final check of density and temperature takes."""
    simulation = ws.Simulation(scene)
    frames, checks = [], []
    for _ in range(FRAMES):
        began = perf_counter()
        simulation.step()
        frames.append(perf_counter() - began)
        began = perf_counter()
        simulation.solver()._guard.check_scalars()
        checks.append(perf_counter() - began)
    return median(checks) / median(frames)


def seconds_to_probe() -> float:
    """Measures the time to probe the stage, as a binary file, in another process before opening it."""
    from pxr import Sdf

    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder, "plume.usdc"))
        Sdf.Layer.FindOrOpen(str(ROOT / "stages/plume.usda")).Export(file)
        command = [sys.executable, "-c", PROBE, file]
        return median(float(subprocess.check_output(command, text=True)) for _ in range(5 * REPEATS))


def main() -> None:
    """Runs all cases in turn a few times, takes the fastest of each, and writes the figures."""
    found = []
    for resolution in (64, 128):
        scene = scene_at(resolution)
        seconds_a_frame(replace(scene, end=scene.start + 2), None)
        cases = {"none": 0, "as often as is cheap": None, "each frame": 1}
        times = {name: [] for name in cases}
        for _ in range(REPEATS):
            for name, every in cases.items():
                times[name].append(seconds_a_frame(scene, every))
        without = min(times["none"])[0]
        for name, each in times.items():
            spent, count, size = min(each)
            found.append(
                {
                    "resolution": resolution,
                    "checkpoints": name,
                    "written": count,
                    "mebibytes": round(size / 2**20, 1),
                    "ms_a_frame": round(1e3 * spent, 1),
                    "share": round(spent / without - 1.0, 3),
                }
            )
        found.append({"resolution": resolution, "guard_share": round(guard_share(scene), 4)})
    found.append({"probe_ms": round(1e3 * seconds_to_probe(), 1)})
    (ROOT / "docs/long_runs.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    print("| cells | checkpoints | written | size | ms a frame | cost |\n|---|---|---:|---:|---:|---:|")
    for each in found:
        if "checkpoints" in each:
            name = f"| {each['resolution']}³ | {each['checkpoints']} | {each['written']} | {each['mebibytes']} MiB "
            print(f"{name}| {each['ms_a_frame']} | {each['share']:+.1%} |")
        elif "probe_ms" in each:
            print(f"a binary stage is tried in {each['probe_ms']} ms")
        else:
            print(f"guard at {each['resolution']}³: {each['guard_share']:.2%} of a frame")


if __name__ == "__main__":
    main()
