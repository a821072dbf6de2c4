"""The example stages: they read without a warning, hold what they promise, and are clean USD."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from warp_smoke.geometry import corner_normals, transform_points
from warp_smoke.lattice import place_lattice
from warp_smoke.plan import make_plan
from warp_smoke.scene import DistantLight, PointLight, Scene, SpotLight
from warp_smoke.usd.validate import validate_stage

STAGES = sorted((Path(__file__).parents[2] / "stages").glob("*.usda"))


def stage(name):
    """The scene of an example stage."""
    (path,) = (path for path in STAGES if path.stem == name)
    return Scene.open(path)


def on_screen(camera, point, time):
    """Where a camera sees a world point: (x, y) from −1 to 1 across the picture."""
    x, y, z = transform_points(np.linalg.inv(camera.transform_at(time)), point)
    assert z < 0, "behind the camera"
    f = 2 * camera.focal_length / -z
    return np.array([x * f / camera.horizontal_aperture, y * f / camera.vertical_aperture])


def test_all_are_tested():
    """The stages that this file knows are those that there are."""
    assert {path.stem for path in STAGES} == {
        "brazier",
        "columns",
        "cross",
        "mandelbrot",
        "obstacle",
        "plume",
        "room",
        "smoke_only",
    }


@pytest.mark.parametrize("path", STAGES, ids=lambda path: path.stem)
def test_reads_without_a_warning(path):
    """Everything on an example stage is supported."""
    assert Scene.open(path).warnings == ()


@pytest.mark.parametrize("path", STAGES, ids=lambda path: path.stem)
def test_written_again_it_is_the_same(path, tmp_path):
    """Each stage's scene, written from its records, reads back equal."""
    scene = Scene.open(path)
    scene.save(tmp_path / "again.usda")
    assert Scene.open(tmp_path / "again.usda") == scene


@pytest.mark.parametrize("path", STAGES, ids=lambda path: path.stem)
def test_is_valid(path, tmp_path):
    """No validator finds anything; in what is written from its records, only points that could be merged."""
    assert validate_stage(path) == []
    Scene.open(path).save(tmp_path / "again.usdc")
    assert {problem.source for problem in validate_stage(tmp_path / "again.usdc")} <= {"WeldChecker"}


@pytest.mark.parametrize("path", STAGES, ids=lambda path: path.stem)
def test_opens_with_a_word_on_what_it_is(path):
    """Each stage says in its documentation what it shows."""
    stage = Usd.Stage.Open(str(path))
    assert len(stage.GetRootLayer().documentation) > 100


def test_brazier():
    """A tall box whose noisy emitter, eddies and wind are all planned for; no collider, so pressure is exact."""
    scene = stage("brazier")
    (domain,) = scene.domains
    assert place_lattice(scene, domain).shape == (80, 128, 64)
    plan = make_plan(scene)
    assert {"vary_emission", "stir_air", "blow_wind"} <= {each.name for each in plan.passes}
    assert plan.domains[0].pressure_solver == "spectral"


def test_plume():
    """64³ cells above a checkered floor with a lamp and the sun, for 48 frames, all baked."""
    scene = stage("plume")
    (domain,), (emitter,) = scene.domains, scene.emitters
    assert place_lattice(scene, domain).shape == (64, 64, 64)
    assert (scene.up_axis, scene.start, scene.end, scene.time_codes_per_second) == ("Y", 1, 48, 24.0)
    assert domain.grids == ("density", "temperature", "velocity")
    assert [type(light) for light in scene.lights] == [PointLight, DistantLight]
    assert all(light.shadow_enable for light in scene.lights)
    (floor,) = (surface for surface in scene.surfaces if surface.receiver)
    assert floor.receiver.bake == ("lit", "visibility", "smokeShadow")
    assert floor.receiver.texture_size == 512
    assert floor.mesh.uvs is not None
    assert Path(floor.material.diffuse_texture.file).name == "checker.png"
    assert emitter.path not in {surface.path for surface in scene.surfaces}


def test_plume_is_in_the_picture():
    """The camera sees the emitter, the top of the box and where the sun casts the smoke's shadow on the floor."""
    scene = stage("plume")
    sun = scene.lights[1].direction_at(1)
    for point in ((0, 0.55, 0), (0, 2, 0), np.array((0, 1.5, 0)) - sun * 1.5 / sun[1]):
        assert np.all(np.abs(on_screen(scene.camera, point, 1)) < 0.95)


def test_obstacle():
    """A block that slides and turns inside a box taller than wide; it stops smoke and is seen."""
    scene = stage("obstacle")
    (domain,), (block,) = scene.domains, scene.colliders
    shape = place_lattice(scene, domain).shape
    assert max(shape) == shape[2] == 64
    assert block.moves
    assert block.path in {surface.path for surface in scene.surfaces}
    assert isinstance(scene.lights[0], SpotLight)
    for frame in scene.frames:
        points = transform_points(block.transform_at(frame), block.mesh.points)
        assert np.all(points > domain.lower)
        assert np.all(points < domain.upper)
        assert np.all(np.abs(on_screen(scene.camera, points.mean(axis=0), frame)) < 0.95)
    # Turned by 180 degrees in 47 frames, half of it half way.
    x_axis = block.transform_at(24.5)[0, :3]
    assert np.allclose(x_axis / np.linalg.norm(x_axis), (0, 1, 0), atol=1e-3)


def test_room():
    """Ten cubes in a closed room that faces inwards, with the lamp at its centre, outside all cubes."""
    scene = stage("room")
    assert not scene.domains
    (lamp,) = scene.lights
    room, *cubes = scene.surfaces
    assert len(cubes) == 10
    points = room.mesh.points
    assert np.allclose(lamp.position_at(1), (points.min(axis=0) + points.max(axis=0)) / 2)
    normals = corner_normals(points, room.mesh.triangles)[:, 0]
    inwards = lamp.position_at(1) - points[room.mesh.triangles].mean(axis=1)
    assert np.all(np.einsum("ij,ij->i", normals, inwards) > 0)
    for cube in cubes:
        corners = transform_points(cube.transform, cube.mesh.points)
        assert np.all(corners >= points.min(axis=0) - 1e-6)
        assert np.all(corners <= points.max(axis=0) + 1e-6)
        local = transform_points(np.linalg.inv(cube.transform), lamp.position_at(1))
        assert np.any(np.abs(local) > cube.mesh.points.max())


def test_room_has_its_own_place_in_the_texture_for_every_wall():
    """The six sides' texture coordinates do not overlap."""
    (room,) = (surface for surface in stage("room").surfaces if surface.receiver)
    sides = room.mesh.uvs.reshape(6, 6, 2)
    lower, upper = sides.min(axis=1), sides.max(axis=1)
    for a in range(6):
        for b in range(a):
            assert np.any((lower[a] > upper[b]) | (lower[b] > upper[a]))


def test_cross():
    """The lamp stands to the left, the right, behind and obliquely behind; the smoke and the cross shadow the floor."""
    scene = stage("cross")
    (domain,), (lamp,) = scene.domains, scene.lights
    left, right, behind, oblique = (lamp.position_at(frame) for frame in (12, 24, 36, 48))
    assert left[0] < -2 < 2 < right[0]
    assert behind[2] < -2
    assert oblique[0] < -2
    assert oblique[2] < -2
    (floor,) = (surface for surface in scene.surfaces if surface.receiver)
    assert len(scene.surfaces) == 4
    (receiver,) = make_plan(scene).receivers
    (light,) = receiver.lights
    assert light.surface_shadow
    assert [(each.domain.domain.path, each.method) for each in light.smoke] == [(domain.path, "march")]
    # The floor is below the domain: one layer is enough.
    assert light.smoke[0].layer is None
    assert floor.receiver.bake == ("lit", "visibility", "smokeShadow")


def test_columns():
    """Columns, boxes and spheres with five materials and three kinds of light; normal, height and gloss maps."""
    scene = stage("columns")
    assert {type(light) for light in scene.lights} == {PointLight, SpotLight, DistantLight}
    materials = {surface.material.path.rpartition("/")[2]: surface.material for surface in scene.surfaces}
    assert set(materials) == {"Bricks", "Stone", "Metal", "Banded", "Plinth"}
    bricks = materials["Bricks"]
    assert (bricks.roughness_texture.channel, bricks.height_texture.channel) == ("a", "a")
    assert bricks.diffuse_texture.file == bricks.roughness_texture.file
    assert bricks.normal_texture.file == bricks.height_texture.file
    assert bricks.parallax == "occlusion"
    assert materials["Stone"].normal_texture is not None
    assert materials["Banded"].gloss == "factor"
    assert materials["Metal"].reflection == "energyConserving"
    assert materials["Plinth"].procedural.kind == "noise"
    (floor,) = (surface for surface in scene.surfaces if surface.receiver)
    assert floor.material is bricks


def test_mandelbrot():
    """A plane whose colour is the computed set, baked."""
    (plane,) = stage("mandelbrot").surfaces
    assert plane.material.procedural.kind == "mandelbrot"
    assert plane.receiver.bake == ("lit",)


def test_smoke_only():
    """Centimetres and Z up, no light and no set; the vent is switched off and on again, the ball moves."""
    scene = stage("smoke_only")
    assert (scene.meters_per_unit, scene.up_axis) == (0.01, "Z")
    assert not scene.lights
    assert not scene.surfaces
    assert place_lattice(scene, scene.domains[0]).h == pytest.approx(2 / 64)
    ball, vent = scene.emitters
    assert ball.moves
    assert [bool(vent.enabled.at(frame)) for frame in (1, 15, 16, 27, 28, 48)] == [True, True, False, False, True, True]
