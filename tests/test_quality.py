"""Quality presets: they fill what is left open and nothing else, say so, and lie on the measured front."""

import json
import runpy
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest
from scenes import at, plume

import warp_smoke as ws
from warp_smoke.picture.renderer import PictureRenderer
from warp_smoke.quality import QUALITIES, choose_quality, measured_presets, preset, preset_points, samples_of
from warp_smoke.record import FieldError
from warp_smoke.study.front import clearly_beats

SCRIPT = Path(__file__).parents[1] / "scripts/presets.py"


def figures(point):
    """Error and time of a measured setting."""
    return point["error"], point["milliseconds"]


@pytest.mark.parametrize("family", ["smoke", "light", "picture"])
def test_presets_are_on_the_measured_front(family):
    """No measured setting clearly beats a preset, and presets are in order of error and of time."""
    points = measured_presets()[family]["points"]
    named = [next(point for point in points if name in point["presets"]) for name in QUALITIES]
    for name, mine in zip(QUALITIES, named, strict=True):
        better = [point["settings"] for point in points if clearly_beats(figures(point), figures(mine))]
        assert not better, f"{name} is dominated"
    errors, times = zip(*map(figures, named), strict=True)
    assert list(errors) == sorted(errors, reverse=True)
    assert list(times) == sorted(times)


def test_passing_noise_is_timed_away():
    """A preset that other work slowed down is timed again beside its rivals; one that is beaten in truth stays so."""
    script = runpy.run_path(str(SCRIPT))
    settings = [{"samples": n} for n in (1, 2, 3)]
    presets = {"draft": settings[0], "final": settings[2]}
    truth = {1: (0.2, 1.0), 2: (0.2, 2.0), 3: (0.2, 3.0)}  # errors and seconds: the third is beaten by the others
    calls = []

    def measure(settings):
        calls.append(settings["samples"])
        error, seconds = truth[settings["samples"]]
        return error, [seconds * (9.0 if len(calls) == 1 else 1.0)] * 5, 1000

    points = script["measure_points"](settings, presets, measure)
    assert [figures(point) for point in points] == [(0.2, 1e3), (0.2, 2e3), (0.2, 3e3)]
    assert script["rivals_of"]("draft", points) == []
    assert script["rivals_of"]("final", points) == points[:2]
    assert [point["presets"] for point in points] == [["draft"], [], ["final"]]


def test_measurements_say_where_they_are_from():
    """Stage, processor, versions and what the error means are stored with each family."""
    for each in measured_presets().values():
        assert each["stage"].endswith(".usda")
        assert each["machine"]["processor"]
        assert each["machine"]["warp-lang"]
        assert each["means"]
        for point in each["points"]:
            assert point["error"] > 0.0
            assert point["milliseconds"] > 0.0
            assert point["ns_per_item"] > 0.0


@pytest.mark.parametrize("name", QUALITIES)
def test_fills_what_is_left_open(name):
    """A scene that sets nothing gets every setting of the preset, and nothing else of it changes."""
    quality, scene = preset(name), plume(resolution=64)
    chosen, why = choose_quality(scene, name)
    (domain,), (lamp, sun) = chosen.domains, chosen.lights
    for field in ("resolution", "advection", "max_courant", "pressure_tolerance"):
        assert getattr(domain, field) == getattr(quality, field)
    assert lamp.shadow_filter == sun.shadow_filter == quality.shadow_filter
    assert (lamp.shadow_map_size, sun.shadow_map_size) == (quality.shadow_map_size, 2 * quality.shadow_map_size)
    assert lamp.smoke_shadow == quality.smoke_shadow
    assert lamp.smoke_shadow_size == round(quality.smoke_shadow_share * quality.resolution)
    restored = replace(
        domain,
        **{field: getattr(scene.domains[0], field) for field in why.settings[domain.path]},
    )
    assert restored == scene.domains[0]
    assert chosen.emitters == scene.emitters
    assert samples_of(name) == quality.samples


def test_keeps_what_is_given():
    """Fields that the stage sets stay, also where they have the default's value, and are named."""
    scene = plume(resolution=64, advection="maccormack")
    domain = replace(scene.domains[0], given=frozenset({"resolution"}))
    light = replace(scene.lights[0], shadow_filter="exact")
    chosen, why = choose_quality(replace(scene, domains=[domain], lights=[light]), "draft")
    assert chosen.domains[0].resolution == 64
    assert chosen.domains[0].advection == "maccormack"
    assert chosen.domains[0].max_courant == preset("draft").max_courant
    assert chosen.lights[0].shadow_filter == "exact"
    assert set(why.kept["/World/Smoke"]) == {"resolution", "advection"}
    assert "The stage's own values are kept: /World/Smoke resolution, advection" in str(why)


def test_plan_says_what_was_chosen():
    """The plan of a quality is that of the scene with its settings, and names them with their measured error."""
    scene = plume(resolution=64)
    made = ws.make_plan(scene, quality="draft")
    assert made.domains[0].advection == preset("draft").advection
    assert made.scene == choose_quality(scene, "draft")[0]
    assert made.chosen.by == "Quality draft"
    assert f"density off by {preset_points('draft')['smoke']['error']:.2g}" in str(made)
    assert ws.make_plan(scene).chosen is None


def test_report_holds_the_choice(tmp_path):
    """Python's `run` takes a quality, and its report says what it set."""
    scene = replace(plume(resolution=12, frames=1), surfaces=[])
    domain = replace(scene.domains[0], given=frozenset({"resolution"}))
    result = ws.run(replace(scene, domains=[domain]), tmp_path / "out", quality="final")
    chosen = json.loads((tmp_path / "out/report.json").read_text())["chosen"]
    assert chosen == json.loads(json.dumps(result.report["chosen"]))
    assert chosen["settings"]["/World/Smoke"]["advection"] == preset("final").advection
    assert chosen["kept"]["/World/Smoke"] == ["resolution"]


def test_render_takes_samples_and_smoke_of_a_quality(tmp_path, monkeypatch):
    """`render` casts a preset's rays and simulates with its settings; samples that are given go before."""
    scene = replace(plume(resolution=64, frames=1), camera=ws.Camera(path="/World/Camera", transform=at(0, 1, 6)))
    scene.save(tmp_path / "puff.usda")
    seen = []

    def make(launcher, scene, *size, samples, shading):
        seen.append(samples)
        return PictureRenderer(launcher, scene, *size, samples=1, shading=shading)

    module = import_module("warp_smoke.picture.render")  # whose name the function in the package has
    monkeypatch.setattr(module, "PictureRenderer", make)
    monkeypatch.setattr(module, "simulate_smoke", lambda scene, *_: seen.append(scene.domains[0].resolution) or [])
    for asked in ({}, {"quality": "final"}, {"quality": "final", "samples": 3}):
        ws.render(tmp_path / "puff.usda", tmp_path / "a.png", frame=1, size=(8, 6), **asked)
    final = preset("final")
    assert seen == [2, 64, final.samples, final.resolution, 3, final.resolution]
    with pytest.raises(FieldError, match="quality is best"):
        ws.render(tmp_path / "puff.usda", tmp_path / "a.png", quality="best", samples=1)


def test_unknown_quality():
    """One line names what is allowed."""
    with pytest.raises(FieldError, match="quality is best; allowed: draft, preview, final"):
        ws.make_plan(plume(), quality="best")
