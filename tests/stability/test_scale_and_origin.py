"""The same scene in another unit, at another place, with another axis up: the same smoke and the same pictures."""

from dataclasses import replace

import numpy as np
import pytest
from hard_cases import BALL, field_difference, picture_difference, placed_by, simulate, small_plume
from scenes import at

import warp_smoke as ws

# Differences of single precision's rounding grow in a few steps of a plume by about ten.
ROUND_OFF = 2e-5
# Of 255: a shadow's edge may fall on the other side of a sample.
CODES = 2


@pytest.fixture(scope="module", params=[False, True], ids=["plume", "around a ball"])
def scene(request) -> ws.Scene:
    """A scene with all kinds of shadows, with and without a solid."""
    plume = small_plume(vorticity=0.3, buoyancy_density=0.5, extinction=6.0)
    return replace(plume, colliders=[BALL] if request.param else [], time_codes_per_second=4.0)


@pytest.fixture(scope="module")
def frames(scene) -> list[ws.Frame]:
    """The scene in metres, at the origin, with Y up."""
    return simulate(scene)[1]


def check_same(one: list[ws.Frame], two: list[ws.Frame], record_property) -> None:
    """Compares smoke and pictures."""
    density, codes = field_difference(one, two), picture_difference(one, two)
    record_property("difference of density", density)
    record_property("difference of pictures [codes of 255]", codes)
    assert density < ROUND_OFF
    assert field_difference(one[:1], one[-1:]) > 0.1  # there is something to see
    assert codes <= CODES


@pytest.mark.parametrize("metres", [0.001, 0.01, 10.0, 1000.0])
def test_unit(scene, frames, metres, record_property):
    """MetersPerUnit from 0.001 to 1000, all lengths in that unit: the same smoke, shadows and light."""
    scale = 1.0 / metres
    other = placed_by(scene, np.diag([scale, scale, scale, 1.0]))
    lights = [
        # Light falls off with the square of the distance in units.
        replace(light, intensity=light.intensity * scale**2, radius=light.radius * scale)
        if isinstance(light, ws.PointLight)
        else light
        for light in other.lights
    ]
    check_same(frames, simulate(replace(other, lights=lights, meters_per_unit=metres))[1], record_property)


@pytest.mark.parametrize("distance", [1e3, 1e6, -1e6])
def test_place(scene, frames, distance, record_property):
    """A thousand and a million units from the origin: as at the origin."""
    other = placed_by(scene, at(distance, -distance, 0.5 * distance))
    check_same(frames, simulate(other)[1], record_property)


_TURNED = np.eye(4)
_TURNED[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(0.7), -np.sin(0.7), np.sin(0.7), np.cos(0.7)
TURNS = {"X": np.eye(4)[[2, 0, 1, 3]], "Y": _TURNED, "Z": np.eye(4)[[1, 2, 0, 3]]}


@pytest.mark.parametrize("axis", TURNS)
def test_up_axis(scene, axis, record_property):
    """Another axis up and everything turned with it, or turned aslant about Y: the same.

    Shadows are by rays to all of each light, since texels of shadow maps lie along the world's axes.
    """
    scene = replace(scene, lights=[replace(light, shadow_filter="area") for light in scene.lights])
    turned = replace(placed_by(scene, TURNS[axis]), up_axis=axis)
    check_same(simulate(scene)[1], simulate(turned)[1], record_property)
