"""What a run did: its report as plain data, and the summary that the command line prints."""

import platform
from importlib.metadata import version

from rich.console import Group
from rich.table import Table

# Error of diffusion, as a share of the change it makes, above which a warning is given.
_WORTH_A_WARNING = 0.01


def environment() -> dict:
    """Returns versions, devices and the number of threads."""
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
    }


def step_warnings(frames: list[dict]) -> list[str]:
    """Returns warnings where solvers fell short: pressures that did not converge, diffusion with too few sweeps.

    Args:
        frames: the frames of a report.
    """
    warnings = []
    for path in dict.fromkeys(path for frame in frames for path in frame["domains"]):
        steps = [frame["domains"][path] for frame in frames if path in frame["domains"]]
        pressures = [status for step in steps for status in step["pressure"]]
        missed = [status["max_residual"] for status in pressures if not status["converged"]]
        if missed:
            share = f"{len(missed)} of {len(pressures)} substeps, with a residual of up to {max(missed):.2g}"
            warnings.append(f"{path}: pressure missed its tolerance in {share}")
        bound = max(step["diffusion"] for step in steps)
        if bound > _WORTH_A_WARNING:
            advice = "a larger smoke:diffusionSweeps brings it closer"
            warnings.append(f"{path}: diffusion may be off by up to {bound:.0%} of the change it makes; {advice}")
    return warnings


def summary(report: dict) -> Group:
    """Summarizes where a run's time went: a line, and a table of the passes that took more than 3 % of it."""
    count, seconds = len(report["frames"]), report["seconds"]
    steps = [step["substeps"] for frame in report["frames"] for step in frame["domains"].values()]
    line = f"{count} frame{'s' * (count > 1)}: {seconds['set_up']:.1f} s to set up, {seconds['frames']:.1f} s to make"
    if steps:
        least, most = min(steps), max(steps)
        number = f"{least} to {most}" if least < most else f"{most}"
        line += f", {number} substep{'s' * (most > 1)} a frame"
    table = Table("Pass", "Seconds", "ms / frame")
    passes = {name: spent for name, spent in seconds["passes"].items() if name != "load_kernels"}
    large = [name for name in sorted(passes, key=passes.get, reverse=True) if passes[name] > 0.03 * seconds["frames"]]
    rows = {name: passes.pop(name) for name in large} | {"others": sum(passes.values()), "all": seconds["frames"]}
    for name, spent in rows.items():
        table.add_row(name, f"{spent:.2f}", f"{1e3 * spent / count:.1f}", end_section=name == "others")
    return Group(line, table)
