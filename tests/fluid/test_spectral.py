"""Spectral pressure: exact discrete eigenmodes, projections, closed boxes, odd shapes, both kinds of transforms."""

import numpy as np
import pytest
from staggered import ALL_SIDES, CLOSED, MIXED, OPEN, PERIODIC, PERIODIC_SIDES, SLAB, no_velocity, random_velocity

from warp_smoke.fluid.operators import close_sides, measure_divergence, subtract_gradient
from warp_smoke.fluid.pressure.spectral import SpectralPressure
from warp_smoke.launch import Launcher


def mode(n, m, lower, upper):
    """The m-th discrete eigenfunction between two sides at the centres of n cells, and its eigenvalue −λ of L."""
    x = (np.arange(n) + 0.5) / n
    if lower == "periodic":
        wave, values = 2 * m, np.cos(2 * np.pi * m * x + 1.0)
    elif lower == upper == "closed":
        wave, values = m, np.cos(np.pi * m * x)
    elif lower == upper == "open":
        wave, values = m + 1, np.sin(np.pi * (m + 1) * x)
    elif lower == "closed":
        wave, values = m + 0.5, np.cos(np.pi * (m + 0.5) * x)
    else:
        wave, values = m + 0.5, np.sin(np.pi * (m + 0.5) * x)
    return values, 2.0 * np.cos(np.pi * wave / n) - 2.0


def mode_product(shape, modes, sides):
    """Π of one mode along each axis, and the eigenvalue of L."""
    parts = [mode(n, m, *sides[2 * a : 2 * a + 2]) for a, (n, m) in enumerate(zip(shape, modes, strict=True))]
    q = np.einsum("i,j,k", *(values for values, _ in parts))
    return q, sum(value for _, value in parts)


def solve(launcher, divergence, sides):
    """The pressure as an array, and the status."""
    d, q = launcher.array(divergence.astype(np.float32), "test"), launcher.zeros(divergence.shape, "test")
    status = SpectralPressure(launcher, divergence.shape, sides).solve(d, q)
    return q.numpy(), status


def project(launcher, solver, sides, velocity, divergence, pressure):
    """Projects in place; returns the largest divergence after, relative to that before."""
    close_sides(launcher, sides, velocity)
    measure_divergence(launcher, velocity, divergence)
    before = np.abs(divergence.numpy()).max()
    solver.solve(divergence, pressure)
    subtract_gradient(launcher, pressure, sides, velocity)
    measure_divergence(launcher, velocity, divergence)
    return np.abs(divergence.numpy()).max() / before


@pytest.mark.parametrize("sides", ALL_SIDES + PERIODIC_SIDES, ids="-".join)
def test_eigenmodes_are_exact(launcher, sides):
    """L q = λ q for the sines and cosines between any sides: the solver returns q from λ q, low and high modes."""
    shape = (5, 7, 6)
    for modes in ((1, 0, 2), (4, 6, 5), (0, 3, 1)):
        q, value = mode_product(shape, modes, sides)
        found, status = solve(launcher, value * q, sides)
        # Round-off of float32, larger by the condition number (up to 35 here).
        np.testing.assert_allclose(found, q, atol=5e-6)
        assert status.converged
        assert status.iterations == 1


@pytest.mark.parametrize("sides", ALL_SIDES + PERIODIC_SIDES, ids="-".join)
def test_projection_removes_divergence(launcher, sides):
    """Random velocity is free of divergence after the projection, whatever the sides.

    Pressure in float32 has a relative error of 6e-8, and L multiplies the error of its largest entry (here about as
    large as d itself) by up to 12: 1e-6 of d. Ten times that is allowed.
    """
    shape = (16, 15, 14)
    solver = SpectralPressure(launcher, shape, sides)
    divergence, pressure = launcher.zeros(shape, "test"), launcher.zeros(shape, "test")
    velocity = random_velocity(launcher, shape, sides=sides)
    assert project(launcher, solver, sides, velocity, divergence, pressure) <= 1e-5
    for axis, component in enumerate(velocity):
        if sides[2 * axis] == "periodic":
            ends = np.moveaxis(component.numpy(), axis, 0)
            np.testing.assert_array_equal(ends[0], ends[-1])


@pytest.mark.parametrize("sides", [CLOSED, OPEN, ("open", "open", "closed", "open", "open", "open")])
def test_jet_is_free_of_divergence(launcher, sides):
    """A jet of 4 cells a step, set off in still air, keeps max |∇·u| dt below 1e-5: the worst first step of a plume."""
    n = 48
    velocity, pressure = no_velocity(launcher, (n, n, n)), launcher.zeros((n, n, n), "test")
    x, y, z = (np.indices(velocity[1].shape) + 0.5) / n
    velocity[1].assign(
        (4 * np.exp(-((x - 0.5) ** 2 + (z - 0.5) ** 2) / 0.01 - ((y - 0.3) / 0.2) ** 2)).astype(np.float32)
    )
    divergence = launcher.zeros((n, n, n), "test")
    project(launcher, SpectralPressure(launcher, (n, n, n), sides), sides, velocity, divergence, pressure)
    assert np.abs(divergence.numpy()).max() < 1e-5


def test_projection_is_idempotent(launcher):
    """A second projection changes nothing beyond round-off."""
    shape = (24, 20, 16)
    solver = SpectralPressure(launcher, shape, MIXED)
    divergence, pressure = launcher.zeros(shape, "test"), launcher.zeros(shape, "test")
    velocity = random_velocity(launcher, shape)
    project(launcher, solver, MIXED, velocity, divergence, pressure)
    once = [u.numpy().copy() for u in velocity]
    project(launcher, solver, MIXED, velocity, divergence, pressure)
    for u, before in zip(velocity, once, strict=True):
        # What is left of the divergence (1e-6), summed along the box.
        np.testing.assert_allclose(u.numpy(), before, atol=1e-5)


def test_closed_box_removes_the_mean(launcher):
    """In a closed box a net divergence cannot be met: it is reported and left, and the mean pressure is 0."""
    shape = (12, 10, 14)
    q, value = mode_product(shape, (1, 2, 3), CLOSED)
    found, status = solve(launcher, value * q + 0.25, CLOSED)
    np.testing.assert_allclose(found, q, atol=2e-5)
    assert status.imbalance == pytest.approx(0.25, rel=1e-6)
    assert status.max_residual < 1e-5
    assert abs(found.mean(dtype=np.float64)) < 1e-7


def test_uniform_divergence_in_a_closed_box_gives_no_pressure(launcher):
    """Nothing but the mean: pressure stays 0 and the imbalance is all there is."""
    found, status = solve(launcher, np.full((6, 5, 4), 3.0), CLOSED)
    np.testing.assert_allclose(found, 0.0, atol=1e-6)
    assert status.imbalance == pytest.approx(3.0)
    assert status.max_residual < 1e-6


def test_no_divergence_gives_no_pressure(launcher):
    """0 in, 0 out, residuals 0 and not NaN."""
    found, status = solve(launcher, np.zeros((6, 5, 4)), MIXED)
    np.testing.assert_array_equal(found, 0.0)
    assert status.max_residual == status.rms_residual == 0.0
    assert status.converged


@pytest.mark.parametrize(
    "sides", [CLOSED, OPEN, MIXED, PERIODIC, SLAB], ids=["closed", "open", "mixed", "periodic", "slab"]
)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 9, 1), (7, 1, 1), (1, 1, 8), (2, 1, 3), (31, 17, 5), (3, 1, 300)])
def test_any_shape(launcher, shape, sides):
    """Thin, long and prime boxes are solved too: the residual, 0 where it has to be, is within round-off."""
    divergence = np.random.default_rng(1).standard_normal(shape)
    _, status = solve(launcher, divergence, sides)
    # The pressure of a long box is larger than d by its condition, (300 / π)²: so is its round-off.
    assert status.max_residual < 1e-6 * max(1.0, (max(shape) / np.pi) ** 2)
    if "open" not in sides:
        assert status.imbalance == pytest.approx(abs(divergence.mean()), rel=1e-4, abs=1e-7)


def test_reported_residual_is_that_of_the_projected_velocity(launcher):
    """The status says what a measurement of the velocity after the projection says."""
    shape = (18, 16, 20)
    x = (np.arange(18) + 0.5) / 18
    d = np.broadcast_to(np.cos(np.pi * x)[:, None, None], shape)  # the smoothest, so with the largest residual
    found, status = solve(launcher, d, CLOSED)
    residual = d.astype(np.float32).astype(np.float64)
    for axis in range(3):
        ghosts = [(int(axis == other),) * 2 for other in range(3)]
        residual -= np.diff(np.pad(found.astype(np.float64), ghosts, "edge"), n=2, axis=axis)
    # Both are round-off; they differ by the order of the sums in float32.
    assert status.max_residual == pytest.approx(np.abs(residual).max() / np.abs(d).max(), rel=0.5)
    assert status.rms_residual == pytest.approx(np.sqrt(np.mean(residual**2) / np.mean(d**2)), rel=0.5)


def test_second_order_in_space(launcher):
    """The pressure of a smooth source converges to that of ∇²p = f with order 2, between closed and open sides."""
    sides = ("closed", "closed", "open", "open", "closed", "open")
    errors = []
    for n in (8, 16, 32):
        x = (np.arange(n) + 0.5) / n
        p = np.einsum("i,j,k", np.cos(np.pi * x), np.sin(np.pi * x), np.cos(1.5 * np.pi * x))
        found, _ = solve(launcher, -(1.0 + 1.0 + 2.25) * np.pi**2 * p / n**2, sides)
        errors.append(np.abs(found - p).max())
    slope = -np.polyfit(np.log([8, 16, 32]), np.log(errors), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.05)


@pytest.mark.usefixtures("divided_launches")
@pytest.mark.parametrize("sides", [CLOSED, MIXED], ids=["closed", "mixed"])
def test_same_bits_for_any_number_of_threads(sides):
    """1, 2 and 7 threads give bit-equal pressures and the same status, scipy's threads included."""
    divergence = np.random.default_rng(3).standard_normal((67, 61, 35)).astype(np.float32)
    results = []
    for threads in (1, 2, 7):
        results.append(solve(Launcher("cpu", threads), divergence, sides))
    for found, status in results[1:]:
        np.testing.assert_array_equal(found.view(np.int32), results[0][0].view(np.int32))
        assert status == results[0][1]


def test_solving_allocates_nothing(launcher):
    """All memory is taken when the solver is made."""
    shape = (8, 8, 8)
    solver = SpectralPressure(launcher, shape, MIXED)
    divergence, pressure = launcher.zeros(shape, "test"), launcher.zeros(shape, "test")
    before = launcher.allocated.copy()
    solver.solve(divergence, pressure)
    assert launcher.allocated == before
