"""Vorticity confinement: exact curl, a force that spins vortices up, and a cap that kinetic energy never exceeds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.measures import Measures
from warp_smoke.fluid.vorticity import VorticityConfinement, capped_scale, measure_vorticity

CLOSED = ("closed",) * 6
SHAPE = (10, 11, 12)


@pytest.mark.parametrize("shape", [SHAPE, (2, 3, 2)])
def test_solid_rotation(launcher, sample_velocity, shape):
    """The curl of Ω × r is 2 Ω in every cell, those at the sides included, to round-off."""
    spin, h = np.array([0.5, -1.0, 2.0]), 0.25
    velocity = sample_velocity(lambda x, y, z: np.cross(spin, h * np.stack([x, y, z], -1)).transpose(3, 0, 1, 2), shape)
    *vorticity, size = (launcher.zeros(shape, "test") for _ in range(4))
    measure_vorticity(launcher, velocity, h, vorticity, size)
    for component, along in zip(vorticity, spin, strict=True):
        np.testing.assert_allclose(component.numpy(), 2 * along, atol=2e-5)
    np.testing.assert_allclose(size.numpy(), 2 * np.linalg.norm(spin), rtol=1e-5)


def _vortex(x, y, z):
    """A round vortex about the middle, with a core of two cells, turning along k."""
    dx, dy = x - 4.5, y - 5.0
    speed = np.exp(-(dx**2 + dy**2) / 8)
    return -dy * speed, dx * speed, 0 * z


def test_force_spins_a_vortex_up(launcher, upload, sample_velocity):
    """Each face gains dt ε h (N × ω) of the cells beside it, worked out in NumPy; that does work on the vortex."""
    h, strength, dt = 0.5, 0.7, 0.25
    velocity = sample_velocity(_vortex, SHAPE)
    before = [component.numpy().copy() for component in velocity]
    *vorticity, size = (launcher.zeros(SHAPE, "test") for _ in range(4))
    measure_vorticity(launcher, velocity, h, vorticity, size)
    omega = np.stack([component.numpy() for component in vorticity], axis=-1).astype(float)
    gradient = np.stack(np.gradient(size.numpy().astype(float)), axis=-1)
    length = np.linalg.norm(gradient, axis=-1, keepdims=True)
    force = np.zeros_like(omega)
    inside = (slice(1, -1),) * 3
    force[inside] = strength * h * np.cross(gradient / np.where(length > 0, length, 1.0), omega)[inside]

    measures = Measures(launcher, SHAPE)
    _, energy = measures.motion(velocity)
    assert VorticityConfinement(launcher, SHAPE, CLOSED, h, measures).add(velocity, strength, dt, 1e9) == 1.0
    assert measures.motion(velocity)[1] > energy
    for axis, (component, old) in enumerate(zip(velocity, before, strict=True)):
        cells = np.moveaxis(force[..., axis], axis, 0)
        expected = np.zeros(face_shape(SHAPE, axis))
        np.moveaxis(expected, axis, 0)[1:-1] = 0.5 * dt * (cells[1:] + cells[:-1])
        # Where |ω| is almost level, float32 cannot tell which way is up: those cells decide the tolerance.
        np.testing.assert_allclose(component.numpy() - old, expected, atol=1e-4)


FINITE = st.floats(-1e6, 1e6, allow_subnormal=False)


@given(work=FINITE, square=st.floats(0, 1e6, allow_subnormal=False), cap=st.floats(0, 1e6, allow_subnormal=False))
def test_capped_scale(work, square, cap):
    """The largest s in [0, 1] with s A + s² B ≤ cap: it fits, and either it is 1 or a little more would not fit."""
    s = capped_scale(work, square, cap)
    assert 0.0 <= s <= 1.0
    size = abs(work) + square + cap
    assert s * work + s * s * square <= cap + 1e-12 * size
    if s < 1.0:
        more = min(1.0, s * (1 + 1e-6) + 1e-9)
        assert more * work + more * more * square >= cap - 1e-12 * size


@pytest.mark.parametrize("strength", [0.0, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("cap", [0.0, 1e-3, 1.0])
def test_gain_is_capped(launcher, upload, strength, cap):
    """Whatever ε, kinetic energy grows by no more than the cap; a cap of 0 leaves no growth at all."""
    rng = np.random.default_rng(1)
    velocity = []
    for axis in range(3):
        component = rng.standard_normal(face_shape(SHAPE, axis))
        np.moveaxis(component, axis, 0)[[0, -1]] = 0.0
        velocity.append(upload(component))
    measures = Measures(launcher, SHAPE)
    _, before = measures.motion(velocity)
    scale = VorticityConfinement(launcher, SHAPE, CLOSED, 0.1, measures).add(velocity, strength, 0.04, cap)
    _, after = measures.motion(velocity)
    assert after - before <= cap + 1e-6 * before  # energies are sums of float32 squares
    assert 0.0 <= scale <= 1.0
    if strength * cap:
        assert after != before


def test_still_and_uniform_flows_feel_nothing(launcher, sample_velocity):
    """0 / 0 is 0: no force where |ω| has no gradient."""
    measures = Measures(launcher, SHAPE)
    confinement = VorticityConfinement(launcher, SHAPE, CLOSED, 0.1, measures)
    for flow in ((0.0, 0.0, 0.0), (1.0, -2.0, 3.0)):
        velocity = sample_velocity(lambda x, y, z, flow=flow: flow, SHAPE)
        confinement.add(velocity, 10.0, 0.1, 1e9)
        for component, value in zip(velocity, flow, strict=True):
            np.testing.assert_array_equal(component.numpy(), value)
