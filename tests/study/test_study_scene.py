"""Studies of a stage: what is compared with what, effects, and what there is to study."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import at, floor, plume
from study_rows import FakeSuite, make_row

import warp_smoke as ws
from warp_smoke.lattice import Lattice
from warp_smoke.picture import SmokeVolume
from warp_smoke.study import conduct, disclosure, study
from warp_smoke.study.conduct import disclose_study
from warp_smoke.study.measure import measure_case
from warp_smoke.study.outcome import Outcome, differences
from warp_smoke.study.scene import (
    EFFECTS,
    EVERYTHING,
    FINEST,
    PRESSURE,
    SMOKE,
    SMOKE_SHADOWS,
    SURFACE_SHADOWS,
    SceneStudy,
    recommended,
)
from warp_smoke.study.settings import effects_off
from warp_smoke.study.store import Store

BOX = ws.Surface(path="/World/Box", mesh=ws.Mesh.box(0.5), transform=at(1, 0.5, 0))


def _room() -> ws.Scene:
    """A box over a baked floor under a lamp, without smoke."""
    return replace(plume(), domains=[], emitters=[], surfaces=[floor(), BOX])


def _full_stage() -> ws.Scene:
    """Smoke around a collider, a box that casts a shadow, and a camera."""
    smoky = plume(8, 3, vorticity=0.5, temperature_cooling=0.5)
    collider = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 16), transform=at(0, 1, 0))
    camera = ws.Camera(path="/World/Camera", transform=at(0, 1.5, 6))
    return replace(smoky, surfaces=[floor(), BOX], colliders=[collider], camera=camera)


def _problems(cases) -> set[str]:
    return {case.problem for case in cases}


def test_stage_without_smoke_studies_shadows_alone():
    """There are shadows of surfaces and effects, and not one case of smoke."""
    cases = SceneStudy(_room()).cases(False)
    assert _problems(cases) == {SURFACE_SHADOWS, EFFECTS}
    assert {case.method for case in cases if case.problem == EFFECTS} == {
        EVERYTHING,
        "shadows of surfaces",
        "baked light",
    }


def test_stage_with_nothing_to_study_is_refused(tmp_path):
    """A lamp over an unbaked floor gives one line, and no folder."""
    bare = replace(_room(), surfaces=[replace(floor(), receiver=None)])
    with pytest.raises(ValueError, match=r"^scene: stage is one without anything to study; allowed: [^\n]*$"):
        study(bare, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_pressure_tolerance_matters_only_to_iterations():
    """It is studied where a collider calls for an iterative solver, and not where pressure is exact."""
    assert PRESSURE in _problems(SceneStudy(_full_stage()).cases(False))
    assert PRESSURE not in _problems(SceneStudy(plume(8, 3)).cases(False))


def test_large_stages_are_studied_coarser():
    """A quick study of a domain of 512³ cells has its finest run within 2²¹ cells; a full one is twice as fine."""
    scene = plume(512, 3)
    finest = [case.resolution for case in SceneStudy(scene).cases(False) if case.problem == FINEST]
    assert finest[0] ** 3 <= 2**21
    assert [case.resolution for case in SceneStudy(scene).cases(True) if case.problem == FINEST] == [1024]


def test_keys_say_what_rows_are_measured_from():
    """A full study of 40 frames shares no row with a quick one of 25; of 3 frames, those whose reference is the same.

    The finest run is then another one, and all that is measured from it.
    """
    scene = replace(_full_stage(), end=40)
    quick, full = ({case.key: case for case in SceneStudy(scene).cases(full)} for full in (False, True))
    assert not quick.keys() & full.keys()
    assert {case.reference for case in quick.values() if case.problem == SMOKE} == {"maccormack at 12, frame 25"}
    assert {case.reference for case in full.values() if case.problem == SMOKE} == {"maccormack at 16, frame 40"}
    quick, full = ({case.key: case for case in SceneStudy(_full_stage()).cases(full)} for full in (False, True))
    shared = _problems(quick[key] for key in quick.keys() & full.keys())
    assert shared == {EFFECTS, PRESSURE, SURFACE_SHADOWS, SMOKE_SHADOWS}


def test_each_effect_is_switched_off():
    """Every scene without an effect still has all other passes, and not that effect's."""
    scene = _full_stage()
    passes = {each.name for each in ws.make_plan(scene).passes}
    without = effects_off(scene, ws.make_plan(scene))
    expected = {
        "vorticity confinement": "confine_vorticity",
        "cooling": "cool_temperature",
        "active box": "fit_active_box",
        "colliders": "voxelize_colliders",
        "shadows of surfaces": "surface_visibility",
        "shadows of smoke": "smoke_transmittance",
        "baked light": "bake",
    }
    assert without.keys() == expected.keys() | {"buoyancy"}
    for effect, name in expected.items():
        left = {each.name for each in ws.make_plan(without[effect]).passes}
        assert name in passes
        assert name not in left
    assert "advect_density" in {each.name for each in ws.make_plan(without["vorticity confinement"]).passes}


def test_turbulence_of_emitters_is_switched_off_too():
    """Air that a domain and its emitter stir is stirred by neither without turbulence."""
    scene = plume()
    domains = [replace(each, turbulence=2.0) for each in scene.domains]
    scene = replace(scene, domains=domains, emitters=[replace(each, turbulence=1.0) for each in scene.emitters])
    still = effects_off(scene, ws.make_plan(scene))["turbulence"]
    assert "stir_air" not in {each.name for each in ws.make_plan(still).passes}


def test_runs_are_compared_with_the_finest(launcher):
    """What is the same as its reference is off by 0, everything else by more; times of passes are known."""
    suite = SceneStudy(_full_stage())
    rows, methods = {}, (EVERYTHING, "colliders", "hard", "area", "march", "ray_traced")
    for case in suite.cases(False):
        if case.problem == FINEST or case.method in methods or (case.problem == SMOKE and case.resolution == 4):
            row = measure_case(launcher, case, 10.0)
            assert row.failure is None
            rows[row.problem, row.method, row.resolution, str(row.parameters)] = row
    zero = {key[:2] for key, row in rows.items() if not any(row.errors.values())}
    references = {(FINEST, "maccormack"), (EFFECTS, EVERYTHING)}
    assert references | {(SURFACE_SHADOWS, "area"), (SMOKE_SHADOWS, "ray_traced")} <= zero
    smoke = [row for (problem, *_), row in rows.items() if problem == SMOKE]
    assert len(smoke) == 4
    assert all(row.errors["density"] > 0 and row.errors["picture"] > 0 and row.repeats >= 5 for row in smoke)
    everything = next(row for (problem, method, *_), row in rows.items() if method == EVERYTHING)
    assert everything.passes["project_pressure"] > 0
    assert "load_kernels" not in everything.passes
    assert suite.recommendation(list(rows.values())).startswith("Recommended: for smoke ")
    assert "\n" not in suite.recommendation(list(rows.values()))


def test_differences_have_closed_forms():
    """A tenth more smoke is 10 % off; one code of 8 bits is 1 / 255, half of the pixels by it 1 / (255 √2)."""
    lattice = Lattice(
        shape=(4, 4, 4), voxel_size=1, to_world=np.eye(4), meters_per_unit=1, sides=("open",) * 6, up=(0, 1, 0)
    )
    domain = ws.SmokeDomain(path="/Smoke")
    density = np.random.default_rng(1).random((4, 4, 4)).astype(np.float32)
    grey = np.full((2, 2), 100, np.uint8)
    other = grey.copy()
    other[0] += 1
    fine = Outcome({"/Smoke": SmokeVolume(domain, lattice, density)}, {("/Floor", "lit"): grey}, grey)
    found = Outcome({"/Smoke": SmokeVolume(domain, lattice, 1.1 * density)}, {("/Floor", "lit"): other}, grey + 1)
    errors = differences(found, fine)
    assert errors == pytest.approx({"density": 0.1, "shadows": 1 / 255 / 2**0.5, "picture": 1 / 255}, rel=1e-5)
    assert differences(Outcome({}, {}, None), fine) == {}


def test_recommended_is_the_cheapest_that_is_nearly_the_best():
    """Of errors 0.3, 0.12 and 0.1 in 1, 2 and 9 s the second; an error below a code of 8 bits is as good as none.

    What the others are compared with has none, and is not recommended although all others are far from it.
    """
    rows = [make_row(key=str(t), median=t, errors={"l2": e}) for e, t in ((0.3, 1.0), (0.12, 2.0), (0.1, 9.0))]
    assert recommended(rows, "l2").median == 2.0
    rows = [make_row(key=str(t), median=t, errors={"l2": e}) for e, t in ((0.1, 1.0), (0.003, 2.0), (0.0, 9.0))]
    assert recommended(rows, "l2").median == 2.0
    rows = [make_row(key=str(t), median=t, errors={"l2": e}) for e, t in ((0.1, 1.0), (0.05, 2.0), (0.0, 9.0))]
    assert recommended(rows, "l2").median == 2.0


def test_nothing_is_recommended_by_equal_pictures():
    """Filters that all give the same pictures, as black ones are, leave nothing to choose by."""
    rows = [make_row(problem=SURFACE_SHADOWS, key=str(t), median=t, errors={"shadows": 0.0}) for t in (1.0, 2.0)]
    said = "for shadows of surfaces nothing to choose by: all settings give the same pictures (are they black?)"
    assert SceneStudy(_room()).recommendation(rows) == f"Recommended: {said}."


def test_a_stage_stays_on_the_page(launcher, tmp_path, monkeypatch):
    """A suite that is measured later in the folder of a stage joins it: the stage's rows and its section remain."""
    monkeypatch.setattr(disclosure, "source_digest", lambda: "0" * 12)
    monkeypatch.setattr(conduct, "load_suite", lambda name: FakeSuite({"quick": (0.1, 1.0)}))
    room = _room()
    row = make_row(suite="scene", problem=SURFACE_SHADOWS, method="hard", errors={"shadows": 0.1}, reference="rays")
    Store(tmp_path, disclose_study(launcher, room)).add(row)
    result = study(room, tmp_path, suites=["flow"], device=str(launcher.device), threads=launcher.threads)
    assert [row.method for row in result.rows] == ["hard", "quick"]
    assert "for shadows of surfaces hard at 8" in result.recommendation
    page = result.page.read_text()
    assert page.index("The stage scene") < page.index("A suite")


def test_results_of_another_stage_are_refused(launcher, tmp_path, monkeypatch):
    """A lamp that was moved, in the same folder: a line that names what differs, nothing measured or overwritten."""
    monkeypatch.setattr(disclosure, "source_digest", lambda: "0" * 12)
    room, threads = _room(), launcher.threads
    Store(tmp_path, disclose_study(launcher, room)).add(make_row(suite="scene"))
    before = (tmp_path / "results.json").read_bytes()
    moved = replace(room, lights=[replace(room.lights[0], transform=at(1, 3, 0))])
    with pytest.raises(ValueError, match=r"results.json: scene is \w+; allowed: \w+, as in this run; choose another"):
        study(moved, tmp_path, device=str(launcher.device), threads=threads)
    assert (tmp_path / "results.json").read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["results.json"]
