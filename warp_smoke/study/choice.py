"""Chooses settings for a scene by their error and time as measured on it.

The measurements are those of `warp-smoke study STAGE`. For a scene with smoke they cover the advection schemes at
several resolutions, and the error is the relative L2 difference of the density from the finest run, on the cells of
the coarser run, at the last frame studied. For a scene without smoke they cover the shadow filters at several map
sizes, and the error is the root mean square difference of the baked pictures (1 = black to white) from shadows traced
with rays to the full area of each light. Times are medians per frame.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from warp_smoke.launch import Launcher
from warp_smoke.quality import Chosen, words_of_choice
from warp_smoke.record import FieldError, positive
from warp_smoke.scene import Scene
from warp_smoke.study.case import Row
from warp_smoke.study.conduct import disclose_study, study_folder
from warp_smoke.study.disclosure import IDENTITY
from warp_smoke.study.front import pareto_front
from warp_smoke.study.measure import measure_case
from warp_smoke.study.scene import FINEST, SMOKE, SURFACE_SHADOWS, SceneStudy
from warp_smoke.study.settings import with_smoke, with_surface_shadows
from warp_smoke.study.store import RESULTS, Store, read_results
from warp_smoke.study.words import duration, percent

# The error by which each problem's settings are chosen: its name in the rows, and in words.
_ERRORS = {SMOKE: ("density", "density off the finest run by"), SURFACE_SHADOWS: ("shadows", "baked light off by")}


def choose(
    scene: Scene,
    *,
    max_error: float | None = None,
    budget: float | None = None,
    device: str = "cpu",
    threads: int | None = None,
    folder: Path | None = None,
    on_row: Callable[[Row, int, int], None] | None = None,
) -> tuple[Scene, Chosen]:
    """Chooses the fastest settings within an error limit, or the most accurate ones within a time limit.

    Resolution and scheme (filter and map size where there is no smoke) are chosen; a scheme that the stage sets is
    kept. Results stored by `warp-smoke study` are used if they belong to this scene, device and version; otherwise the
    settings are measured first, and stored unless the folder holds other results.

    Args:
        scene: what will run.
        max_error: the largest error.
        budget: the longest median time of a frame [ms]; give either this or `max_error`.
        device: `cpu`, `cuda` or `cuda:N`.
        threads: CPU threads; all unless given.
        folder: of the study; that of `warp-smoke study STAGE` unless given.
        on_row: called with each row measured, its number and their count.

    Returns:
        The scene with the chosen settings, and the choice with its reason.

    Raises:
        FieldError: no setting is accurate or fast enough; the message says which comes closest.
        ValueError: there is neither smoke nor a shadow to choose settings for.
    """
    name, limit = ("budget", budget) if max_error is None else ("max_error", max_error)
    limit = positive("run", name, limit)
    folder = folder or study_folder(scene)
    rows, source = _measurements(scene, device, threads, folder, on_row)
    problem = SMOKE if any(row.problem == SMOKE for row in rows) else SURFACE_SHADOWS
    front = pareto_front([row for row in rows if _is_open(scene, problem, row)], _ERRORS[problem][0])
    chosen = _pick(front, problem, name, limit)
    changed, settings = _apply(scene, problem, chosen)
    why = _explain(front, problem, chosen, len(rows), source)
    measured = {"error": chosen.errors[_ERRORS[problem][0]], "milliseconds": 1e3 * chosen.median, "source": source}
    return changed, Chosen(words_of_choice(max_error, budget), settings, {}, why, measured)


def _measurements(
    scene: Scene, device: str, threads: int | None, folder: Path, on_row: Callable[[Row, int, int], None] | None
) -> tuple[list[Row], str]:
    """Returns the rows to choose from, and where they come from in words."""
    launcher = Launcher(device, threads)
    disclosure, file = disclose_study(launcher, scene), folder / RESULTS
    cases = SceneStudy(scene).cases(full=False)
    problem = SMOKE if any(case.problem == SMOKE for case in cases) else SURFACE_SHADOWS
    cases = [case for case in cases if case.problem in (problem, FINEST)]
    about, rows = read_results(file) if file.exists() else (disclosure, [])
    fits = all(about.get(key) == disclosure.get(key) for key in (*IDENTITY, "stage", "scene"))
    done = {row.key: row for row in rows if fits}
    missing, source = [case for case in cases if case.key not in done], f"stored in {file}"
    if missing:
        store = Store(folder, disclosure) if fits else None
        for index, case in enumerate(missing):
            row = done[case.key] = measure_case(launcher, case, disclosure["copy_gb_per_s"])
            if store:
                store.add(row)
            if on_row:
                on_row(row, index + 1, len(missing))
        kept = f"stored in {file}" if fits else f"not kept, since {file} belongs to another version or scene"
        source = f"measured now and {kept}"
    found = [done[case.key] for case in cases if case.problem == problem]
    return [row for row in found if row.failure is None], source


def _is_open(scene: Scene, problem: str, row: Row) -> bool:
    """Returns whether the stage leaves a row's method open."""
    field = "advection" if problem == SMOKE else "shadow_filter"
    records = scene.domains if problem == SMOKE else scene.lights
    return all(field not in record.given or getattr(record, field) == row.method for record in records)


def _pick(front: Sequence[Row], problem: str, name: str, limit: float) -> Row:
    """Chooses a row from a front, which is ordered fastest first."""
    error, words = _ERRORS[problem]
    if not front:
        raise FieldError("run", name, f"{limit:g}", "nothing, since no setting could be measured")
    if name == "budget":
        affordable = [row for row in front if 1e3 * row.median <= limit]
        if affordable:
            return affordable[-1]
        cheapest = f"{1e3 * front[0].median:.3g} ms, the cheapest there is ({_setting(front[0])}, {words} "
        raise FieldError("run", name, f"{limit:g}", f"from {cheapest}{percent(front[0].errors[error])})")
    exact = [row for row in front if row.errors[error] <= limit]
    if exact:
        return exact[0]
    best = f"{front[-1].errors[error]:.3g}, the least there is ({_setting(front[-1])}, {duration(front[-1].median)} "
    raise FieldError("run", name, f"{limit:g}", f"from {best}a frame)")


def _apply(scene: Scene, problem: str, row: Row) -> tuple[Scene, dict[str, dict[str, object]]]:
    """Returns the scene with a row's settings, and those settings by prim path."""
    if problem == SMOKE:
        changed, before, after = with_smoke(scene, row.method, row.resolution), "domains", ("resolution", "advection")
    else:
        changed = with_surface_shadows(scene, row.method, float(row.parameters.get("map", 1.0)))
        before, after = "lights", ("shadow_filter", "shadow_map_size")
    settings = {}
    for record in getattr(changed, before):
        settings[record.path] = {field: getattr(record, field) for field in after}
    return changed, settings


def _explain(front: Sequence[Row], problem: str, chosen: Row, count: int, source: str) -> str:
    """Explains why a row was chosen: its time and error, and those of its neighbours on the front."""
    error, words = _ERRORS[problem]

    def gives(row: Row) -> str:
        size = row.errors[error]
        off = f"{words} {percent(size)}" if size else "the same as what errors are measured from"
        return f"{duration(row.median)} a frame, {off}"

    place = front.index(chosen)
    beside = [(front[place - 1], "Faster")] if place > 0 else []
    beside += [(front[place + 1], "More accurate")] if place + 1 < len(front) else []
    others = "".join(f". {comparison} is {_setting(row)}: {gives(row)}" for row, comparison in beside)
    return f"{_setting(chosen)}: {gives(chosen)} (of {count} settings {source}){others}"


def _setting(row: Row) -> str:
    return f"{row.method} at {row.resolution}"
