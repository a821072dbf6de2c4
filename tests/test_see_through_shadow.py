"""Shadows of see-through surfaces: none below half opacity, those of opaque ones from there on."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scenes import plume, shining

import warp_smoke as ws
from warp_smoke.picture import render_picture

HIDES = {
    "clear": ({"opacity": 0.49}, False),
    "hole": ({"opacity": 0.6, "opacity_threshold": 0.7}, False),
    "half": ({"opacity": 0.5}, True),
    "whole": ({"opacity": 0.3, "opacity_threshold": 0.2}, True),
}


def _case(look=None, **fields):
    """A plume on a lit floor, and a case of a material that has both inside; without a look, no case."""
    scene = plume()
    material = ws.Material(path="/World/Looks/Glass", **(look or {}))
    case = ws.Surface(
        path="/World/Case", mesh=ws.Mesh.box((6.5, 3.5, 6.5), (-3.25, -0.5, -3.25)), material=material, **fields
    )
    return replace(scene, surfaces=[*scene.surfaces, case] if look else scene.surfaces)


def _lit(scene):
    """What is baked on the floor, and the light in the smoke, after two frames."""
    simulation = ws.Simulation(replace(scene, domains=[replace(scene.domains[0], grids=("density", "light"))]))
    frame = [simulation.step() for _ in range(2)][-1]
    (smoke,) = frame.smoke.values()
    return frame.pictures["/World/Floor", "lit"], smoke.light


@pytest.mark.parametrize("name", HIDES)
def test_light_through_a_case(name):
    """Floor and smoke in a case are lit as without it, or not at all: its sides are between them and every light."""
    look, casts = HIDES[name]
    pictures, light = _lit(_case(look))
    without, light_without = _lit(_case())
    assert without.max() > 50
    assert light_without.max() > 0
    if casts:
        assert not pictures.any()
        assert not light.any()
    else:
        np.testing.assert_array_equal(pictures, without)
        np.testing.assert_array_equal(light, light_without)


def test_only_what_casts_is_traced():
    """The plan traces no shadow of a clear case, and that of a milky one."""
    names = [
        {each.name for each in ws.make_plan(_case(look)).passes} for look in (None, {"opacity": 0.2}, {"opacity": 0.8})
    ]
    assert names[1] == names[0]
    assert any("shadow_map" in name for name in names[2] - names[0])


def test_one_opaque_material_casts_for_all(tmp_path):
    """A surface of which some faces are clear casts whole; so does one with an opacity texture."""
    Image.fromarray(np.zeros((2, 2), np.uint8)).save(tmp_path / "clear.png")
    texture = ws.Texture(file=str(tmp_path / "clear.png"), channel="r")
    solid = ws.MaterialSubset(path="/World/Case/Lid", triangles=[0], material=ws.Material(path="/World/Looks/Lid"))
    for look, fields in (({"opacity_texture": texture}, {}), ({"opacity": 0.1}, {"subsets": [solid]})):
        scene = _case(look, **fields)
        assert [s.path for s in scene.shadowing(scene.lights[0])] == [s.path for s in scene.surfaces]


@pytest.mark.parametrize("name", HIDES)
def test_pictures_have_the_same_shadows(name):
    """Beside a pane that hangs over a floor, its slanting shadow is there or not."""
    look, casts = HIDES[name]
    white = ws.Material(path="/White", diffuse_color=(0.5, 0.5, 0.5))
    ground = ws.Surface(path="/Floor", mesh=ws.Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6)), material=white)
    pane = ws.Surface(
        path="/Pane",
        mesh=ws.Mesh.grid((-2.5, 1, 1), (1, 0, 0), (0, 0, -2)),
        material=ws.Material(path="/Glass", **look),
    )
    sun = ws.DistantLight(path="/Sun", transform=shining((1, -1, 0)), intensity=2.0)
    lens = {"focal_length": 8.0, "horizontal_aperture": 6.0, "vertical_aperture": 6.0, "near": 0.01}
    down = [[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 8, 0, 1]]  # with x to the right
    camera = ws.Camera(path="/Eye", transform=down, **lens)
    with_pane, without = (
        render_picture(ws.Scene(surfaces=surfaces, lights=[sun], camera=camera), 1.0, size=(60, 60))[30, 20]
        for surfaces in ([ground, pane], [ground])
    )  # at x = −1
    assert without.min() > 50
    np.testing.assert_array_equal(with_pane, 0 if casts else without)
