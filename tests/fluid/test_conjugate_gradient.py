"""Conjugate gradients: eigenmodes, the spectral solver, the energy norm, partly open faces, round-off, memory."""

import numpy as np
import pytest
from pressure_cases import CONJUGATE_GRADIENTS, closed_components, direct, solids_of, solve, solver_of, without_means
from staggered import ALL_SIDES, CLOSED, MIXED, OPEN, PERIODIC, face_shapes, laplacian_matrix, open_shares

from warp_smoke.fluid.pressure import PRESSURE_SOLVERS, PressureProblem
from warp_smoke.fluid.pressure.spectral import SpectralPressure


def box_solver(launcher, name, shape, sides, tolerance=1e-5, max_iterations=50):
    """A solver for a box without solids."""
    problem = PressureProblem(shape=shape, sides=sides, tolerance=tolerance, max_iterations=max_iterations)
    return PRESSURE_SOLVERS[name](launcher, problem)


@pytest.mark.parametrize("name", ["spectral_conjugate_gradient", "conjugate_gradient"])
@pytest.mark.parametrize("sides", [CLOSED, OPEN, MIXED], ids=["closed", "open", "mixed"])
def test_agrees_with_direct_solver_for_shares(launcher, name, sides):
    """Faces open in part, in a box without solid cells: the weighted operator is that of the sparse matrix."""
    rng = np.random.default_rng(10)
    shape = (8, 7, 9)
    shares = [rng.uniform(0.2, 1.0, s) for s in face_shapes(shape)]
    for axis, share in enumerate(shares):
        for end in (0, 1):
            np.moveaxis(share, axis, 0)[-end] *= sides[2 * axis + end] == "open"
    fluid, divergence = np.ones(shape), rng.standard_normal(shape)
    components = closed_components(fluid, sides)
    solver = solver_of(launcher, name, fluid, sides, 1e-6, 200, shares)
    found, status = solve(launcher, solver, divergence)
    np.testing.assert_allclose(found, direct(divergence, shares, sides, components), atol=1e-4)
    assert status.converged


@pytest.mark.parametrize("sides", ALL_SIDES, ids="".join)
def test_empty_box_takes_one_spectral_iteration(launcher, sides):
    """Without solids the spectral preconditioner is exact: one iteration, and the pressure is the spectral one."""
    shape = (8, 10, 9)
    divergence = np.random.default_rng(11).standard_normal(shape)
    found, status = solve(launcher, box_solver(launcher, "spectral_conjugate_gradient", shape, sides), divergence)
    expected, _ = solve(launcher, SpectralPressure(launcher, shape, sides), divergence)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert status.converged
    assert status.iterations == 1


def test_eigenmode_takes_one_spectral_iteration(launcher):
    """Π cos(k π (x + ½) / n) of a closed box is found to round-off in one iteration."""
    shape, waves = (12, 10, 16), (1, 2, 3)
    parts = [np.cos(np.pi * k * (np.arange(n) + 0.5) / n) for n, k in zip(shape, waves, strict=True)]
    value = sum(2.0 * np.cos(np.pi * k / n) - 2.0 for n, k in zip(shape, waves, strict=True))
    q = np.einsum("i,j,k", *parts)
    found, status = solve(launcher, box_solver(launcher, "spectral_conjugate_gradient", shape, CLOSED), value * q)
    np.testing.assert_allclose(found, q, atol=2e-5)
    assert status.iterations == 1


def test_iterates_of_two_eigenmodes(launcher):
    """From 0, the first iterate is α d with α = (d · d) / (d · L d); with two eigenvalues, the second is exact."""
    shape = (8, 12, 16)
    i, _, k = np.indices(shape) + 0.5
    modes = np.cos(2.0 * np.pi * i / 8), 3.0 * np.cos(2.0 * np.pi * 3 * k / 16)
    values = [2.0 * np.cos(2.0 * np.pi * wave / n) - 2.0 for wave, n in ((1, 8), (3, 16))]
    d = sum(value * mode for value, mode in zip(values, modes, strict=True))
    squares = [value**2 * np.sum(mode**2) for value, mode in zip(values, modes, strict=True)]
    alpha = sum(squares) / np.dot(values, squares)
    for limit, expected in ((1, alpha * d), (2, sum(modes))):
        solver = box_solver(launcher, "conjugate_gradient", shape, PERIODIC, 1e-5, limit)
        found, status = solve(launcher, solver, d)
        np.testing.assert_allclose(found, expected, atol=1e-5)
        assert status.iterations == limit
        assert status.converged == (limit == 2)


@pytest.mark.parametrize("name", CONJUGATE_GRADIENTS)
def test_error_falls_in_the_energy_norm(launcher, name):
    """Each iterate has less error √(e · L e) than the one before, so the last is the best when iterations run out.

    Then `converged` is False and the residual is reported as it is.
    """
    rng = np.random.default_rng(12)
    fluid = (rng.random((10, 12, 11)) > 0.3).astype(np.float64)
    divergence = fluid * rng.standard_normal(fluid.shape)
    shares = open_shares(fluid, OPEN)
    matrix = laplacian_matrix(shares, OPEN)
    exact = direct(divergence, shares, OPEN, closed_components(fluid, OPEN))
    source = without_means(divergence, closed_components(fluid, OPEN))
    errors = []
    for limit in range(1, 7):
        found, status = solve(launcher, solver_of(launcher, name, fluid, OPEN, 1e-7, limit), divergence)
        error = (found - exact).ravel()
        errors.append(np.sqrt(-error @ (matrix @ error)))
        residual = source.ravel() - matrix @ found.ravel()
        assert status.iterations == limit
        assert not status.converged
        # Each cell's residual is a sum of a dozen numbers in float32, about as large as |d|.
        close = {"rel": 1e-3, "abs": 12 * 2.0**-24}
        assert status.max_residual == pytest.approx(np.abs(residual).max() / np.abs(divergence).max(), **close)
        assert status.rms_residual == pytest.approx(np.linalg.norm(residual) / np.linalg.norm(divergence), **close)
    assert np.all(np.diff(errors) < 0)


@pytest.mark.parametrize("name", CONJUGATE_GRADIENTS)
def test_smooth_source_stops_at_round_off(launcher, name):
    """Where float32 cannot hold a pressure with the residual asked for, the solver stops there and reports it."""
    shape = (64, 4, 4)
    q = np.cos(np.pi * (np.arange(64) + 0.5) / 64)[:, None, None] * np.ones(shape)
    value = 2.0 * np.cos(np.pi / 64) - 2.0
    solver = box_solver(launcher, name, shape, CLOSED, 1e-9, 500)
    found, status = solve(launcher, solver, value * q)
    np.testing.assert_allclose(found, q, atol=1e-4)
    assert status.converged
    assert status.iterations < 100
    # 34 half ulps of a pressure of 1, over the largest |d| = 0.0024.
    assert 1e-9 < status.max_residual <= 34 * 2**-24 / abs(value)


@pytest.mark.parametrize("name", CONJUGATE_GRADIENTS)
def test_moving_solids_need_no_more_memory(launcher, name):
    """Solids that change among as many closed cells allocate nothing, and an open box nothing for components."""
    first = np.ones((6, 8, 40))
    first[:, :, 10] = 0.0
    for sides in (CLOSED, OPEN):
        solids = solids_of(launcher, first, open_shares(first, sides))
        problem = PressureProblem(shape=first.shape, sides=sides, solids=solids, tolerance=1e-4)
        solver = PRESSURE_SOLVERS[name](launcher, problem)
        rng = np.random.default_rng(18)
        solve(launcher, solver, first * rng.standard_normal(first.shape))
        for place in (20, 30):
            fluid = np.roll(first, place - 10, axis=2)
            divergence = launcher.array((fluid * rng.standard_normal(fluid.shape)).astype(np.float32), "test")
            pressure = launcher.zeros(fluid.shape, "test")
            solids.fluid.assign(fluid.astype(np.float32))
            for array, share in zip((solids.wx, solids.wy, solids.wz), open_shares(fluid, sides), strict=True):
                array.assign(share)
            solids.changes += 1
            before = launcher.allocated.copy()
            assert solver.solve(divergence, pressure).converged
            assert launcher.allocated == before
