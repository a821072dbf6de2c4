"""Baked light made anew: as it was where nothing is switched, and other light as a run under it would bake it."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import plume

import warp_smoke as ws
from warp_smoke.preview.relight import Switches
from warp_smoke.preview.stage import PreviewStage

LAMP, SUN, FLOOR = "/World/Lamp", "/World/Sun", "/World/Floor"
# A switch that turns nothing off: all is baked anew under the light that it was baked under.
NOTHING = Switches(off=frozenset({"/None"}))
# Of the codes of a picture: the run's density, and that of its files in half precision.
HALF = 1
BLOCKED = ws.Surface(
    path="/World/Plate", mesh=ws.Mesh.box((0.6, 0.1, 0.6), (0.2, 2.0, 0.2)), material=ws.Material(path="/World/White")
)


def _scene(**fields):
    """Smoke and a plate, both of which shadow a floor."""
    scene = plume(frames=6, grids=("density", "light"))
    return replace(scene, surfaces=[*scene.surfaces, BLOCKED], **fields)


@pytest.fixture(scope="module")
def bake(tmp_path_factory):
    """Runs a scene: its stage in the preview."""

    def run(scene):
        return PreviewStage(ws.run(scene, tmp_path_factory.mktemp("run")).stage)

    return run


@pytest.fixture(scope="module")
def stage(bake):
    """The scene as it is."""
    return bake(_scene())


def _codes(frame):
    return frame.pictures[FLOOR][..., :3].astype(int)


def test_nothing_switched(stage):
    """The bake made anew from the files, at a frame with smoke, is the one in the texture."""
    np.testing.assert_allclose(_codes(stage.load(6, switches=NOTHING)), _codes(stage.load(6)), atol=HALF)


def test_a_light_that_is_off(stage, bake):
    """Without the lamp the floor is baked, and the smoke lit, as a run of the scene without it does."""
    lamp, sun = _scene().lights
    without = bake(_scene(lights=[sun]))
    switched, run = stage.load(6, switches=Switches(off=frozenset({lamp.path}))), without.load(6)
    np.testing.assert_allclose(_codes(switched), _codes(run), atol=HALF)
    assert np.abs(_codes(switched) - _codes(stage.load(6))).max() > 50
    (smoke,), (expected,) = switched.smoke, run.smoke
    seen = expected.rgba[..., 3] > 0
    np.testing.assert_allclose(smoke.rgba[seen] / 257.0, expected.rgba[seen] / 257.0, atol=2)


def test_without_shadows(stage, bake):
    """The floor is as bright as one on which no shadows fall; the smoke stays as it is."""
    scene = _scene()
    floor, plate = scene.surfaces
    bright = replace(floor, receiver=replace(floor.receiver, receive_shadow=False, receive_smoke=False))
    switched = stage.load(6, switches=Switches(shadows=False))
    expected = bake(replace(scene, surfaces=[bright, plate])).load(6)
    np.testing.assert_array_equal(_codes(switched), _codes(expected))
    assert (_codes(switched) >= _codes(stage.load(6))).all()
    assert (_codes(switched) > _codes(stage.load(6)) + 20).any()
    np.testing.assert_array_equal(switched.smoke[0].rgba, stage.load(6).smoke[0].rgba)


def test_another_resolution_than_the_stages(tmp_path):
    """A run at another resolution and texture size, as a quality preset makes it, is baked anew at these."""
    scene = _scene()
    domain, floor = replace(scene.domains[0], resolution=12), scene.surfaces[0]
    finer = replace(floor, receiver=replace(floor.receiver, texture_size=48))
    result = ws.run(replace(scene, domains=[domain], surfaces=[finer, BLOCKED]), tmp_path)
    stage = PreviewStage(result.stage)
    stage.scene = replace(stage.scene, domains=scene.domains, surfaces=scene.surfaces)
    stage._domains = {each.path: each for each in scene.domains}
    np.testing.assert_allclose(_codes(stage.load(6, switches=NOTHING)), _codes(stage.load(6)), atol=HALF)


def test_values_at_points(bake):
    """A floor with texture coordinates that overlap, and so baked at its points, is baked anew there too."""
    scene = _scene()
    floor = scene.surfaces[0]
    uvs = np.array([[[0, 0], [3, 0], [3, 3]], [[3, 0.1], [3, 1.2], [2, 0.2]]], np.float32)
    stage = bake(replace(scene, surfaces=[replace(floor, mesh=replace(floor.mesh, uvs=uvs)), BLOCKED]))
    before, switched = stage.load(6), stage.load(6, switches=NOTHING)
    assert before.pictures == switched.pictures == {}
    np.testing.assert_allclose(switched.colors[FLOOR], before.colors[FLOOR], rtol=1e-2)  # of smoke in half precision


def test_no_light_left(stage):
    """With all lights off, and without ambient light, nothing is baked: the floor has its material, unlit."""
    frame = stage.load(6, switches=Switches(off=frozenset({LAMP, SUN})))
    assert frame.pictures == {}
    assert frame.off == {LAMP, SUN}
    assert not frame.smoke[0].rgba[..., :3].any()


def test_frames_one_after_the_other(stage):
    """What stands still keeps its picture, the same array; what smoke shadows is baked again at each frame."""
    still, moving = Switches(shadows=False), Switches(off=frozenset({SUN}))
    assert stage.load(5, switches=still).pictures[FLOOR] is stage.load(6, switches=still).pictures[FLOOR]
    first, second = (stage.load(frame, switches=moving) for frame in (5, 6))
    assert not np.array_equal(_codes(first), _codes(second))
    np.testing.assert_array_equal(_codes(stage.load(5, switches=moving)), _codes(first))


def test_smoke_without_a_density_file(tmp_path):
    """Shadows of smoke whose density was not written cannot be made anew, which is said by path."""
    scene = replace(_scene(), domains=[replace(_scene().domains[0], grids=("velocity",))])
    stage = PreviewStage(ws.run(scene, tmp_path).stage)
    with pytest.raises(ValueError, match="/World/Smoke: no volume has its density, so its shadow cannot be recomputed"):
        stage.load(6, switches=NOTHING)
