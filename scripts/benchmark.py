"""Times the fluid: ns per cell and step of each pass, by resolution, threads and collider; prints tables, writes JSON.

    python scripts/benchmark.py [--quick] [docs/benchmark.json]

The smoke is a plume in a closed box, some frames old, with vorticity confinement; with a collider, a sphere stands
in its way. Each figure is the median over steps, next to the bandwidth that copying memory reaches in the same run.
"""

import json
import sys
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
from rich.console import Console
from rich.table import Column, Table

import warp_smoke as ws
from warp_smoke.launch import Launcher
from warp_smoke.report import environment
from warp_smoke.study.disclosure import copy_bandwidth, processor

STEPS, WARM_UP = 15, 8


def benchmark_scene(resolution: int, collider: bool) -> ws.Scene:
    """A plume in a closed box of side 2."""
    up = np.eye(4)
    up[3, 1] = 1.0
    low, middle = up.copy(), up.copy()
    low[3, 1], middle[3, 1] = 0.4, 1.1
    domain = ws.SmokeDomain(
        path="/Smoke",
        transform=up,
        resolution=resolution,
        boundary=("closed",) * 6,
        buoyancy_temperature=4.0,
        vorticity=0.5,
    )
    ball = ws.Collider(path="/Ball", mesh=ws.Mesh.sphere(0.3), transform=middle)
    emitter = ws.Emitter(path="/Source", mesh=ws.Mesh.sphere(0.25), transform=low)
    return ws.Scene(domains=[domain], emitters=[emitter], colliders=[ball] if collider else [], end=10**6)


def time_passes(resolution: int, threads: int, collider: bool) -> dict[str, float]:
    """Median ns per cell and step of each pass, and of the whole step."""
    simulation = ws.Simulation(benchmark_scene(resolution, collider), threads=threads)
    solver, seconds = simulation.solver(), simulation.timings.seconds
    for _ in range(WARM_UP):
        simulation.step()
    frame, samples = float(simulation.frame), []
    for _ in range(STEPS):
        before, began = dict(seconds), perf_counter()
        solver.step(frame, frame + 1, 1 / 24)
        whole = perf_counter() - began
        frame += 1
        samples.append({name: seconds[name] - before.get(name, 0.0) for name in seconds} | {"whole step": whole})
    cells = resolution**3
    return {name: 1e9 * median(s.get(name, 0.0) for s in samples) / cells for name in samples[0]}


def page(facts: dict) -> str:
    """The figures as Markdown."""
    rows = facts["rows"]
    heads = []
    for row in rows:
        threads = f"{row['threads']} thread{'s' * (row['threads'] > 1)}"
        heads.append(f"{row['resolution']}³{', sphere' if row['collider'] else ''}, {threads}")
    names = list(dict.fromkeys(name for row in rows for name in row["ns_per_cell"]))
    names.sort(key=lambda name: -max(row["ns_per_cell"].get(name, 0.0) for row in rows))
    lines = [
        "# What the fluid costs",
        "",
        "Nanoseconds per cell and step, medians, by `python scripts/benchmark.py docs/benchmark.json` on "
        f"{facts['environment']['threads']} shared CPU cores ({facts['processor']}).",
        f"Copying memory on one thread reads and writes {facts['copy_gb_per_s']:.1f} GB/s there: "
        f"{8 / facts['copy_gb_per_s']:.2f} ns for each float.",
        "",
        "| pass | " + " | ".join(heads) + " |",
        "|---|" + "---:|" * len(rows),
    ]
    for name in names:
        figures = [row["ns_per_cell"].get(name, 0.0) for row in rows]
        if max(figures) >= 0.05:
            lines.append(f"| {name} | " + " | ".join(f"{figure:.1f}" if figure else "" for figure in figures) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Runs every case."""
    arguments = sys.argv[1:]
    quick = "--quick" in arguments
    console = Console(width=max(100, Console().width))
    rows = []
    for collider in (False, True):
        table = Table(
            Column("ns per cell and step", no_wrap=True), title="with a sphere" if collider else "without a collider"
        )
        columns = []
        for resolution in (64,) if quick else (64, 128):
            for threads in (1, 2):
                with console.status(f"{resolution}³, {threads} thread(s)"):
                    figures = time_passes(resolution, threads, collider)
                case = {"resolution": resolution, "threads": threads, "collider": collider}
                rows.append(case | {"ns_per_cell": figures})
                table.add_column(f"{resolution}³, {threads} thread{'s' * (threads > 1)}", justify="right")
                columns.append(figures)
        names = sorted((name for name in columns[0] if name != "whole step"), key=lambda name: -columns[0][name])
        for name in [name for name in names if columns[0][name] >= 0.05] + ["whole step"]:
            table.add_row(name, *(f"{figures.get(name, 0.0):.1f}" for figures in columns))
        console.print(table)
    bandwidth = copy_bandwidth(Launcher())
    console.print(f"copying memory: {bandwidth:.1f} GB/s, {8e0 / bandwidth:.2f} ns for each float read and written")
    files = [argument for argument in arguments if not argument.startswith("-")]
    if files:
        facts = {
            "environment": environment(),
            "processor": processor(),
            "copy_gb_per_s": bandwidth,
            "rows": rows,
        }
        path = Path(files[0])
        path.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
        path.with_suffix(".md").write_text(page(facts), encoding="utf-8")


if __name__ == "__main__":
    main()
