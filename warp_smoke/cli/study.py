"""`warp-smoke study`: what accuracy costs in time."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import warp_smoke
from warp_smoke.cli.console import out, progress_bar, say_rows, say_written, warn
from warp_smoke.cli.options import DeviceOptions, Json, Output


def study(
    stage: Path | None = None,
    *,
    suite: Annotated[list[str] | None, Parameter(consume_multiple=True)] = None,
    full: bool = False,
    output: Output = None,
    device: DeviceOptions = DeviceOptions(),
    as_json: Json = False,
):
    """Measure what accuracy costs in time, on known answers or on STAGE; writes tables, diagrams and a web page.

    An interrupted study continues where it stopped.

    Args:
        stage: A USD stage, studied at several settings and compared with the finest.
        suite: advection, pressure, flow, smoke_shadow, surface_shadow, shading, scene (with a stage) or all; several
            may be given. Unless given, scene for a stage, else all.
        full: Measure at more and finer resolutions; without it each suite takes less than two minutes on two cores.
        output: Folder for the results; out/study, or out/NAME.study for a stage, unless given.
        device: Where it runs.
        as_json: Print disclosure, orders and rows as JSON.
    """
    if stage is not None:
        from warp_smoke.usd.probe import check_readable

        check_readable(stage)
    with progress_bar() as bar:
        result = warp_smoke.study(stage, output, suites=suite, full=full, **asdict(device), on_row=say_rows(bar))
    if as_json:
        print(json.dumps(result.as_json(), indent=2))
        return
    warn([f"{name}: {line}" for name, lines in result.unexpected.items() for line in lines])
    warn([f"failed: {row.key}: {row.failure}" for row in result.rows if row.failure is not None])
    if result.recommendation:
        out.print(result.recommendation, highlight=False)
    say_written([result.page])
