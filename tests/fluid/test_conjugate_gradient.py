"""Conjugate gradients against a sparse direct solver, the spectral one and eigenmodes; pockets, status, energy norm."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.ndimage
import scipy.sparse.linalg
from staggered import ALL_SIDES, CLOSED, MIXED, OPEN, face_shapes, laplacian_matrix, open_shares

from warp_smoke.fluid.pressure import PRESSURE_SOLVERS, PressureProblem
from warp_smoke.fluid.pressure.conjugate_gradient import ConjugateGradientPressure
from warp_smoke.fluid.pressure.spectral import SpectralPressure
from warp_smoke.launch import Launcher


def solids_of(launcher, fluid, shares):
    """Solids as the solver sees them."""
    wx, wy, wz = (launcher.array(share.astype(np.float32), "test") for share in shares)
    return SimpleNamespace(fluid=launcher.array(fluid.astype(np.float32), "test"), wx=wx, wy=wy, wz=wz, changes=1)


def solver_of(launcher, fluid, sides, tolerance=1e-5, max_iterations=200):
    """A solver around the solid cells (0) of a mask."""
    solids = solids_of(launcher, fluid, open_shares(fluid, sides))
    return ConjugateGradientPressure(launcher, fluid.shape, sides, solids, tolerance, max_iterations)


def solve(launcher, solver, divergence, guess=None):
    """The pressure as an array, and the status."""
    d = launcher.array(divergence.astype(np.float32), "test")
    q = launcher.array((np.zeros(d.shape) if guess is None else guess).astype(np.float32), "test")
    status = solver.solve(d, q)
    return q.numpy().copy(), status


def closed_components(fluid, sides):
    """Masks of the bodies of fluid that touch no open side, found by filling the outside with fluid."""
    ghosts = [tuple(int(sides[2 * axis + end] == "open") for end in (0, 1)) for axis in range(3)]
    outside = np.pad(np.zeros(fluid.shape), ghosts, constant_values=1)
    both = np.pad(fluid, ghosts) + outside
    labels, count = scipy.ndimage.label(both)
    inside = labels[tuple(slice(low, low + n) for (low, _), n in zip(ghosts, fluid.shape, strict=True))]
    touched = set(np.unique(labels[outside > 0]))
    return [inside == label for label in range(1, count + 1) if label not in touched]


def without_means(field, components):
    """The field with its mean over each component removed."""
    field = field.astype(np.float64).copy()
    for mask in components:
        field[mask] -= field[mask].mean()
    return field


def direct(divergence, shares, sides, components):
    """The pressure by sparse LU in float64, with mean 0 on closed components; solid cells are 0."""
    matrix = laplacian_matrix(shares, sides).tolil()
    right = without_means(divergence, components)
    for cell in np.flatnonzero(matrix.diagonal() == 0):
        matrix[cell, cell] = 1.0  # solid, or alone
        right.ravel()[cell] = 0.0
    for mask in components:
        cells = np.flatnonzero(mask)
        matrix[cells[0], :] = 0.0
        matrix[cells[0], cells] = 1.0  # stands for an equation that follows from the others
        right.ravel()[cells[0]] = 0.0
    return scipy.sparse.linalg.spsolve(matrix.tocsc(), right.ravel()).reshape(divergence.shape)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("sides", [CLOSED, OPEN, MIXED], ids=["closed", "open", "mixed"])
def test_agrees_with_direct_solver_among_random_solids(launcher, sides, seed):
    """In a random maze with pockets and single cells, pressure and imbalance are those of sparse LU in float64."""
    rng = np.random.default_rng(seed)
    fluid = (rng.random((9, 8, 10)) > (0.15, 0.45)[seed % 2]).astype(np.float64)
    divergence = fluid * rng.standard_normal(fluid.shape)
    components = closed_components(fluid, sides)
    expected = direct(divergence, open_shares(fluid, sides), sides, components)
    found, status = solve(launcher, solver_of(launcher, fluid, sides, 1e-6), divergence)
    # The residual is 1e-6 of |d| ≈ 4, and the condition of such mazes some hundreds.
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert status.converged
    assert status.imbalance == pytest.approx(
        max((abs(divergence[mask].mean()) for mask in components), default=0.0), abs=1e-6
    )


@pytest.mark.parametrize("sides", [CLOSED, OPEN, MIXED], ids=["closed", "open", "mixed"])
def test_agrees_with_direct_solver_for_shares(launcher, sides):
    """Faces open in part, in a box without solid cells: the weighted operator is that of the sparse matrix."""
    rng = np.random.default_rng(10)
    shape = (8, 7, 9)
    shares = [rng.uniform(0.2, 1.0, s) for s in face_shapes(shape)]
    for axis, share in enumerate(shares):
        for end in (0, 1):
            np.moveaxis(share, axis, 0)[-end] *= sides[2 * axis + end] == "open"
    fluid, divergence = np.ones(shape), rng.standard_normal(shape)
    components = closed_components(fluid, sides)
    solver = ConjugateGradientPressure(launcher, shape, sides, solids_of(launcher, fluid, shares), 1e-6, 200)
    found, status = solve(launcher, solver, divergence)
    np.testing.assert_allclose(found, direct(divergence, shares, sides, components), atol=1e-4)
    assert status.converged


@pytest.mark.parametrize("sides", ALL_SIDES, ids="".join)
def test_empty_box_agrees_with_spectral(launcher, sides):
    """Without solids there is one iteration, and the pressure is the spectral one."""
    shape = (8, 10, 9)
    divergence = np.random.default_rng(11).standard_normal(shape)
    found, status = solve(launcher, ConjugateGradientPressure(launcher, shape, sides, None, 1e-5, 50), divergence)
    expected, _ = solve(launcher, SpectralPressure(launcher, shape, sides), divergence)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert status.converged
    assert status.iterations == 1


def test_eigenmode_takes_one_iteration(launcher):
    """Π cos(k π (x + ½) / n) of a closed box is found to round-off in one iteration."""
    shape, waves = (12, 10, 16), (1, 2, 3)
    parts = [np.cos(np.pi * k * (np.arange(n) + 0.5) / n) for n, k in zip(shape, waves, strict=True)]
    value = sum(2.0 * np.cos(np.pi * k / n) - 2.0 for n, k in zip(shape, waves, strict=True))
    q = np.einsum("i,j,k", *parts)
    found, status = solve(launcher, ConjugateGradientPressure(launcher, shape, CLOSED, None, 1e-5, 50), value * q)
    np.testing.assert_allclose(found, q, atol=2e-5)
    assert status.iterations == 1


def test_error_falls_in_the_energy_norm(launcher):
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
    for limit in range(1, 9):
        found, status = solve(launcher, solver_of(launcher, fluid, OPEN, 1e-6, limit), divergence)
        error = (found - exact).ravel()
        errors.append(np.sqrt(-error @ (matrix @ error)))
        residual = source.ravel() - matrix @ found.ravel()
        assert status.iterations == limit
        assert not status.converged
        assert status.max_residual == pytest.approx(np.abs(residual).max() / np.abs(divergence).max(), rel=1e-3)
        assert status.rms_residual == pytest.approx(np.linalg.norm(residual) / np.linalg.norm(divergence), rel=1e-3)
    assert np.all(np.diff(errors) < 0)


def test_good_guess_saves_iterations(launcher):
    """The solution as first guess takes none, a guess that is nearly right fewer than none at all."""
    rng = np.random.default_rng(13)
    fluid = (rng.random((10, 12, 11)) > 0.3).astype(np.float64)
    divergence = fluid * rng.standard_normal(fluid.shape)
    solver = solver_of(launcher, fluid, MIXED, 1e-4)
    found, cold = solve(launcher, solver, divergence)
    _, again = solve(launcher, solver, divergence, found)
    assert again.iterations == 0
    assert again.converged
    _, warm = solve(launcher, solver, 1.01 * divergence, found)
    assert 0 < warm.iterations < cold.iterations


def test_pocket_keeps_its_imbalance_to_itself(launcher):
    """Net divergence in an enclosed pocket is left there and reported; the open fluid around it is still solved."""
    fluid = np.ones((9, 9, 9))
    fluid[2:7, 2:7, 2:7] = 0.0
    fluid[3:6, 3:6, 3:6] = 1.0
    divergence = np.zeros(fluid.shape)
    divergence[4, 4, 4] = 2.7
    divergence[0, 4, 4] = 1.0
    found, status = solve(launcher, solver_of(launcher, fluid, OPEN), divergence)
    assert status.converged
    assert status.imbalance == pytest.approx(0.1)
    assert abs(found[3:6, 3:6, 3:6].mean()) < 1e-7
    matrix = laplacian_matrix(open_shares(fluid, OPEN), OPEN)
    left = divergence - (matrix @ found.astype(np.float64).ravel()).reshape(fluid.shape)
    np.testing.assert_allclose(left[3:6, 3:6, 3:6], 0.1, atol=1e-5 * 2.7)
    left[3:6, 3:6, 3:6] = 0.0
    np.testing.assert_allclose(left, 0.0, atol=1e-5 * 2.7)


@pytest.mark.parametrize("cells", [0, 1], ids=["none", "one"])
def test_hardly_any_fluid(launcher, cells):
    """With no fluid at all, or one enclosed cell, there is no pressure to solve for and nothing fails."""
    fluid = np.zeros((5, 4, 6))
    fluid.ravel()[57 : 57 + cells] = 1.0
    found, status = solve(launcher, solver_of(launcher, fluid, OPEN), 3.0 * fluid)
    np.testing.assert_array_equal(found, 0.0)
    assert status.converged
    assert status.iterations == 0
    assert status.imbalance == pytest.approx(3.0 * cells)


def test_no_divergence_gives_no_pressure(launcher):
    """0 in, 0 out, without iterations or NaN, also after a guess that is wrong."""
    fluid = (np.random.default_rng(14).random((6, 5, 7)) > 0.3).astype(np.float64)
    found, status = solve(launcher, solver_of(launcher, fluid, OPEN), np.zeros(fluid.shape))
    np.testing.assert_array_equal(found, 0.0)
    assert status.converged
    assert status.iterations == 0
    assert status.max_residual == status.rms_residual == 0.0
    found, status = solve(launcher, solver_of(launcher, fluid, OPEN), np.zeros(fluid.shape), fluid)
    np.testing.assert_allclose(found, 0.0, atol=1e-5)
    assert status.converged


def test_smooth_source_stops_at_round_off(launcher):
    """Where float32 cannot hold a pressure with the residual asked for, the solver stops there and reports it."""
    shape = (64, 4, 4)
    q = np.cos(np.pi * (np.arange(64) + 0.5) / 64)[:, None, None] * np.ones(shape)
    value = 2.0 * np.cos(np.pi / 64) - 2.0
    solver = ConjugateGradientPressure(launcher, shape, CLOSED, None, 1e-9, 100)
    found, status = solve(launcher, solver, value * q)
    np.testing.assert_allclose(found, q, atol=1e-4)
    assert status.converged
    assert status.iterations <= 5
    # 24 half ulps of a pressure of 1, over the largest |d| = 0.0024.
    assert 1e-9 < status.max_residual <= 24 * 2**-24 / abs(value)


def test_not_a_number_ends_at_once(launcher):
    """A divergence that is not finite is not converged, and does not keep the solver busy."""
    divergence = np.zeros((6, 5, 4))
    divergence[2, 3, 1] = np.nan
    for make in PRESSURE_SOLVERS.values():
        _, status = solve(launcher, make(launcher, PressureProblem(shape=(6, 5, 4), sides=OPEN)), divergence)
        assert not status.converged
        assert status.iterations <= 1


def test_takes_in_changed_solids(launcher):
    """When the solids have changed, so has the operator."""
    rng = np.random.default_rng(15)
    first, second = (rng.random((2, 7, 8, 6)) > 0.3).astype(np.float64)
    solids = solids_of(launcher, first, open_shares(first, OPEN))
    solver = ConjugateGradientPressure(launcher, first.shape, OPEN, solids, 1e-6, 200)
    solve(launcher, solver, first * rng.standard_normal(first.shape))
    solids.fluid.assign(second.astype(np.float32))
    for array, share in zip((solids.wx, solids.wy, solids.wz), open_shares(second, OPEN), strict=True):
        array.assign(share)
    solids.changes += 1
    divergence = second * rng.standard_normal(second.shape)
    found, status = solve(launcher, solver, divergence)
    expected = direct(divergence, open_shares(second, OPEN), OPEN, closed_components(second, OPEN))
    assert status.converged
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_moving_solids_need_no_more_memory(launcher):
    """Solids that change among as many closed cells allocate nothing, and an open box nothing for components."""
    first = np.ones((6, 8, 40))
    first[:, :, 10] = 0.0
    for sides in (CLOSED, OPEN):
        solids = solids_of(launcher, first, open_shares(first, sides))
        solver = ConjugateGradientPressure(launcher, first.shape, sides, solids, 1e-5, 50)
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


def test_same_bits_for_any_number_of_threads():
    """1, 2 and 7 threads give bit-equal pressures and the same status."""
    rng = np.random.default_rng(16)
    fluid = (scipy.ndimage.gaussian_filter(rng.standard_normal((67, 41, 35)), 3) > -0.02).astype(np.float64)
    divergence = fluid * rng.standard_normal(fluid.shape)
    results = []
    for threads in (1, 2, 7):
        launcher = Launcher("cpu", threads)
        results.append(solve(launcher, solver_of(launcher, fluid, CLOSED, 1e-4), divergence))
    assert results[0][1].iterations > 1
    for found, status in results[1:]:
        np.testing.assert_array_equal(found.view(np.int32), results[0][0].view(np.int32))
        assert status == results[0][1]


def test_solvers_by_name(launcher):
    """Both are made by one signature; the spectral one refuses solids."""
    shape = (6, 5, 4)
    divergence = np.random.default_rng(17).standard_normal(shape)
    problem = PressureProblem(shape=shape, sides=OPEN, tolerance=1e-6)
    results = [solve(launcher, make(launcher, problem), divergence)[0] for make in PRESSURE_SOLVERS.values()]
    np.testing.assert_allclose(results[0], results[1], atol=1e-5)
    fluid = np.ones(shape)
    solids = solids_of(launcher, fluid, open_shares(fluid, OPEN))
    with pytest.raises(ValueError, match="spectral"):
        PRESSURE_SOLVERS["spectral"](launcher, PressureProblem(shape=shape, sides=OPEN, solids=solids))
