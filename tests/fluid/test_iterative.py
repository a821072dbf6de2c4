"""Iterative pressure solvers against a sparse direct solver; pockets, walls, status, changing solids, threads."""

import numpy as np
import pytest
import scipy.ndimage
from pressure_cases import (
    AROUND_SOLIDS,
    closed_components,
    direct,
    solids_of,
    solve,
    solver_of,
)
from staggered import CLOSED, MIXED, OPEN, PERIODIC, SLAB, join_seams, laplacian_matrix, open_shares

from warp_smoke.fluid.pressure import PRESSURE_SOLVERS, PressureProblem
from warp_smoke.launch import Launcher

# The plain sweeps need many in a maze.
LIMIT = 5000


@pytest.mark.parametrize("name", AROUND_SOLIDS)
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    "sides", [CLOSED, OPEN, MIXED, PERIODIC, SLAB], ids=["closed", "open", "mixed", "periodic", "slab"]
)
def test_agrees_with_direct_solver_among_random_solids(launcher, name, sides, seed):
    """In a random maze with pockets and single cells, pressure and imbalance are those of sparse LU in float64."""
    rng = np.random.default_rng(seed)
    fluid = (rng.random((9, 8, 10)) > (0.15, 0.45)[seed % 2]).astype(np.float64)
    divergence = fluid * rng.standard_normal(fluid.shape)
    components = closed_components(fluid, sides)
    expected = direct(divergence, open_shares(fluid, sides), sides, components)
    found, status = solve(launcher, solver_of(launcher, name, fluid, sides, 1e-6, LIMIT), divergence)
    # The residual is 1e-6 of |d| ≈ 4, and the condition of such mazes up to a thousand.
    np.testing.assert_allclose(found, expected, atol=3e-3)
    assert status.converged
    assert status.imbalance == pytest.approx(
        max((abs(divergence[mask].mean()) for mask in components), default=0.0), abs=1e-6
    )


@pytest.mark.parametrize("name", AROUND_SOLIDS)
@pytest.mark.parametrize("sides", [CLOSED, MIXED, PERIODIC, SLAB], ids=["closed", "mixed", "periodic", "slab"])
def test_agrees_with_direct_solver_between_walls(launcher, name, sides):
    """Where faces between cells of fluid are closed at random, pressure and imbalance are those of sparse LU too."""
    rng = np.random.default_rng(6)
    fluid = (rng.random((13, 8, 17)) > 0.1).astype(np.float64)
    shares = [share * (rng.random(share.shape) > 0.4) for share in open_shares(fluid, sides)]
    join_seams(shares, sides)
    divergence = fluid * rng.standard_normal(fluid.shape)
    components = closed_components(fluid, sides, shares)
    assert len(components) > 1
    expected = direct(divergence, shares, sides, components)
    found, status = solve(launcher, solver_of(launcher, name, fluid, sides, 1e-6, LIMIT, shares), divergence)
    # The residual is 1e-6 of |d| ≈ 4, and the condition of such mazes a thousand.
    np.testing.assert_allclose(found, expected, atol=3e-3)
    assert status.converged
    assert status.imbalance == pytest.approx(max(abs(divergence[mask].mean()) for mask in components), abs=1e-6)


@pytest.mark.parametrize("name", AROUND_SOLIDS)
def test_good_guess_saves_iterations(launcher, name):
    """The solution as first guess takes none, a guess that is nearly right fewer than none at all."""
    rng = np.random.default_rng(13)
    fluid = (rng.random((10, 12, 11)) > 0.3).astype(np.float64)
    divergence = fluid * rng.standard_normal(fluid.shape)
    solver = solver_of(launcher, name, fluid, MIXED, 1e-4, LIMIT)
    found, cold = solve(launcher, solver, divergence)
    _, again = solve(launcher, solver, divergence, found)
    assert again.iterations == 0
    assert again.converged
    _, warm = solve(launcher, solver, 1.01 * divergence, found)
    assert 0 < warm.iterations < cold.iterations


@pytest.mark.parametrize("name", AROUND_SOLIDS)
def test_pocket_keeps_its_imbalance_to_itself(launcher, name):
    """Net divergence in an enclosed pocket is left there and reported; the open fluid around it is still solved."""
    fluid = np.ones((9, 9, 9))
    fluid[2:7, 2:7, 2:7] = 0.0
    fluid[3:6, 3:6, 3:6] = 1.0
    divergence = np.zeros(fluid.shape)
    divergence[4, 4, 4] = 2.7
    divergence[0, 4, 4] = 1.0
    found, status = solve(launcher, solver_of(launcher, name, fluid, OPEN, 1e-5, LIMIT), divergence)
    assert status.converged
    assert status.imbalance == pytest.approx(0.1)
    assert abs(found[3:6, 3:6, 3:6].mean()) < 1e-7
    matrix = laplacian_matrix(open_shares(fluid, OPEN), OPEN)
    left = divergence - (matrix @ found.astype(np.float64).ravel()).reshape(fluid.shape)
    np.testing.assert_allclose(left[3:6, 3:6, 3:6], 0.1, atol=1e-5 * 2.7)
    left[3:6, 3:6, 3:6] = 0.0
    np.testing.assert_allclose(left, 0.0, atol=1e-5 * 2.7)


@pytest.mark.parametrize("name", AROUND_SOLIDS)
@pytest.mark.parametrize("cells", [0, 1], ids=["none", "one"])
def test_hardly_any_fluid(launcher, name, cells):
    """With no fluid at all, or one enclosed cell, there is no pressure to solve for and nothing fails."""
    fluid = np.zeros((5, 4, 6))
    fluid.ravel()[57 : 57 + cells] = 1.0
    found, status = solve(launcher, solver_of(launcher, name, fluid, OPEN, 1e-5, LIMIT), 3.0 * fluid)
    np.testing.assert_array_equal(found, 0.0)
    assert status.converged
    assert status.iterations == 0
    assert status.imbalance == pytest.approx(3.0 * cells)


@pytest.mark.parametrize("name", AROUND_SOLIDS)
def test_no_divergence_gives_no_pressure(launcher, name):
    """0 in, 0 out, without iterations or NaN, also after a guess that is wrong."""
    fluid = (np.random.default_rng(14).random((6, 5, 7)) > 0.3).astype(np.float64)
    found, status = solve(launcher, solver_of(launcher, name, fluid, OPEN, 1e-5, LIMIT), np.zeros(fluid.shape))
    np.testing.assert_array_equal(found, 0.0)
    assert status.converged
    assert status.iterations == 0
    assert status.max_residual == status.rms_residual == 0.0
    found, status = solve(launcher, solver_of(launcher, name, fluid, OPEN, 1e-5, LIMIT), np.zeros(fluid.shape), fluid)
    np.testing.assert_allclose(found, 0.0, atol=1e-5)
    assert status.converged


@pytest.mark.parametrize("name", AROUND_SOLIDS)
def test_takes_in_changed_solids(launcher, name):
    """When the solids have changed, so has the operator."""
    rng = np.random.default_rng(15)
    first, second = (rng.random((2, 7, 8, 6)) > 0.3).astype(np.float64)
    solids = solids_of(launcher, first, open_shares(first, OPEN))
    problem = PressureProblem(shape=first.shape, sides=OPEN, solids=solids, tolerance=1e-6, max_iterations=LIMIT)
    solver = PRESSURE_SOLVERS[name](launcher, problem)
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


def test_solids_that_move_within_their_cells_cost_nothing(launcher):
    """When solids have moved but no cell or face has changed, nothing is prepared anew."""
    fluid = np.ones((6, 7, 8))
    fluid[2:4, 2:4, 2:4] = 0.0
    solids = solids_of(launcher, fluid, open_shares(fluid, OPEN))
    solver = PRESSURE_SOLVERS["multigrid"](launcher, PressureProblem(shape=fluid.shape, sides=OPEN, solids=solids))
    before = launcher.launches["_sum_weights"]
    for prepared in (1, 1, 2):
        solids.changes += 1
        if prepared == 2:
            share = solids.wx.numpy().copy()
            share[3, 5, 5] = 0.0
            solids.wx.assign(share)
        solve(launcher, solver, fluid)
        assert launcher.launches["_sum_weights"] == before + prepared


@pytest.mark.usefixtures("divided_launches")
@pytest.mark.parametrize("name", AROUND_SOLIDS)
def test_same_bits_for_any_number_of_threads(name):
    """1, 2 and 7 threads give bit-equal pressures and the same status."""
    rng = np.random.default_rng(16)
    fluid = (scipy.ndimage.gaussian_filter(rng.standard_normal((67, 41, 35)), 3) > -0.02).astype(np.float64)
    divergence = fluid * rng.standard_normal(fluid.shape)
    results = []
    for threads in (1, 2, 7):
        launcher = Launcher("cpu", threads)
        results.append(solve(launcher, solver_of(launcher, name, fluid, CLOSED, 1e-2), divergence))
    assert results[0][1].iterations > 1
    for found, status in results[1:]:
        np.testing.assert_array_equal(found.view(np.int32), results[0][0].view(np.int32))
        assert status == results[0][1]


def test_not_a_number_ends_at_once(launcher):
    """A divergence that is not finite is not converged, and does not keep the solver busy."""
    divergence = np.zeros((6, 5, 4))
    divergence[2, 3, 1] = np.nan
    for make in PRESSURE_SOLVERS.values():
        _, status = solve(launcher, make(launcher, PressureProblem(shape=(6, 5, 4), sides=OPEN)), divergence)
        assert not status.converged
        assert status.iterations <= 1


@pytest.mark.parametrize("sides", [OPEN, SLAB], ids=["open", "slab"])
@pytest.mark.parametrize("shape", [(6, 5, 4), (1, 4, 2), (12, 6, 8)])
def test_solvers_by_name(launcher, sides, shape):
    """All are made by one signature and agree in an empty box; the spectral one refuses solids."""
    divergence = np.random.default_rng(17).standard_normal(shape)
    problem = PressureProblem(shape=shape, sides=sides, tolerance=1e-6, max_iterations=LIMIT)
    results = [solve(launcher, make(launcher, problem), divergence)[0] for make in PRESSURE_SOLVERS.values()]
    for result in results[1:]:
        # The residual is 1e-6 of |d|, and the condition of these boxes up to fifteen; as much again is round-off.
        np.testing.assert_allclose(result, results[0], atol=2e-4)
    fluid = np.ones(shape)
    solids = solids_of(launcher, fluid, open_shares(fluid, OPEN))
    with pytest.raises(ValueError, match="spectral"):
        PRESSURE_SOLVERS["spectral"](launcher, PressureProblem(shape=shape, sides=OPEN, solids=solids))
