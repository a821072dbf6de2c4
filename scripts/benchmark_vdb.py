"""Times the `.vdb` writer against OpenVDB's own, pair by pair, and writes docs/vdb.md.

    python scripts/benchmark_vdb.py [PAIRS]

Both start from the same dense array in memory and end with a closed file of 16-bit floats: ours deflated where that
pays, OpenVDB's with its default, blosc. OpenVDB is Debian's python3-openvdb (`/usr/bin/python3`); building its tree
from the array is timed separately. The fields: the last frame of stages/plume.usda at 128 cells a side, its velocity,
and dense smoke with noise added. OpenVDB must read each field back from our file bit by bit, in half precision.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from statistics import median
from time import perf_counter, process_time

import numpy as np

import warp_smoke as ws
from warp_smoke.study.disclosure import processor
from warp_smoke.vdb import Grid, write_vdb

ROOT = Path(__file__).parents[1]
SIZE, FRAMES, PAIRS = 128, 48, 15
THREADS = (1, 2)

# For each input line "array file" it prints the times of building and writing [s], its CPU time [s] and the file's
# size; for "check array file", whether the file holds the array's active values.
OPENVDB = """
import os, sys, time
import numpy as np
import pyopenvdb as vdb

print(".".join(map(str, vdb.LIBRARY_VERSION)), flush=True)
for line in sys.stdin:
    *check, source, path = line.split()
    values = np.load(source)
    if check:
        grid = vdb.readAllGridMetadata(path) and vdb.read(path, "field")
        found = np.zeros_like(values)
        grid.copyToArray(found)
        print(int(np.array_equal(found, values.astype(np.float16).astype(np.float32))), flush=True)
        continue
    began, spent = time.perf_counter(), time.process_time()
    grid = vdb.Vec3SGrid() if values.ndim == 4 else vdb.FloatGrid()
    grid.copyFromArray(values)
    grid.name, grid.saveFloatAsHalf = "field", True
    built = time.perf_counter()
    vdb.write(path, grids=[grid])
    written = time.perf_counter()
    print(built - began, written - built, time.process_time() - spent, os.path.getsize(path), flush=True)
"""


def fields() -> dict[str, np.ndarray]:
    """Makes arrays [128, 128, 128] and [128, 128, 128, 3], float32, by name."""
    scene = ws.Scene.open(ROOT / "stages/plume.usda")
    domains = [replace(domain, resolution=SIZE) for domain in scene.domains]
    simulation = ws.Simulation(replace(scene, domains=domains, surfaces=[], lights=[]))
    for _ in range(FRAMES):
        frame = simulation.step()
    (smoke,) = frame.smoke.values()
    plume = np.where(smoke.density > 1e-4, smoke.density, 0)
    x, _, z = (np.indices((SIZE, SIZE, SIZE)) + 0.5) / SIZE
    noise = np.random.default_rng(0).normal(scale=0.1, size=x.shape)
    noisy = np.clip(1.2 - 4 * np.hypot(x - 0.5, z - 0.5) + noise, 0, 1).astype(np.float32)
    velocity = np.where(plume[..., None] > 0, smoke.velocity, 0)
    return {"plume": plume, "noisy smoke": noisy, "velocity of the plume": velocity}


class OpenVdb:
    """Debian's OpenVDB in a separate process.

    Attributes:
        version: version of the library.
    """

    def __init__(self):
        command = ["/usr/bin/python3", "-c", OPENVDB]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.version = self._process.stdout.readline().strip()

    def ask(self, *words: object) -> list[float]:
        """Sends a line and returns the numbers in the answer."""
        print(*words, file=self._process.stdin, flush=True)
        return [float(word) for word in self._process.stdout.readline().split()]


def compare(openvdb: OpenVdb, values: np.ndarray, folder: Path, pairs: int) -> dict[str, str]:
    """Returns a row of the table: medians of times [ms] and of the ratios of pairs, and sizes [KiB]."""
    source, ours, theirs = folder / "field.npy", folder / "ours.vdb", folder / "theirs.vdb"
    np.save(source, values)
    times = {threads: np.zeros((pairs, 2)) for threads in THREADS}
    others = np.zeros((pairs, 3))
    for pair in range(pairs):
        *others[pair], size = openvdb.ask(source, theirs)
        for threads in THREADS:
            began = np.array([perf_counter(), process_time()])
            write_vdb(ours, [Grid("field", values, voxel_size=1 / SIZE)], threads=threads)
            times[threads][pair] = np.array([perf_counter(), process_time()]) - began
    (same,) = openvdb.ask("check", source, ours)
    if not same:
        raise SystemExit("OpenVDB reads other values than were written")
    built, written, spent = others.T
    mine = ours.stat().st_size
    row = {"active": f"{np.count_nonzero(values) / values.size:.0%}"}
    row["OpenVDB, ms"] = f"{1e3 * median(built + written):.1f}, of it {1e3 * median(written):.1f} writing"
    for threads in THREADS:
        row[f"ours, {threads} thread{'s' * (threads > 1)}"] = f"{1e3 * median(times[threads][:, 0]):.1f}"
        row[f"ratio, {threads} thread{'s' * (threads > 1)}"] = f"{median(times[threads][:, 0] / (built + written)):.2f}"
    row["ratio of CPU time"] = f"{median(times[1][:, 1] / spent):.2f}"
    return row | {
        "ours, KiB": f"{mine / 1024:.0f}",
        "OpenVDB, KiB": f"{size / 1024:.0f}",
        "ratio of sizes": f"{mine / size:.2f}",
    }


def main(pairs: int) -> None:
    """Measures, prints and writes the page."""
    openvdb = OpenVdb()
    with tempfile.TemporaryDirectory() as folder:
        rows = {name: compare(openvdb, values, Path(folder), pairs) for name, values in fields().items()}
    header = ("field", *next(iter(rows.values())))
    cells = [header, ("---", *["---:"] * (len(header) - 1)), *((name, *row.values()) for name, row in rows.items())]
    table = ["| " + " | ".join(row) + " |" for row in cells]
    print("\n".join(table))
    lines = [
        "# What the `.vdb` writer takes",
        "",
        f"Written by `python scripts/benchmark_vdb.py` on {os.cpu_count()} cores ({processor()}): fields of {SIZE}³",
        "cells, from an array in memory to a closed file of 16-bit floats. OpenVDB",
        f"{openvdb.version}, which first builds its tree, and we take turns; medians of {pairs} pairs, times in",
        "milliseconds, ratios ours to OpenVDB's. The ratio of CPU time, ours on one thread, is less disturbed by other",
        "work on the machine. OpenVDB read each field back from our file bit by bit.",
        "",
        *table,
    ]
    (ROOT / "docs/vdb.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else PAIRS)
