"""Buoyancy: free fall to the bit, rest where pressure can balance it, any direction of up."""

import numpy as np
import pytest

from warp_smoke.fluid.forces import Buoyancy
from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.operators import measure_divergence, subtract_gradient
from warp_smoke.fluid.pressure.spectral import SpectralPressure

SHAPE = (6, 7, 8)


def _still(launcher):
    return tuple(launcher.zeros(face_shape(SHAPE, axis), "test") for axis in range(3))


@pytest.mark.parametrize("up", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.5, 0.25, -0.75)])
def test_uniform_heat_falls_freely(launcher, upload, up):
    """Before projection every face that may move has u = β (T − T_ambient) dt up, in one step."""
    velocity = _still(launcher)
    Buoyancy(launcher, SHAPE, ("open",) * 6, up).add(upload(np.full(SHAPE, 5.0)), 3.0, 4.0 * 0.25, velocity)
    for component, along in zip(velocity, up, strict=True):
        np.testing.assert_array_equal(component.numpy(), 4.0 * 0.25 * (5.0 - 3.0) * along)


def test_zero_components_of_up_cost_nothing(launcher, upload):
    """Only faces across axes that up leans to are launched."""
    before = launcher.launches["_accelerate"]
    Buoyancy(launcher, SHAPE, ("closed",) * 6, (0.0, 0.0, 1.0)).add(upload(np.ones(SHAPE)), 0.0, 1.0, _still(launcher))
    assert launcher.launches["_accelerate"] == before + 1


def test_between_cells_it_is_their_mean(launcher, upload):
    """Faces between cells get the mean of both, those on open sides their one cell, on closed sides nothing."""
    scalar = np.random.default_rng(1).uniform(0, 1, SHAPE).astype(np.float32)
    velocity = _still(launcher)
    sides = ("open", "closed", "closed", "open", "open", "open")
    Buoyancy(launcher, SHAPE, sides, (1.0, 1.0, 1.0)).add(upload(scalar), 0.0, 2.0, velocity)
    for axis, component in enumerate(velocity):
        faces, cells = np.moveaxis(component.numpy(), axis, 0), np.moveaxis(scalar, axis, 0)
        np.testing.assert_array_equal(faces[1:-1], cells[1:] + cells[:-1])
        for side, end in ((2 * axis, 0), (2 * axis + 1, -1)):
            np.testing.assert_array_equal(faces[end], 2 * cells[end] if sides[side] == "open" else 0.0)


def _project(launcher, sides, velocity):
    divergence, pressure = launcher.zeros(SHAPE, "test"), launcher.zeros(SHAPE, "test")
    measure_divergence(launcher, velocity, divergence)
    SpectralPressure(launcher, SHAPE, sides).solve(divergence, pressure)
    subtract_gradient(launcher, pressure, sides, velocity)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("top", ["closed", "open"])
def test_layers_stay_still(launcher, upload, axis, top):
    """Where heat is a function of height alone, u = 0 after projection: pressure balances it, below an open top too.

    There the face on the side has the heat of its one cell, and p = 0.
    """
    sides = ["closed"] * 6
    sides[2 * axis + 1] = top
    height = np.arange(SHAPE[axis]).reshape([-1 if a == axis else 1 for a in range(3)])
    heat = np.broadcast_to(1.0 + 0.3 * height**2, SHAPE)
    velocity = _still(launcher)
    Buoyancy(launcher, SHAPE, sides, tuple(np.eye(3)[axis])).add(upload(heat), 0.0, 1.0, velocity)
    _project(launcher, tuple(sides), velocity)
    for component in velocity:
        np.testing.assert_allclose(component.numpy(), 0.0, atol=1e-6 * heat.sum(axis=axis).max())


def test_uniform_heat_stays_still_in_a_closed_box(launcher, upload):
    """With up between the axes, too."""
    sides, velocity = ("closed",) * 6, _still(launcher)
    Buoyancy(launcher, SHAPE, sides, (0.6, 0.48, -0.64)).add(upload(np.ones(SHAPE)), 0.0, 1.0, velocity)
    _project(launcher, sides, velocity)
    for component in velocity:
        np.testing.assert_allclose(component.numpy(), 0.0, atol=1e-6 * max(SHAPE))
