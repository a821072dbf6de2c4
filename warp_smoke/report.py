"""What a run did: its report as plain data, and the table that the command line prints."""

import platform
from importlib.metadata import version

import numpy as np
from rich.table import Table


def environment() -> dict:
    """Versions, devices, threads and the kernel cache's folder."""
    import warp as wp

    from warp_smoke.launch import Launcher

    threads = Launcher("cpu").threads  # starts Warp
    return {
        "warp-smoke": version("warp-smoke"),
        "warp-lang": version("warp-lang"),
        "usd-core": version("usd-core"),
        "numpy": version("numpy"),
        "pyvista": version("pyvista"),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "devices": [device.alias for device in wp.get_devices()],
        "threads": threads,
        "kernel cache": str(wp.config.kernel_cache_dir),
    }


def summary_table(report: dict) -> Table:
    """Where a run's time went: seconds, and milliseconds per frame of each pass that takes any."""
    frames = max(1, len(report["frames"]))
    seconds = report["seconds"]
    each = f"{1e3 * seconds['frames'] / frames:.0f} ms per frame"
    title = f"{frames} frame{'s' * (frames > 1)}: {seconds['set_up']:.1f} s to set up, {seconds['frames']:.1f} s, {each}"
    table = Table("Pass", "Seconds", "ms / frame", title=title)
    for name, spent in sorted(seconds["passes"].items(), key=lambda item: -item[1]):
        if name != "load_kernels" and 1e3 * spent / frames >= 0.05:
            table.add_row(name, f"{spent:.2f}", f"{1e3 * spent / frames:.1f}")
    steps = [step["substeps"] for frame in report["frames"] for step in frame["domains"].values()]
    if steps:
        table.caption = f"substeps per frame: {np.min(steps)} to {np.max(steps)}"
    return table
