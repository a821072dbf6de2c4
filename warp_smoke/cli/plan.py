"""`warp-smoke plan`: which passes a stage needs, and why."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape

import warp_smoke
from warp_smoke.cli.console import out, warn
from warp_smoke.cli.options import Json, SceneOptions

if TYPE_CHECKING:
    from rich.table import Table


def plan(
    stage: Path, *, scene_options: SceneOptions = SceneOptions(), quality: str | None = None, as_json: Json = False
):
    """Show which passes STAGE needs, in order, and why the others do not run; nothing is simulated.

    Args:
        stage: The USD stage.
        scene_options: Changes to the stage's scene.
        quality: draft, preview or final: measured settings for everything that the stage leaves open.
        as_json: Print the plan as JSON.
    """
    from warp_smoke.launch import Launcher

    scene = scene_options.open(stage)
    made = warp_smoke.make_plan(scene, quality=quality)
    if as_json:
        print(json.dumps(_as_plain(made), indent=2))
        return
    if made.chosen:
        out.print(str(made.chosen), soft_wrap=True, highlight=False)
    out.print(_passes(made) if made.passes else "Nothing runs.", markup=True)
    if made.left_out:
        out.print(_left_out(made))
    out.print(made.memory, highlight=False)
    warn([*scene.warnings, *made.warnings])
    made.check_memory(Launcher().available_bytes())


def _as_plain(made: "warp_smoke.Plan") -> dict:
    passes, left_out = ([asdict(each) for each in kind] for kind in (made.passes, made.left_out))
    chosen = asdict(made.chosen) if made.chosen else None
    return {"passes": passes, "left_out": left_out, "bytes": made.bytes, "chosen": chosen}


def _passes(made: "warp_smoke.Plan") -> "Table":
    table = _table("Pass", "For what, and why", title="Runs, in this order")
    found: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    for each in made.passes:
        found.setdefault((each.name, each.method, each.when, each.why), []).append(each.subjects)
    for (name, method, when, why), subjects in found.items():
        how = ", ".join(filter(None, (method, when)))
        table.add_row(f"{name}\n[dim]{how}[/dim]", f"{escape(_list(subjects))}\n[dim]{escape(why)}[/dim]")
    return table


def _left_out(made: "warp_smoke.Plan") -> "Table":
    table = _table("Pass", "For", "Why not", title="Left out", style="dim")
    found: dict[tuple[str, str], list[tuple[str, ...]]] = {}
    for each in made.left_out:
        found.setdefault((each.name, each.why), []).append(each.subjects)
    for (name, why), subjects in found.items():
        table.add_row(name, _list(subjects), why)
    return table


def _table(*columns: str, **options: str) -> "Table":
    """Returns a table that wraps long cells and truncates nothing."""
    from rich.table import Column, Table

    return Table(*(Column(name, overflow="fold") for name in columns), **options)


def _list(places: Iterable[tuple[str, ...]]) -> str:
    """Returns the subjects in a row as lines: one for each first path, with all the paths paired with it."""
    found: dict[str, list[str]] = {}
    for first, *others in filter(None, places):
        found.setdefault(first, []).extend([" × ".join(others)] * bool(others))
    return "\n".join(" × ".join(filter(None, (first, ", ".join(others)))) for first, others in found.items())
