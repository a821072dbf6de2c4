"""Settings chosen by an error or a budget, from a stored front that is made up, and from one measured on the spot."""

from dataclasses import replace

import pytest
from scenes import plume

import warp_smoke as ws
from warp_smoke.record import FieldError
from warp_smoke.run import plan_run
from warp_smoke.study import disclosure
from warp_smoke.study.case import Row
from warp_smoke.study.choice import choose
from warp_smoke.study.conduct import disclose_study
from warp_smoke.study.scene import SMOKE, SURFACE_SHADOWS, SceneStudy
from warp_smoke.study.store import Store, read_results

# Error of the density and milliseconds a frame, by scheme and resolution; all others are slower and worse.
FRONT = {
    ("semi_lagrangian", 8): (0.5, 2.0),
    ("maccormack", 12): (0.25, 5.0),
    ("bfecc", 12): (0.4, 9.0),  # dominated
    ("bfecc", 16): (0.1, 20.0),
}
SCENE = plume(resolution=16)


@pytest.fixture(autouse=True)
def same_sources(monkeypatch):
    """The package counts as unchanged, also while someone works on it, and the bandwidth is known."""
    monkeypatch.setattr(disclosure, "source_digest", lambda: "0" * 12)
    monkeypatch.setattr(disclosure, "copy_bandwidth", lambda launcher: 10.0)


def row_of(case, error, milliseconds, failure=None):
    """A stored row of a case."""
    names = ("suite", "problem", "method", "parameters", "resolution", "dt", "key", "reference")
    about = {name: getattr(case, name) for name in names}
    seconds = 1e-3 * milliseconds
    times = {"median": seconds, "quartile_low": seconds, "quartile_high": seconds, "repeats": 5, "set_up": 0.0}
    errors = {"density": error, "shadows": error}
    return Row(**about, errors=errors, **times, ns_per_cell=1.0, copy_share=None, failure=failure)


def stored(launcher, scene, folder, values):
    """A folder with a study of a scene; `values` says error and milliseconds of each case."""
    store = Store(folder, disclose_study(launcher, scene))
    for case in SceneStudy(scene).cases(full=False):
        store.add(row_of(case, *values(case)))
    return folder


def on_front(case):
    """What the made-up front says of a case."""
    return FRONT.get((case.method, case.resolution), (0.9, 99.0)) if case.problem == SMOKE else (0.01, 0.1)


@pytest.fixture
def folder(launcher, tmp_path):
    """A study of the scene with the made-up front."""
    return stored(launcher, SCENE, tmp_path / "study", on_front)


@pytest.mark.parametrize(
    ("asked", "scheme", "resolution"),
    [
        ({"max_error": 0.6}, "semi_lagrangian", 8),
        ({"max_error": 0.5}, "semi_lagrangian", 8),
        ({"max_error": 0.4}, "maccormack", 12),
        ({"max_error": 0.1}, "bfecc", 16),
        ({"budget": 2.0}, "semi_lagrangian", 8),
        ({"budget": 15.0}, "maccormack", 12),
        ({"budget": 1e6}, "bfecc", 16),
    ],
)
def test_chooses_from_the_stored_front(folder, asked, scheme, resolution):
    """The fastest within the error, the most exact within the time, never one that another beats in both."""
    rows = []
    scene, chosen = choose(SCENE, folder=folder, on_row=lambda *row: rows.append(row), **asked)
    assert rows == []  # nothing is measured again
    assert (scene.domains[0].advection, scene.domains[0].resolution) == (scheme, resolution)
    assert chosen.settings == {"/World/Smoke": {"resolution": resolution, "advection": scheme}}
    error, milliseconds = FRONT[scheme, resolution]
    assert chosen.measured["error"] == error
    assert chosen.measured["milliseconds"] == pytest.approx(milliseconds)
    assert scene.lights == SCENE.lights
    said = str(chosen)
    assert f"{scheme} at {resolution}" in said
    assert "stored in" in said


def test_says_what_the_neighbours_cost(folder):
    """Between two others on the front both are named with what they give."""
    _, chosen = choose(SCENE, folder=folder, budget=15.0)
    assert str(chosen).startswith("Budget of 15 ms a frame sets /World/Smoke resolution 12, advection maccormack. ")
    assert "Faster is semi_lagrangian at 8: 2 ms a frame, density off the finest run by 50 %" in str(chosen)
    assert "More accurate is bfecc at 16: 20 ms a frame, density off the finest run by 10 %" in str(chosen)


@pytest.mark.parametrize(
    ("asked", "line"),
    [
        (
            {"budget": 1.5},
            r"run: budget is 1.5; allowed: from 2 ms, the cheapest there is \(semi_lagrangian at 8, density off the "
            r"finest run by 50 %\)",
        ),
        (
            {"max_error": 0.05},
            r"run: max_error is 0.05; allowed: from 0.1, the least there is \(bfecc at 16, 20 ms a frame\)",
        ),
        ({"budget": 0.0}, "budget is 0.0; allowed: "),
        ({"max_error": -1.0}, "max_error is -1.0; allowed: "),
    ],
)
def test_what_cannot_be_had(folder, asked, line):
    """One line says what the cheapest, or the most exact, would be."""
    with pytest.raises(FieldError, match=line):
        choose(SCENE, folder=folder, **asked)


def test_a_scheme_of_the_stage_is_kept(launcher, tmp_path):
    """Where the stage names its scheme only resolutions are chosen."""
    domain = replace(SCENE.domains[0], advection="bfecc", given=frozenset({"advection"}))
    scene = replace(SCENE, domains=[domain])
    folder = stored(launcher, scene, tmp_path / "study", on_front)
    chosen, _ = choose(scene, folder=folder, budget=15.0)
    assert (chosen.domains[0].advection, chosen.domains[0].resolution) == ("bfecc", 12)


def test_failed_rows_are_not_chosen(launcher, tmp_path):
    """A setting that failed is not taken, whatever it promises, nor measured again."""
    folder = tmp_path / "study"
    store = Store(folder, disclose_study(launcher, SCENE))
    for case in SceneStudy(SCENE).cases(full=False):
        failed = (case.method, case.resolution) == ("maccormack", 12)
        store.add(row_of(case, *on_front(case), failure="NotFiniteError" if failed else None))
    scene, _ = choose(SCENE, folder=folder, budget=15.0)
    assert (scene.domains[0].advection, scene.domains[0].resolution) == ("bfecc", 12)


def shadows_alone():
    """A box over a baked floor under a lamp, without smoke."""
    floor = replace(SCENE.surfaces[0], receiver=ws.Receiver(path="/World/Floor", bake=("visibility",), texture_size=32))
    box = ws.Surface(path="/World/Box", mesh=ws.Mesh.box(0.5), transform=SCENE.emitters[0].transform)
    return ws.Scene(surfaces=[floor, box], lights=[SCENE.lights[0]], end=1)


def test_without_smoke_shadows_are_chosen(launcher, tmp_path):
    """Filter and map size are, by the error of the baked pictures; a quarter of the map is 128 texels."""
    scene = shadows_alone()

    def values(case):
        small = case.method == "pcss" and case.parameters.get("map") == 0.25
        return (0.02, 1.0) if small else (0.01, 50.0) if case.method == "area" else (0.03, 30.0)

    folder = stored(launcher, scene, tmp_path / "study", values)
    changed, chosen = choose(scene, folder=folder, budget=10.0)
    assert (changed.lights[0].shadow_filter, changed.lights[0].shadow_map_size) == ("pcss", 128)
    assert chosen.settings == {"/World/Lamp": {"shadow_filter": "pcss", "shadow_map_size": 128}}
    assert choose(scene, folder=folder, max_error=0.01)[0].lights[0].shadow_filter == "area"


def test_rays_that_errors_are_measured_from_say_so(launcher, tmp_path):
    """Rays to all of the light have no error by definition, which is not a measurement."""
    folder = stored(launcher, shadows_alone(), tmp_path / "study", lambda case: (0.1 * (case.method != "area"), 1.0))
    _, chosen = choose(shadows_alone(), folder=folder, max_error=0.01)
    assert "area at 512: 1 ms a frame, the same as what errors are measured from" in str(chosen)


def test_measures_what_is_not_stored(launcher, tmp_path):
    """Without results the settings are measured, stored, and not measured again; errors are those of the study."""
    scene, folder, rows = shadows_alone(), tmp_path / "study", []
    first, chosen = choose(scene, folder=folder, max_error=0.5, on_row=lambda *row: rows.append(row))
    assert "measured now and stored in" in chosen.why
    _, measured = read_results(folder / "results.json")
    assert {row.problem for row in measured} == {SURFACE_SHADOWS}
    assert [number for _, number, _ in rows] == list(range(1, len(measured) + 1))
    fastest = min(measured, key=lambda row: row.median)
    assert first.lights[0].shadow_filter == fastest.method
    again, chosen = choose(scene, folder=folder, max_error=0.5)
    assert "stored in" in chosen.why
    assert "measured now" not in chosen.why
    assert again == first


def test_results_of_another_scene_are_left_alone(launcher, tmp_path):
    """They are neither used nor overwritten, and it says so."""
    scene = shadows_alone()
    folder = stored(launcher, replace(scene, ambient=(1.0, 1.0, 1.0)), tmp_path / "study", lambda case: (0.5, 0.001))
    before = (folder / "results.json").read_bytes()
    _, chosen = choose(scene, folder=folder, max_error=0.9)
    assert chosen.measured["milliseconds"] > 0.002
    assert "not kept, since" in chosen.why
    assert (folder / "results.json").read_bytes() == before


def test_only_one_may_choose():
    """Quality, error and budget contradict each other, in one line."""
    with pytest.raises(
        FieldError, match=r"quality draft and budget 40.0; allowed: one of quality, max_error and budget"
    ):
        plan_run(SCENE, quality="draft", budget=40.0)
    with pytest.raises(FieldError, match=r"max_error 0\.1 and budget 40\.0"):
        ws.run(SCENE, max_error=0.1, budget=40.0)
