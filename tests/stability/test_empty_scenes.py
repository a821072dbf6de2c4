"""Scenes in which something is missing: a valid stage, a plan that says what, and nothing that fails."""

from dataclasses import replace

import pytest
from hard_cases import small_plume, with_domain

import warp_smoke as ws
from warp_smoke.usd.validate import validate_stage

_PLUME = small_plume(8)
_HIDDEN = [replace(surface, visible=False) for surface in _PLUME.surfaces]
_OFF = [replace(light, enabled=False) for light in _PLUME.lights]
_DARK = [replace(light, intensity=0.0) for light in _PLUME.lights]
# What the plan says of each.
SCENES = {
    "nothing": (ws.Scene(end=2), "the stage has no smoke domain"),
    "no domain": (replace(_PLUME, domains=[]), "the stage has no smoke domain"),
    "no emitter": (replace(_PLUME, emitters=[]), "no emitter that is ever on touches it"),
    "emitter off": (replace(_PLUME, emitters=[replace(_PLUME.emitters[0], enabled=False)]), "is off at every frame"),
    "no light": (replace(_PLUME, lights=[]), "no light shines on it"),
    "lights off": (replace(_PLUME, lights=_OFF), "it is off at every frame"),
    "lights dark": (replace(_PLUME, lights=_DARK), "its intensity or colour is 0 at every frame"),
    "no receiver": (replace(_PLUME, surfaces=_PLUME.surfaces[1:]), "no mesh has SmokeReceiverAPI"),
    "all invisible": (replace(_PLUME, surfaces=_HIDDEN, emitters=[]), "no mesh has SmokeReceiverAPI"),
    "no grids": (with_domain(_PLUME, grids=()), ""),
}


@pytest.mark.parametrize("name", SCENES)
def test_empty_scenes(name, tmp_path):
    """The run ends well, its stage is valid, and the plan says what is missing."""
    scene, said = SCENES[name]
    stage = tmp_path / "set.usdc"
    replace(scene, end=2).save(stage)
    scene = ws.Scene.open(stage)
    assert said in str(ws.make_plan(scene))
    result = ws.run(scene, tmp_path / "out", threads=1)
    assert [problem for problem in validate_stage(result.stage) if problem.severity == "error"] == []
    assert len(result.report["frames"]) == 2
