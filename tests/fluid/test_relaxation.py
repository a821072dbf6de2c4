"""Jacobi and red-black over-relaxation: every iterate of a discrete eigenmode in closed form, and of random data."""

import numpy as np
import pytest
from pressure_cases import solve, solver_of
from staggered import CLOSED, MIXED, laplacian_matrix, open_shares

from warp_smoke.fluid.pressure import PressureProblem
from warp_smoke.fluid.pressure.relaxation import JACOBI_WEIGHT, over_relaxation


def ring(shape, k):
    """A closed ring of cells of fluid among solids, one cell wide, and the eigenmode cos(2π k s / n) along it.

    Each of its n cells has two open faces, so the mode and its values at every other cell are known in closed form:
    λ = 2 − 2 cos(2π k / n), and both relaxations only scale them.
    """
    nx, ny = shape[0] - 2, shape[1] - 2
    cells = [(i, 1) for i in range(1, nx)] + [(nx, j) for j in range(1, ny)]
    cells += [(i, ny) for i in range(nx, 1, -1)] + [(1, j) for j in range(ny, 1, -1)]
    fluid, mode = np.zeros(shape), np.zeros(shape)
    for s, (i, j) in enumerate(cells):
        fluid[i, j, 1] = 1.0
        mode[i, j, 1] = np.cos(2 * np.pi * k * s / len(cells))
    return fluid, mode, 2.0 - 2.0 * np.cos(2 * np.pi * k / len(cells))


@pytest.mark.parametrize("k", [1, 3])
def test_jacobi_iterates_of_an_eigenmode(launcher, k):
    """After n sweeps from 0 the pressure is 1 − (1 − ω λ / 2)ⁿ of the solution."""
    fluid, mode, value = ring((9, 12, 3), k)
    for n in (1, 2, 3, 8, 9, 20):
        found, status = solve(launcher, solver_of(launcher, "jacobi", fluid, CLOSED, 1e-7, n), -value * mode)
        left = (1.0 - JACOBI_WEIGHT * value / 2.0) ** n
        np.testing.assert_allclose(found, (1.0 - left) * mode, atol=1e-5)
        assert status.iterations == n
        assert status.max_residual == pytest.approx(abs(left), abs=1e-5)


@pytest.mark.parametrize("k", [1, 3])
def test_red_black_iterates_of_an_eigenmode(launcher, k):
    """With errors a of red and b of black cells: a ← a + ω ((1 − λ / 2) b − a), then b ← b + ω ((1 − λ / 2) a − b)."""
    fluid, mode, value = ring((9, 12, 3), k)
    weight = over_relaxation(PressureProblem(shape=fluid.shape, sides=CLOSED))
    assert 1.0 < weight < 2.0
    red = np.indices(fluid.shape).sum(axis=0) % 2 == 0
    a = b = 1.0
    for n in range(1, 21):
        a += weight * ((1.0 - value / 2.0) * b - a)
        b += weight * ((1.0 - value / 2.0) * a - b)
        found, status = solve(launcher, solver_of(launcher, "red_black", fluid, CLOSED, 1e-7, n), -value * mode)
        np.testing.assert_allclose(found, (1.0 - np.where(red, a, b)) * mode, atol=1e-5)
        assert status.iterations == n


def test_iterates_of_random_data(launcher):
    """Both follow their matrix iteration in float64, among solids and with open and closed sides."""
    rng = np.random.default_rng(30)
    fluid = (rng.random((7, 6, 9)) > 0.2).astype(np.float64)
    divergence, guess = fluid * rng.standard_normal((2, *fluid.shape))
    matrix = laplacian_matrix(open_shares(fluid, MIXED), MIXED).toarray()
    centre = -matrix.diagonal()
    weight = over_relaxation(PressureProblem(shape=fluid.shape, sides=MIXED))
    red = (np.indices(fluid.shape).sum(axis=0) % 2 == 0).ravel()
    jacobi, red_black = (np.where(centre > 0, guess.ravel(), 0.0) for _ in range(2))
    for n in range(1, 11):
        jacobi = relaxed(matrix, divergence, jacobi, JACOBI_WEIGHT, centre > 0)
        red_black = relaxed(matrix, divergence, red_black, weight, (centre > 0) & red)
        red_black = relaxed(matrix, divergence, red_black, weight, (centre > 0) & ~red)
        for name, expected in (("jacobi", jacobi), ("red_black", red_black)):
            found, _ = solve(launcher, solver_of(launcher, name, fluid, MIXED, 1e-7, n), divergence, guess)
            np.testing.assert_allclose(found.ravel()[centre > 0], expected[centre > 0], atol=1e-5)


def relaxed(matrix, divergence, q, weight, cells):
    """Returns q + weight (L q − d) / Σ a w in some cells."""
    change = (matrix @ q - divergence.ravel()) / np.maximum(-matrix.diagonal(), 1e-9)
    return np.where(cells, q + weight * change, q)


def test_over_relaxation_takes_the_order_of_n_sweeps(launcher):
    """In an open box of n³ cells, sweeps to 1e-4 grow like n for red-black and like n² for Jacobi."""
    sweeps = {}
    for name in ("red_black", "jacobi"):
        for n in (8, 16):
            x = (np.arange(n) + 0.5) / n
            mode = np.einsum("i,j,k", *[np.sin(np.pi * x)] * 3)
            fluid = np.ones(mode.shape)
            _, status = solve(launcher, solver_of(launcher, name, fluid, ("open",) * 6, 1e-4, 5000), mode)
            assert status.converged
            sweeps[name, n] = status.iterations
    assert sweeps["red_black", 16] <= 2.5 * sweeps["red_black", 8]
    assert 3.0 < sweeps["jacobi", 16] / sweeps["jacobi", 8] < 5.0
    assert sweeps["red_black", 16] < 0.3 * sweeps["jacobi", 16]
