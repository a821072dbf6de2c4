"""Measures what accuracy costs in time and writes docs/accuracy.md, with its diagrams and figures in docs/accuracy.

    python scripts/accuracy.py [--full]

It runs all suites on known answers, and the stages plume.usda and room.usda; nothing else should run on the machine. It
resumes where it was interrupted; results of an earlier version in out/accuracy must be removed first.
"""

import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console

import warp_smoke as ws
from warp_smoke.study.case import Row, Suite, panel_error
from warp_smoke.study.conduct import Study
from warp_smoke.study.front import pareto_front
from warp_smoke.study.scene import EFFECTS, SceneStudy
from warp_smoke.study.store import RESULTS
from warp_smoke.study.suites import SUITES, load_suite
from warp_smoke.study.summary import effect_costs, never_worth, order_lines, pass_times
from warp_smoke.study.words import by_problem, duration, percent

ROOT = Path(__file__).parents[1]
DOCS, OUT = ROOT / "docs", ROOT / "out/accuracy"
STAGES = ("plume", "room")


def table(head: Sequence[str], rows: Iterable[Sequence[str]], words: int = 1) -> list[str]:
    """Returns a Markdown table whose first `words` columns are aligned left and the others right."""
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * words}{'---:|' * (len(head) - words)}"]
    return [*lines, *(f"| {' | '.join(row)} |" for row in rows), ""]


def fronts(suite: Suite, rows: Sequence[Row]) -> list[str]:
    """Returns a table of the settings to use for each error: the Pareto front of each panel."""
    lines = []
    for problem, found in by_problem(rows).items():
        error, _ = panel_error(suite, problem)
        for row in reversed(pareto_front(found, error)):
            chosen = ", ".join(
                f"{name.replace('_', ' ')} {row.labels[name]}" for name in ("resolution", *row.parameters)
            )
            lines.append((problem, f"`{row.method}`", chosen, percent(row.errors[error]), duration(row.median)))
    return table(("problem", "take", "with", "error", "time"), lines, words=3)


def section(suite: Suite, rows: Sequence[Row], diagram: str) -> list[str]:
    """Returns a suite's section: its text, its diagram, its fitted orders, and the settings to use."""
    valid = [row for row in rows if row.failure is None]
    drawn = [row for row in valid if row.problem not in getattr(suite, "TABLES", ())]
    lines = [f"## {suite.TITLE}", "", suite.explain(valid), "", f"![Error against time](accuracy/{diagram}.png)", ""]
    orders = [f"- {line}" for line in order_lines(suite, valid)]
    lines += ["Fitted orders:", "", *orders, ""] if orders else []
    wrong = [f"- Not as expected: {line}" for line in suite.unexpected(valid)]
    wrong += [f"- Failed: {row.problem}, `{row.method}`: {row.failure}" for row in rows if row.failure is not None]
    lines += [*wrong, ""] if wrong else []
    beaten = ", ".join(f"`{method}`" for method in never_worth(suite, drawn))
    lines += [f"Beaten everywhere here in both error and time, so never worth it: {beaten}.", ""] if beaten else []
    summary = "<details><summary>What to take for which error</summary>"
    return [*lines, summary, "", *fronts(suite, drawn), "</details>", ""]


def stage_tables(result: Study) -> list[str]:
    """Returns tables of what each effect of a stage costs, and of where the time of a frame goes."""
    rows = [row for row in result.rows if row.problem == EFFECTS]
    names = list(dict.fromkeys(name for row in rows for name in row.errors))
    lines = []
    for cost in effect_costs(rows):
        changes = [percent(cost.changes[name]) if name in cost.changes else "" for name in names]
        lines.append((cost.effect, duration(cost.seconds), percent(cost.share), *changes))
    head = ("effect", "costs a frame", "share", *(f"changes {name}" for name in names))
    passes = ((f"`{name}`", duration(seconds)) for name, seconds in pass_times(rows[0]))
    return [
        f"What each effect costs, by switching it off; with everything a frame takes {duration(rows[0].median)}:",
        "",
        *table(head, lines),
        "Where the time of a frame goes:",
        "",
        *table(("pass", "time"), passes),
    ]


def page(known: Study, stages: dict[str, tuple[SceneStudy, Study]], full: bool) -> str:
    """Returns the page's text."""
    facts = known.disclosure
    suites = {name: load_suite(name) for name in SUITES}
    load = "" if facts["load before"] is None else f", after a minute with a load average of {facts['load before']}"
    lines = [
        "# What accuracy costs in time",
        "",
        f"Written by `python scripts/accuracy.py{' --full' if full else ''}` on {facts['processor']}, "
        f"{facts['threads']} threads, device {facts['device']}, on {facts['date']}, with warp-smoke "
        f"{facts['warp-smoke']} (commit {facts['commit']}), warp-lang {facts['warp-lang']}, numpy {facts['numpy']}; a "
        f"copy of memory read and wrote {facts['copy_gb_per_s']:.1f} GB/s{load}. All rows, with quartiles and rates, "
        f"are in [known_answers.json](accuracy/known_answers.json) and "
        f"{', '.join(f'[{name}.json](accuracy/{name}.json)' for name in stages)}. `warp-smoke study` measures the same "
        "on your machine, and `warp-smoke study STAGE` on your own stage.",
        "",
        "In each diagram time goes across and error goes up, both logarithmic, so the best place is the lower left "
        "corner. Each line is a method, each point a setting, the pale bar through it the middle half of its times. "
        "Nothing is both faster and more accurate than a filled point; hollow ones are beaten.",
        "",
    ]
    for name, suite in suites.items():
        lines += section(suite, [row for row in known.rows if row.suite == name], name)
    for name, (suite, result) in stages.items():
        lines += [*section(suite, result.rows, name), *stage_tables(result)]
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Measures what is not yet measured, and writes everything."""
    full, console = "--full" in sys.argv[1:], Console()
    (DOCS / "accuracy").mkdir(exist_ok=True)
    with console.status("") as status:

        def show(row: Row, number: int, count: int) -> None:
            status.update(f"{number} of {count}: {row.suite}, {row.problem}, {row.method}")

        known = ws.study(None, OUT / "known_answers", full=full, on_row=show)
        for name in SUITES:
            shutil.copyfile(known.diagram(name), DOCS / f"accuracy/{name}.png")
        stages = {}
        for name in STAGES:
            scene = ws.Scene.open(ROOT / f"stages/{name}.usda")
            result = ws.study(scene, OUT / name, full=full, on_row=show)
            shutil.copyfile(result.diagram("scene"), DOCS / f"accuracy/{name}.png")
            stages[name] = SceneStudy(scene), result
    for name, result in {"known_answers": known, **{name: result for name, (_, result) in stages.items()}}.items():
        shutil.copyfile(result.folder / RESULTS, DOCS / f"accuracy/{name}.json")
    (DOCS / "accuracy.md").write_text(page(known, stages, full), encoding="utf-8")


if __name__ == "__main__":
    main()
