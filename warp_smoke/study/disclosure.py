"""What a measurement discloses about its machine and versions, so that it can be judged and repeated."""

import os
import platform
import shutil
import subprocess
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from time import perf_counter

import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.report import environment

PACKAGE = Path(__file__).parents[1]
# Results that differ in one of these must not share a table.
IDENTITY = ("warp-smoke", "package digest", "warp-lang", "usd-core", "numpy", "device", "processor", "threads")
_COPIED_BYTES = 2**26
_COPIES = 10
# Load average above which other processes were running, so that times are longer than on an idle machine.
BUSY = 0.5


def disclose(launcher: Launcher) -> dict:
    """Returns device, threads, versions, commit and date, and the load and copy bandwidth, which are measured now."""
    facts = environment()
    del facts["devices"], facts["pyvista"]
    return facts | {
        "device": str(launcher.device),
        "processor": launcher.device.name if launcher.device.is_cuda else processor(),
        "threads": launcher.threads,
        "commit": commit(),
        "package digest": source_digest(),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "load before": load_average(),
        "copy_gb_per_s": round(copy_bandwidth(launcher), 2),
    }


def load_average() -> float | None:
    """Returns the mean number of processes that ran or waited in the last minute; None where that is not known."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def copy_bandwidth(launcher: Launcher) -> float:
    """Returns the gigabytes read and written per second by a copy of 64 MiB (one thread on the CPU), best of ten."""
    source = wp.full(_COPIED_BYTES // 4, 1.0, dtype=float, device=launcher.device)
    target = wp.zeros_like(source)
    times = []
    for _ in range(_COPIES):
        launcher.synchronize()
        began = perf_counter()
        wp.copy(target, source)
        launcher.synchronize()
        times.append(perf_counter() - began)
    return 2 * _COPIED_BYTES / min(times) / 1e9


def processor() -> str:
    """Returns the processor's name, or the machine's type where the system does not tell it."""
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text().splitlines() if facts.exists() else []
    return next((line.partition(": ")[2] for line in lines if line.startswith("model name")), platform.machine())


def commit() -> str | None:
    """Returns the last commit that changed the package, with a + for changes since; None outside a repository."""
    if shutil.which("git") is None:
        return None

    def git(*args: str) -> str:
        return subprocess.run(["git", *args, "--", "."], cwd=PACKAGE, capture_output=True, text=True).stdout.strip()

    found = git("log", "-1", "--format=%h")
    return found + ("+" if git("status", "--porcelain") else "") if found else None


def source_digest() -> str:
    """Returns twelve hexadecimal digits that change with any of the package's sources."""
    digest = sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:12]
