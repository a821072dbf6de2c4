"""Measures the advection schemes: error on a cosine hill turned once, and time; writes docs/advection.md and .json.

    python scripts/benchmark_advection.py

The hill ½ (1 + cos πr/r₀), r₀ = ¼, stands at (½, ¾) in a unit square and is turned once about the square's middle, at
Courant number 1 on the sides. Errors are in L2, relative to the hill. Times are medians of one thread's processor time
for 64³ cells.
"""

import json
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np

from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.launch import Launcher
from warp_smoke.report import environment

DOCS = Path(__file__).parents[1] / "docs"
SIZES = (32, 64, 128)
THICKNESS = 4
OPEN = ("open",) * 6
CELLS, REPEATS = 64, 9


def turning(launcher: Launcher, shape: tuple[int, int, int]) -> tuple:
    """Solid-body rotation with one radian a second about the middle of i and j, on faces."""
    components = []
    for axis in range(3):
        points = np.indices(face_shape(shape, axis), dtype=float)
        points[axis] -= 0.5
        x, y = (points[a] - (shape[a] - 1) / 2 for a in (0, 1))
        components.append(launcher.array(((-y, x, 0.0 * x)[axis]).astype(np.float32), "velocity"))
    return tuple(components)


def hill(n: int) -> np.ndarray:
    """The hill at the centres of n × n × THICKNESS cells."""
    x = (np.arange(n) + 0.5) / n
    r = np.hypot(x[:, None] - 0.5, x[None, :] - 0.75) / 0.25
    values = np.where(r < 1, 0.5 + 0.5 * np.cos(np.pi * r), 0.0)
    return np.repeat(values[:, :, None], THICKNESS, axis=2).astype(np.float32)


def turn_hill(launcher: Launcher, scheme: str, n: int) -> dict[str, float]:
    """Error, share of the mass lost, and range after one turn."""
    start, steps = hill(n), round(np.pi * n)
    advection = ADVECTION_SCHEMES[scheme](launcher, start.shape, OPEN)
    advection.trace(turning(launcher, start.shape), 2 * np.pi / steps)
    density = launcher.array(start, "density")
    for _ in range(steps):
        density = advection.advect_scalar(density, 0.0)
    end = density.numpy()
    return {
        "n": n,
        "steps": steps,
        "l2": float(np.linalg.norm(end - start) / np.linalg.norm(start)),
        "mass": float(end.sum(dtype=float) / start.sum(dtype=float)),
        "least": float(end.min()),
        "most": float(end.max()),
    }


def time_scheme(launcher: Launcher, scheme: str) -> dict[str, float]:
    """Processor time to trace, and to carry a scalar and the velocity [ns per cell]."""
    shape = (CELLS,) * 3
    advection, velocity = ADVECTION_SCHEMES[scheme](launcher, shape, OPEN), turning(launcher, shape)
    density = launcher.array(np.random.default_rng(1).random(shape).astype(np.float32), "density")
    samples = {"trace": [], "scalar": [], "velocity": []}
    for _ in range(REPEATS):
        began = process_time()
        advection.trace(velocity, 2 / CELLS)
        traced = process_time()
        density = advection.advect_scalar(density, 0.0)
        carried = process_time()
        velocity = advection.advect_velocity(velocity)
        for name, seconds in zip(samples, (traced - began, carried - traced, process_time() - carried), strict=True):
            samples[name].append(1e9 * seconds / CELLS**3)
    return {name: median(values) for name, values in samples.items()}


def table(rows: list[dict]) -> str:
    """The measurements as Markdown."""
    sizes = " | ".join(f"error {n}²" for n in SIZES)
    lines = [
        "# Advection schemes",
        "",
        "Written by `python scripts/benchmark_advection.py`; the figures are in [advection.json](advection.json).",
        "",
        "A cosine hill, its radius a quarter of the square's side, turned once at Courant number 1: its relative error",
        "in L2, the slope fitted to it, and the mass and height that are left of it at the finest grid. Time in ns per",
        f"cell, one thread, {CELLS}³: to trace (all fields share the traces), to carry a scalar, and u, v and w.",
        "",
        f"| scheme | {sizes} | order | mass | height | trace | scalar | u, v, w |",
        "|---|" + "---|" * (len(SIZES) + 6),
    ]
    for row in rows:
        hills, times = row["hills"], row["ns_per_cell"]
        errors = " | ".join(f"{each['l2']:.4f}" for each in hills)
        left = f"{hills[-1]['mass']:.4f} | {hills[-1]['most']:.3f}"
        cost = " | ".join(f"{times[name]:.1f}" for name in ("trace", "scalar", "velocity"))
        lines.append(f"| `{row['scheme']}` | {errors} | {row['order']:.2f} | {left} | {cost} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measures every scheme."""
    launcher, rows = Launcher("cpu", 1), []
    for scheme in ADVECTION_SCHEMES:
        hills = [turn_hill(launcher, scheme, n) for n in SIZES]
        order = -float(np.polyfit(np.log(SIZES), np.log([each["l2"] for each in hills]), 1)[0])
        rows.append({"scheme": scheme, "hills": hills, "order": order, "ns_per_cell": time_scheme(launcher, scheme)})
    (DOCS / "advection.md").write_text(table(rows), encoding="utf-8")
    facts = {"environment": environment(), "rows": rows}
    (DOCS / "advection.json").write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    print(table(rows))


if __name__ == "__main__":
    main()
