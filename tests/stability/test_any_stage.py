"""Fuzzed stages: attributes of smoke, UsdGeom, UsdLux and UsdShade set to anything, blocked, or of another type."""

import warnings
from dataclasses import replace

import pytest
from arbitrary_stage import changes, open_stage
from hard_cases import check_finite, refusal, simulate, take_few_steps
from hypothesis import HealthCheck, Phase, given, settings
from pxr import Tf

import warp_smoke as ws

quick = settings(
    deadline=None,
    derandomize=True,
    max_examples=70,
    phases=[Phase.explicit, Phase.generate, Phase.shrink],
    suppress_health_check=list(HealthCheck),
)
long = settings(quick, max_examples=400)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Where the stages go, one over the other."""
    return tmp_path_factory.mktemp("stage") / "any.usda"


def read(file, changed) -> ws.Scene | None:
    """The scene of a stage after some changes; None if it is refused, in one line that names the file."""
    stage = open_stage()
    for change in changed:
        try:
            change(stage)
        except Tf.ErrorException:  # USD itself takes no such value
            continue
    stage.GetRootLayer().Export(str(file))
    refused = refusal(lambda: ws.Scene.open(file))
    if refused is None:
        return ws.Scene.open(file)
    assert refused.startswith(f"{file}: ")
    return None


def small(scene: ws.Scene) -> ws.Scene:
    """The scene with fewer cells, texels and frames."""
    lights = [
        replace(
            light,
            shadow_map_size=min(light.shadow_map_size, 8),
            smoke_shadow_size=light.smoke_shadow_size and min(light.smoke_shadow_size, 8),
            smoke_sweeps=light.smoke_sweeps and min(light.smoke_sweeps, 8),
        )
        for light in scene.lights
    ]
    surfaces = [
        replace(each, receiver=each.receiver and replace(each.receiver, texture_size=4)) for each in scene.surfaces
    ]
    domains = [replace(each, resolution=min(each.resolution, 5)) for each in scene.domains]
    return replace(scene, lights=lights, surfaces=surfaces, domains=domains, end=scene.start + 1)


@given(changes)
@quick
def test_any_attribute_is_read_or_refused(file, changed):
    """70 stages with one to four attributes set to anything: planned, or refused in one line that names the file."""
    scene = read(file, changed)
    if scene is None:
        return
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refused = refusal(lambda: ws.make_plan(scene))
    assert refused is None or "solver is spectral" in refused
    assert all("\n" not in warning for warning in scene.warnings)


@pytest.mark.slow
@given(changes)
@long
def test_any_attribute_gives_a_finite_frame_or_is_refused(file, changed):
    """400 such stages, simulated, in the slow tests: a finite frame, or the line of whoever refuses it."""
    scene = read(file, changed)
    if scene is None:
        return
    with pytest.MonkeyPatch.context() as patch:
        take_few_steps(patch)
        frames = []
        refused = refusal(lambda: frames.extend(simulate(small(scene), threads=1)[1]), FloatingPointError)
    if not refused:
        check_finite(frames)
