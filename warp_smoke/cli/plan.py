"""`warp-smoke plan`: which passes a stage calls for, and why."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import warp_smoke
from warp_smoke.cli.console import out, warn
from warp_smoke.cli.options import Json, SceneOptions

if TYPE_CHECKING:
    from rich.table import Table


def plan(
    stage: Path, *, scene_options: SceneOptions = SceneOptions(), quality: str | None = None, as_json: Json = False
):
    """Show which passes STAGE calls for, in order, and why the others do not run; nothing is simulated.

    Args:
        stage: The USD stage.
        scene_options: What is changed of it.
        quality: draft, preview or final: measured settings for all that the stage leaves open.
        as_json: Print the plan as JSON.
    """
    from warp_smoke.launch import Launcher

    scene = scene_options.open(stage)
    made = warp_smoke.make_plan(scene, quality=quality)
    if as_json:
        print(json.dumps(_as_plain(made), indent=2))
        return
    warn([*scene.warnings, *made.warnings])
    if made.chosen:
        out.print(str(made.chosen), soft_wrap=True, markup=False, highlight=False)
    out.print(_passes(made) if made.passes else "Nothing runs.")
    if made.left_out:
        out.print(_left_out(made))
    out.print(made.memory, highlight=False)
    made.check_memory(Launcher().available_bytes())


def _as_plain(made: "warp_smoke.Plan") -> dict:
    passes, left_out = ([asdict(each) for each in kind] for kind in (made.passes, made.left_out))
    chosen = asdict(made.chosen) if made.chosen else None
    return {"passes": passes, "left_out": left_out, "bytes": made.bytes, "chosen": chosen}


def _passes(made: "warp_smoke.Plan") -> "Table":
    from rich.table import Table

    table = Table("Pass", "For", "When", "Why", title="Runs, in this order")
    for each in made.passes:
        method = f"\n[dim]{each.method}[/dim]" if each.method else ""
        table.add_row(each.name + method, "\n".join(each.subjects), each.when, each.why)
    return table


def _left_out(made: "warp_smoke.Plan") -> "Table":
    from rich.table import Table

    table = Table("Pass", "For", "Why not", title="Left out", style="dim")
    for each in made.left_out:
        table.add_row(each.name, "\n".join(each.subjects), each.why)
    return table
