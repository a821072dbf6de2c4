"""Times the fluid: ns per cell and step of each pass, by resolution, threads and collider; prints tables, writes JSON.

    python scripts/benchmark.py [--quick] [docs/benchmark.json]

The smoke is a plume in a closed box after some frames, with vorticity confinement; the collider is a sphere in its
path. Each figure is the median over steps, next to the bandwidth of copying memory in the same run: the least that a
pass must read and write, at that bandwidth, gives the least time that it can take. The cost of launching its kernels is
measured too, and that of the samples it takes between cells, from fields in the cache.
"""

import json
import sys
from collections import Counter
from contextlib import contextmanager
from math import prod
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
from rich.console import Console
from rich.table import Column, Table

import warp_smoke as ws
from warp_smoke.fluid.advection import SemiLagrangian
from warp_smoke.fluid.dissipation import decay
from warp_smoke.fluid.grid import face_shape
from warp_smoke.launch import Launcher
from warp_smoke.report import environment
from warp_smoke.study.disclosure import copy_bandwidth, processor

STEPS, WARM_UP = 15, 8

# Fields of the lattice that a pass must read and write, each once.
LEAST_FIELDS = {
    "project_pressure": 8,  # velocity and the pressure, read and written
    "advect_velocity": 12,  # velocity read and written; displacements back and ahead written
    "advect_temperature": 8,  # displacements read; the scalar read and written
    "advect_density": 8,
    "confine_vorticity": 6,  # velocity read and written
    "measure_motion": 6,  # velocity read, after the projection and after advection
    "fit_active_box": 2,  # density and temperature read
    "add_buoyancy": 3,  # temperature read, one component of the velocity read and written
}
# Trilinear samples of eight neighbours that kernels take in each of their cells.
SAMPLES = {"trace_both_ways_by_midpoint": 3, "_guess": 1, "corrected_clamped": 1, "corrected_reverted": 1}
# With a collider also the fluid cells, and the open shares of the faces.
LEAST_FIELDS_OF_SOLIDS = {"project_pressure": 4, "advect_velocity": 4}


def benchmark_scene(resolution: int, collider: bool) -> ws.Scene:
    """Makes a scene with a plume in a closed box of side 2."""
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


def time_passes(resolution: int, threads: int, collider: bool) -> dict[str, dict[str, float]]:
    """Measures median ns per cell and step for passes and steps, launches per step, and samples per cell and step."""
    simulation = ws.Simulation(benchmark_scene(resolution, collider), threads=threads)
    solver, seconds = simulation.solver(), simulation.timings.seconds
    for _ in range(WARM_UP):
        simulation.step()
    launches, sampled = count_work(simulation)
    frame, samples = float(simulation.frame), []
    for _ in range(STEPS):
        before, began = dict(seconds), perf_counter()
        solver.step(frame, frame + 1, 1 / 24)
        whole = perf_counter() - began
        frame += 1
        samples.append({name: seconds[name] - before.get(name, 0.0) for name in seconds} | {"whole step": whole})
    cells = resolution**3
    figures = {name: 1e9 * median(s.get(name, 0.0) for s in samples) / cells for name in samples[0]}
    return {
        "ns_per_cell": figures,
        "launches": {name: count / STEPS for name, count in launches.items()},
        "samples": {name: count / STEPS / cells for name, count in sampled.items()},
    }


def count_work(simulation: ws.Simulation) -> tuple[Counter, Counter]:
    """Starts counting, by pass, the kernels that are launched and the samples that they take."""
    launches, samples, passes = Counter(), Counter(), []
    measure, launch, launched = simulation.timings.measure, simulation.launcher.launch, simulation.launcher.launches

    @contextmanager
    def measure_and_count(name: str):
        before = launched.total()
        passes.append(name)
        with measure(name):
            yield
        passes.pop()
        launches[name] += launched.total() - before

    def launch_and_count(kernel, shape: tuple[int, int, int], *args):
        if kernel.key in SAMPLES:
            samples[passes[-1]] += SAMPLES[kernel.key] * prod(shape)
        launch(kernel, shape, *args)

    simulation.timings.measure, simulation.launcher.launch = measure_and_count, launch_and_count
    return launches, samples


def sample_cost() -> float:
    """Measures the time to find the end of a trace and sample a field there, on one thread, all in the cache [ns]."""
    launcher, shape, count = Launcher("cpu", 1), (16, 16, 128), 200
    advection, random = SemiLagrangian(launcher, shape, ("closed",) * 6), np.random.default_rng(1)
    velocity = [
        launcher.array(random.uniform(-1, 1, face_shape(shape, axis)).astype(np.float32), "benchmark")
        for axis in range(3)
    ]
    field = launcher.array(random.uniform(0, 1, shape).astype(np.float32), "benchmark")
    advection.trace(velocity, 1.0)
    seconds = []
    for _ in range(count):
        began = perf_counter()
        field = advection.advect_scalar(field, 0.0)
        seconds.append(perf_counter() - began)
    return 1e9 * median(seconds) / prod(shape)


def launch_cost() -> float:
    """Measures the time to launch a kernel over 8 cells on one thread, with alternating arguments [µs]."""
    launcher, count = Launcher("cpu", 1), 1000
    fields = [launcher.zeros((2, 2, 2), "benchmark") for _ in range(2)]
    for field in fields:
        decay(launcher, field, 0.0, 1.0, 1.0)
    began = perf_counter()
    for n in range(count):
        decay(launcher, fields[n % 2], 0.0, 1.0, 1.0)
    return 1e6 * (perf_counter() - began) / count


def limits(row: dict, facts: dict) -> list[str]:
    """Returns how far each pass of a case is from its limits, as rows of a Markdown table."""
    lines = []
    for name, least in LEAST_FIELDS.items():
        fields = least + LEAST_FIELDS_OF_SOLIDS.get(name, 0) * row["collider"]
        spent = row["ns_per_cell"].get(name, 0.0)
        bound = 4 * fields / facts["copy_gb_per_s"]
        samples = row["samples"].get(name, 0.0)
        sampling = f"{samples:.1f} | {samples * facts['sample_ns']:.1f}" if samples else " | "
        launching = 1e3 * facts["launch_us"] * row["launches"].get(name, 0.0) / row["resolution"] ** 3
        figures = f"{spent:.1f} | {fields} | {bound:.1f} | {spent / bound:.1f} | {sampling}"
        lines.append(f"| {name} | {figures} | {row['launches'].get(name, 0):.0f} | {launching:.2f} |")
    return lines


def page(facts: dict) -> str:
    """Returns the figures as Markdown."""
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
        f"{8 / facts['copy_gb_per_s']:.2f} ns for each float. Launching a kernel over nothing takes "
        f"{facts['launch_us']:.1f} µs, and a trilinear sample of a field in the cache, at the end of a trace, "
        f"{facts['sample_ns']:.1f} ns.",
        "",
        "| pass | " + " | ".join(heads) + " |",
        "|---|" + "---:|" * len(rows),
    ]
    for name in names:
        figures = [row["ns_per_cell"].get(name, 0.0) for row in rows]
        if max(figures) >= 0.05:
            lines.append(f"| {name} | " + " | ".join(f"{figure:.1f}" if figure else "" for figure in figures) + " |")
    for head, row in zip(heads, rows, strict=True):
        if row["threads"] == 1 and row["resolution"] == max(each["resolution"] for each in rows):
            lines += [
                "",
                f"## Distance from the limits: {head}",
                "",
                "Each field of floats that a pass must read or write, moved once at the bandwidth of the copy; the "
                "trilinear samples that it takes for each cell of the domain, as fast as from the cache; and the time "
                "that its launches take if they do nothing.",
                "",
                "| pass | ns taken | fields moved at least | ns for that | ratio | samples | ns for sampling "
                "| launches | ns for launching |",
                "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
                *limits(row, facts),
            ]
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
                    measured = time_passes(resolution, threads, collider)
                figures = measured["ns_per_cell"]
                rows.append({"resolution": resolution, "threads": threads, "collider": collider} | measured)
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
            "launch_us": launch_cost(),
            "sample_ns": sample_cost(),
            "rows": rows,
        }
        path = Path(files[0])
        path.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
        path.with_suffix(".md").write_text(page(facts), encoding="utf-8")


if __name__ == "__main__":
    main()
