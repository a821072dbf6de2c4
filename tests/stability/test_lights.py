"""Lights where they hardly ever are: on a vertex, in a surface, inside a mesh or the smoke, overhead, grazing."""

from dataclasses import replace
from itertools import zip_longest

import numpy as np
import pytest
from hard_cases import check_finite, simulate, small_plume
from scenes import at, shining

import warp_smoke as ws
from warp_smoke.scene import FALLOFF_MODELS, SHADOW_FILTERS, SMOKE_SHADOWS

# The floor is in y = 0, -3 to 3; the cube around (0.9, 1.4, 0.3), 0.4 wide; smoke from (-1, 0, -1) to (1, 2, 1).
POSITIONS = {
    "on the floor's corner": (-3.0, 0.0, 3.0),
    "on the floor": (0.4, 0.0, -0.7),
    "on the floor's diagonal": (0.5, 0.0, -0.5),
    "below the floor": (0.3, -1.0, 0.2),
    "on the cube's corner": (0.7, 1.2, 0.1),
    "in the cube's side": (0.9, 1.6, 0.3),
    "inside the cube": (0.9, 1.4, 0.3),
    "in the smoke": (0.1, 0.5, -0.1),
    "on the smoke's side": (0.0, 2.0, 0.0),
    "on the smoke's corner": (1.0, 2.0, 1.0),
    "overhead": (0.0, 5.0, 0.0),
    "grazing": (50.0, 1e-4, 0.0),
    "a million units away": (0.0, 1e6, 0.0),
}
DIRECTIONS = {
    "straight down": (0.0, -1.0, 0.0),
    "straight up": (0.0, 1.0, 0.0),
    "along the floor": (1.0, 0.0, 0.0),
    "nearly along the floor": (1.0, -1e-6, 0.0),
    "along a diagonal": (-1.0, -1.0, -1.0),
}


def lit_by(*lights: ws.Light) -> ws.Scene:
    """The scene under other lights, for two frames; the cube is baked at its corners too.

    Values at points are float32: in a picture NaN would be black, and infinite light white.
    """
    scene = small_plume(12)
    floor, cube = scene.surfaces
    return replace(scene, surfaces=[floor, baked_at_points(cube)], lights=lights, end=2)


def baked_at_points(surface: ws.Surface) -> ws.Surface:
    """The surface with every bake of its light as values at its points."""
    receiver = ws.Receiver(path=surface.path, bake=("lit", "irradiance", "visibility", "smokeShadow"))
    return replace(surface, mesh=replace(surface.mesh, uvs=None), receiver=receiver)


@pytest.mark.parametrize("place", POSITIONS)
def test_point_lights(place):
    """Point lights of no size and of some, and a spot light, in one place, with every kind of shadow: finite."""
    lights = []
    for method in SHADOW_FILTERS:
        fields = {"transform": at(*POSITIONS[place]), "shadow_filter": method, "shadow_map_size": 32}
        lights += [ws.PointLight(path=f"/World/Point_{method}", radius=0.0, **fields)]
        lights += [ws.PointLight(path=f"/World/Ball_{method}", radius=0.3, **fields)]
        lights += [ws.SpotLight(path=f"/World/Spot_{method}", cone_angle=30.0, **fields)]
    check_finite(simulate(lit_by(*lights))[1])


@pytest.mark.parametrize("place", POSITIONS)
def test_smoke_shadows_of_point_lights(place):
    """Point lights in one place, inside the smoke too, with every kind of smoke shadow: finite."""
    matrix = at(*POSITIONS[place])
    lights = [
        ws.PointLight(path=f"/World/{method}", transform=matrix, smoke_shadow=method, shadow_map_size=32)
        for method in SMOKE_SHADOWS
    ]
    check_finite(simulate(lit_by(*lights))[1])


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_distant_lights(direction):
    """Distant lights with every kind of shadow, from straight down to along the floor: finite; from below, black."""
    matrix, lights = shining(DIRECTIONS[direction]), []
    for surface, smoke in zip_longest(SHADOW_FILTERS, SMOKE_SHADOWS, fillvalue="hard"):
        fields = {"shadow_filter": surface, "smoke_shadow": smoke, "shadow_map_size": 32}
        lights.append(ws.DistantLight(path=f"/World/{surface}_{smoke}", transform=matrix, **fields))
    _, frames = simulate(lit_by(*lights))
    check_finite(frames)
    brightest = frames[0].pictures["/World/Floor", "lit"].max()
    if DIRECTIONS[direction][1] < -0.1:
        assert brightest > 100
    elif DIRECTIONS[direction][1] >= 0.0:
        assert brightest == 0


def test_overhead_light_is_even(record_property):
    """A light straight above the middle of a floor lights it alike on all sides: nothing flips as directions do."""
    lamp = ws.PointLight(path="/World/Lamp", transform=at(0.0, 3.0, 0.0), intensity=60.0, radius=0.0)
    scene = replace(lit_by(lamp), domains=[], emitters=[], surfaces=small_plume(16).surfaces[:1])
    picture = simulate(scene)[1][0].pictures["/World/Floor", "lit"].astype(int)
    turned = [picture[::-1], picture[:, ::-1], picture.swapaxes(0, 1)]
    difference = max(int(np.abs(picture - other).max()) for other in turned)
    record_property("difference of mirrored pictures [codes of 255]", difference)
    assert picture.min() > 0
    assert difference <= 1


@pytest.mark.parametrize("model", FALLOFF_MODELS)
@pytest.mark.parametrize("height", [0.0, 1e-6, 1e-3])
def test_light_in_the_floor_is_bounded(model, height):
    """A light of any falloff on a point of the floor, or just above it: finite; the rest is lit from above alone."""
    fields = {"falloff_model": model, "falloff_end": 10.0, "radius": 0.0, "shadow_enable": False}
    lamp = ws.PointLight(path="/World/Lamp", transform=at(0.0, height, 0.0), **fields)
    mesh = ws.Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6), 12)
    floor = baked_at_points(ws.Surface(path="/World/Floor", mesh=mesh))
    scene = replace(lit_by(lamp), domains=[], emitters=[], surfaces=[floor], end=1)
    _, frames = simulate(scene)
    check_finite(frames)
    around = frames[0].pictures["/World/Floor", "irradiance"][np.any(mesh.points != 0.0, axis=1)]
    if height > 0.0:
        assert around.min() > 0.0
    else:
        assert around.max() == 0.0  # a light in the plane of the floor is seen from none of its other points


@pytest.mark.parametrize("method", SMOKE_SHADOWS)
def test_light_that_was_in_the_smoke(method):
    """A light that lies in the smoke at a time code before the first frame, or after the last: the run goes through."""
    path = ws.Samples([-5.0, 1.0, 2.0, 9.0], np.array([at(0, 1, 0), at(0, 4, 0), at(0.5, 4, 0), at(0.2, 1.2, 0)]))
    lamp = ws.PointLight(path="/World/Lamp", transform=path, smoke_shadow=method, shadow_map_size=32)
    check_finite(simulate(lit_by(lamp))[1])
