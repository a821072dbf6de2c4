"""Conducts a study: measures what has not been measured yet, and writes tables, diagrams and the page."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from warp_smoke.files import replacing, write_text
from warp_smoke.fingerprint import digest, fingerprint
from warp_smoke.launch import Launcher
from warp_smoke.scene import Scene
from warp_smoke.study.case import Case, Row, Suite
from warp_smoke.study.disclosure import disclose
from warp_smoke.study.measure import measure_case
from warp_smoke.study.store import Store, csv_text
from warp_smoke.study.suites import SUITES, load_suite

SCENE = "scene"
PAGE, TABLE = "study.html", "results.csv"


@dataclass(frozen=True)
class Study:
    """What a study found.

    Attributes:
        folder: holds results.json, results.csv, study.html, and a diagram SUITE.png for each suite.
        disclosure: device, threads, versions, commit and copy bandwidth.
        rows: those measured against the same references, in the order of the suites' cases.
        orders: fitted orders by suite, problem and method.
        unexpected: known answers that are missed, by suite, one line each.
        recommendation: what to choose for the stage, in one line; None without a stage.
    """

    folder: Path
    disclosure: Mapping[str, object]
    rows: Sequence[Row]
    orders: Mapping[str, Mapping[tuple[str, str], float]]
    unexpected: Mapping[str, Sequence[str]]
    recommendation: str | None

    @property
    def page(self) -> Path:
        """Path of the web page."""
        return self.folder / PAGE

    def as_json(self) -> dict:
        """Returns everything but the files as plain data."""
        orders = {
            suite: [
                {"problem": problem, "method": method, "order": slope} for (problem, method), slope in found.items()
            ]
            for suite, found in self.orders.items()
        }
        unexpected = {name: list(lines) for name, lines in self.unexpected.items()}
        return {
            "disclosure": dict(self.disclosure),
            "orders": orders,
            "unexpected": unexpected,
            "recommendation": self.recommendation,
            "page": str(self.page),
            "rows": [asdict(row) for row in self.rows],
        }

    def diagram(self, suite: str) -> Path:
        """Returns the path of a suite's diagram."""
        return self.folder / f"{suite}.png"


def conduct(
    scene: Scene | None,
    folder: Path,
    names: Sequence[str],
    full: bool,
    device: str,
    threads: int | None,
    on_row: Callable[[Row, int, int], None] | None,
) -> Study:
    """Runs a study; see `warp_smoke.study.study`."""
    suites: dict[str, Suite] = {name: _suite(name, scene) for name in names}
    launcher = Launcher(device, threads)
    disclosure = disclose_study(launcher, scene)
    cases = [case for suite in suites.values() for case in suite.cases(full)]
    store = Store(folder, disclosure)
    done = {key for key, row in store.rows.items() if row.failure is None}
    for index, case in enumerate(cases):
        if case.key not in done:
            store.add(measure_case(launcher, case, disclosure["copy_gb_per_s"]))
        if on_row:
            on_row(store.rows[case.key], index + 1, len(cases))
    # Suites that an earlier study left in the folder are on the page too.
    stored = {row.suite for row in store.rows.values()}
    earlier = {name: _suite(name, scene) for name in (SCENE, *SUITES) if name in stored and name not in suites}
    suites = {name: (earlier | suites)[name] for name in (SCENE, *SUITES) if name in (earlier | suites)}
    shown = comparable(store.rows.values(), cases)
    rows = {name: [row for row in shown if row.suite == name] for name in suites}
    _write(folder, disclosure, suites, rows)
    valid = {name: [row for row in found if row.failure is None] for name, found in rows.items()}
    return Study(
        folder=folder,
        disclosure=disclosure,
        rows=tuple(row for found in rows.values() for row in found),
        orders={name: suite.order(valid[name]) for name, suite in suites.items()},
        unexpected={name: suite.unexpected(valid[name]) for name, suite in suites.items()},
        recommendation=suites[SCENE].recommendation(valid[SCENE]) if SCENE in suites else None,
    )


def comparable(rows: Iterable[Row], cases: Sequence[Case]) -> list[Row]:
    """Returns the rows that can share a diagram: for each problem, those with errors measured from the same run.

    Args:
        rows: all that are stored, the latest last.
        cases: of this study; their rows come first, and their references take precedence.
    """
    rows = list(rows)
    references = {(each.suite, each.problem): each.reference for each in (*rows, *cases)}
    rank = {case.key: index for index, case in enumerate(cases)}
    kept = [row for row in rows if row.reference == references[row.suite, row.problem]]
    return sorted(kept, key=lambda row: rank.get(row.key, len(rank)))


def _suite(name: str, scene: Scene | None) -> Suite:
    """Returns a suite by its name."""
    if name != SCENE:
        return load_suite(name)
    from warp_smoke.study.scene import SceneStudy

    return SceneStudy(scene)


def disclose_study(launcher: Launcher, scene: Scene | None) -> dict:
    """Returns what a study discloses: machine, versions and scene."""
    disclosure = disclose(launcher)
    if scene is not None:
        disclosure |= {"stage": _name(scene), "scene": digest(fingerprint(scene, str(launcher.device)))[:12]}
    return disclosure


def _write(folder: Path, disclosure: dict, suites: Mapping[str, Suite], rows: Mapping[str, list[Row]]) -> None:
    """Writes the table, the diagrams and the page."""
    from warp_smoke.study.page import results_page
    from warp_smoke.study.plot import draw_diagram, picture

    facts = [disclosure["processor"], f"{disclosure['threads']} threads", str(disclosure["device"])]
    facts += [f"{name} {disclosure[name]}" for name in ("warp-smoke", "warp-lang", "numpy")]
    facts += [f"commit {disclosure['commit']}"] if disclosure["commit"] else []
    note = ", ".join([*facts, f"copies {disclosure['copy_gb_per_s']:.1f} GB/s", disclosure["date"]])
    write_text(folder / TABLE, csv_text(disclosure, [row for found in rows.values() for row in found]))
    for name, suite in suites.items():
        drawn = [row for row in rows[name] if row.problem not in getattr(suite, "TABLES", ())]
        if drawn:
            with replacing(folder / f"{name}.png") as partial:
                partial.write_bytes(picture(draw_diagram(suite, drawn, title=suite.TITLE, note=note), "png"))
    write_text(folder / PAGE, results_page(disclosure, suites, rows, note))


def chosen_suites(scene: Scene | None, asked: Sequence[str] | None) -> list[str]:
    """Returns the names of the suites asked for.

    Raises:
        ValueError: there is no such suite, or `scene` without a stage.
    """
    if asked is None:
        return list(SUITES) if scene is None else [SCENE]
    allowed = [*SUITES, *([SCENE] if scene is not None else []), "all"]
    for name in asked:
        if name not in allowed:
            hint = ", which needs a stage" if name == SCENE else ""
            raise ValueError(f"suite is {name}{hint}; allowed: {', '.join(allowed)}")
    return allowed[:-1] if "all" in asked else list(dict.fromkeys(asked))


def study_folder(scene: Scene | None) -> Path:
    """Returns the folder for results unless one is given."""
    return Path("out", "study" if scene is None else f"{Path(_name(scene)).stem}.study")


def _name(scene: Scene) -> str:
    return scene.source.name if scene.source else "scene"
