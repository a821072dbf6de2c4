"""Multigrid: iterations for boxes, spheres, walls and pockets; odd sizes, thin layers, levels split by walls."""

import numpy as np
import pytest
from pressure_cases import closed_components, solve, solver_of, without_means
from staggered import CLOSED, MIXED, OPEN, PERIODIC, SLAB, face_shapes, join_seams, laplacian_matrix, open_shares

from warp_smoke.fluid.pressure.iterative import FaceWeights
from warp_smoke.fluid.pressure.levels import level_shapes
from warp_smoke.fluid.pressure.v_cycle import VCycle

FLOOR = ("open", "open", "closed", "open", "open", "open")


def divergence_of(shares, fluid, seed=0, sides=OPEN):
    """Divergence of random velocities on the open faces."""
    rng = np.random.default_rng(seed)
    flow = [rng.standard_normal(share.shape) * share for share in shares]
    join_seams(flow, sides)
    parts = [np.diff(component, axis=axis) for axis, component in enumerate(flow)]
    return sum(parts) * fluid


def iterations(launcher, fluid, sides, tolerance, shares=None):
    """Iterations to a tolerance that is reached."""
    solver = solver_of(launcher, "multigrid", fluid, sides, tolerance, 50, shares)
    _, status = solve(launcher, solver, divergence_of(shares or open_shares(fluid, sides), fluid, sides=sides))
    assert status.converged
    return status.iterations


def ball(shape):
    """Fluid around a ball."""
    x = np.indices(shape) + 0.5 - np.reshape(shape, (3, 1, 1, 1)) * 0.45
    return (np.sum(x**2, axis=0) > (0.2 * min(shape)) ** 2).astype(np.float64)


def rooms(n):
    """Rooms between walls one cell thick at odd places, with small doors."""
    fluid, door = np.ones((n, n, n)), slice(n // 7, n // 7 + 3)
    for axis, place in ((0, n // 3), (0, 2 * n // 3 + 1), (1, n // 2 + 1), (2, n // 2)):
        wall = np.moveaxis(fluid, axis, 0)
        wall[place] = 0.0
        wall[place, door, door] = 1.0
    return fluid


@pytest.mark.parametrize(
    "sides", [CLOSED, OPEN, FLOOR, PERIODIC, SLAB], ids=["closed", "open", "floor", "periodic", "slab"]
)
@pytest.mark.parametrize("n", [32, 64])
def test_box_and_ball_take_few_iterations(launcher, sides, n):
    """At most 6 to 1e-4 and 8 to 1e-6, in a closed box too, whatever the number of cells."""
    for fluid in (np.ones((n, n, n)), ball((n, n, n))):
        assert iterations(launcher, fluid, sides, 1e-4) <= 6
        assert iterations(launcher, fluid, sides, 1e-6) <= 8


def test_as_many_iterations_for_many_cells(launcher):
    """Around a ball in a closed box, 128³ cells take as many iterations to 1e-4 as 32³, up to two."""
    few, many = (iterations(launcher, ball((n, n, n)), CLOSED, 1e-4) for n in (32, 128))
    assert abs(many - few) <= 2


@pytest.mark.parametrize("shape", [(33, 40, 17), (31, 31, 31), (5, 7, 150), (1, 64, 50)], ids=str)
@pytest.mark.parametrize("sides", [CLOSED, OPEN, MIXED], ids=["closed", "open", "mixed"])
def test_odd_sizes_and_thin_boxes_take_no_more(launcher, shape, sides):
    """Sizes that cannot be halved, and boxes a few cells thin, take as many iterations as a cube of 32³."""
    for fluid in (np.ones(shape), ball(shape)):
        assert iterations(launcher, fluid, sides, 1e-4) <= 6
        assert iterations(launcher, fluid, sides, 1e-6) <= 8


@pytest.mark.parametrize("sides", [CLOSED, FLOOR], ids=["closed", "floor"])
@pytest.mark.parametrize("n", [32, 48])
def test_rooms_between_thin_walls(launcher, sides, n):
    """Walls one cell thick split coarse cells, so that rooms joined by small doors take at most 25 iterations."""
    fluid = rooms(n)
    assert iterations(launcher, fluid, sides, 1e-4) <= 12
    assert iterations(launcher, fluid, sides, 1e-6) <= 25


def test_closed_rooms_and_pockets(launcher):
    """In a closed box of rooms, some closed and some joined by doors one cell wide, 1e-6 is reached too.

    Each closed body has a mean that no pressure can change; kept in the residual, it led the iterations astray.
    """
    fluid = np.ones((64, 64, 64))
    for axis in range(3):
        np.moveaxis(fluid, axis, 0)[16::16] = 0.0
    for place in range(8, 64, 16):
        for axis in range(3):
            np.moveaxis(fluid, axis, 0)[:, place, place] = 1.0
    assert iterations(launcher, fluid, CLOSED, 1e-6) <= 25


def test_diagonal_walls(launcher):
    """A wall of cells that touch by their edges, with a door: at most 25 iterations."""
    i, j, k = np.indices((32, 32, 32))
    fluid = np.where((i + j == 32) & ~((k > 12) & (k < 16)), 0.0, 1.0)
    assert iterations(launcher, fluid, CLOSED, 1e-6) <= 25


@pytest.mark.parametrize("door", [0, 3], ids=["pocket", "cup"])
def test_walls_between_cells(launcher, door):
    """A box of closed faces at odd places, shut or with a door: at most 25 iterations."""
    fluid = np.ones((32, 32, 32))
    shares = open_shares(fluid, CLOSED)
    for axis in range(3):
        share = np.moveaxis(shares[axis], axis, 0)
        for place in (11, 21):
            share[place, 11:21, 11:21] = 0.0
    shares[0][11, 14 : 14 + door, 14 : 14 + door] = 1.0
    assert iterations(launcher, fluid, CLOSED, 1e-4, shares) <= 12
    assert iterations(launcher, fluid, CLOSED, 1e-6, shares) <= 25


def test_pressure_of_a_velocity_without_divergence_elsewhere(launcher):
    """The gradient of any pressure among rooms is found again from its divergence."""
    fluid = rooms(32)
    shares = open_shares(fluid, FLOOR)
    q = fluid * np.random.default_rng(1).standard_normal(fluid.shape)
    padded = np.pad(q, 1)
    flow = []
    for axis, shape in enumerate(face_shapes(q.shape)):
        inner = tuple(slice(None) if other == axis else slice(1, -1) for other in range(3))
        gradient = np.diff(padded[inner], axis=axis) * shares[axis]
        gradient[tuple(0 if a == axis else slice(None) for a in range(3))] *= 2.0
        gradient[tuple(-1 if a == axis else slice(None) for a in range(3))] *= 2.0
        assert gradient.shape == shape
        flow.append(gradient)
    divergence = sum(np.diff(each, axis=axis) for axis, each in enumerate(flow)) * fluid
    found, status = solve(launcher, solver_of(launcher, "multigrid", fluid, FLOOR, 1e-6), divergence)
    assert status.converged
    # The residual is 1e-6 of |d| ≈ 20; the rooms behind small doors have a condition of some thousands.
    np.testing.assert_allclose(found, q, atol=5e-3)


@pytest.mark.parametrize(
    "sides", [CLOSED, OPEN, MIXED, PERIODIC, SLAB], ids=["closed", "open", "mixed", "periodic", "slab"]
)
@pytest.mark.parametrize("walls", [0.0, 0.3], ids=["solids", "walls"])
def test_cycle_is_symmetric(launcher, sides, walls):
    """With M one V-cycle, a · M b = b · M a and −a · M a > 0, for odd sizes and among solids and walls.

    So conjugate gradients converge with it, whatever the solids.
    """
    rng = np.random.default_rng(2)
    fluid = (rng.random((13, 16, 11)) > 0.2).astype(np.float64)
    shares = [share * (rng.random(share.shape) >= walls) for share in open_shares(fluid, sides)]
    join_seams(shares, sides)
    on_device = tuple(launcher.array(share.astype(np.float32), "test") for share in shares)
    cycle = VCycle(launcher, fluid.shape, sides)
    cycle.prepare(FaceWeights(on_device, launcher.zeros(fluid.shape, "test")))

    def apply(r):
        cycle.residual.assign(np.pad(r.astype(np.float32), (1, 2)))
        product = cycle.apply()
        z = cycle.correction.numpy()[1:-2, 1:-2, 1:-2].astype(np.float64)
        assert product == pytest.approx(np.sum(r * z), rel=1e-5)
        return z

    # Closed bodies of fluid have no mean.
    a, b = (divergence_of(shares, fluid, seed, sides) for seed in (3, 4))
    ab, ba, aa, bb = np.sum(a * apply(b)), np.sum(b * apply(a)), np.sum(a * apply(a)), np.sum(b * apply(b))
    assert aa < 0.0
    assert bb < 0.0
    # Round-off of float32, in units of the norm that −M defines.
    assert abs(ab - ba) <= 1e-5 * np.sqrt(aa * bb)


def test_level_shapes():
    """Halves, rounded up where the upper side is closed and down where it is open; few cells, or none left, end it."""
    assert level_shapes((32, 32, 32), CLOSED) == [(32, 32, 32), (16, 16, 16), (8, 8, 8), (4, 4, 4)]
    assert level_shapes((33, 33, 33), CLOSED)[1:3] == [(17, 17, 17), (9, 9, 9)]
    assert level_shapes((33, 33, 33), OPEN)[1:3] == [(16, 16, 16), (8, 8, 8)]
    assert level_shapes((1, 64, 64), OPEN) == [(1, 64, 64)]
    assert level_shapes((1, 1, 64), CLOSED) == [(1, 1, 64)]


@pytest.mark.parametrize("sides", [CLOSED, OPEN], ids=["closed", "open"])
def test_a_few_walls_are_solved_for(launcher, sides):
    """Closed faces here and there, which the V-cycle takes as open, are closed in the solution, and soon found."""
    fluid = np.ones((24, 24, 24))
    fluid[8:12, 8:12, 8:12] = 0.0
    shares = open_shares(fluid, sides)
    for axis, face in ((0, (4, 5, 6)), (1, (15, 12, 10)), (2, (20, 20, 3))):
        shares[axis][face] = 0.0
    solver = solver_of(launcher, "multigrid", fluid, sides, tolerance=1e-4, shares=shares)
    divergence = np.random.default_rng(3).standard_normal(fluid.shape) * fluid
    found, status = solve(launcher, solver, divergence)
    assert status.converged
    assert status.iterations <= 7  # 6 without the walls
    source = without_means(divergence, closed_components(fluid, sides, shares))
    residual = source - (laplacian_matrix(shares, sides) @ found.ravel()).reshape(fluid.shape)
    assert np.abs(residual * fluid).max() < 1.1e-4 * np.abs(divergence).max()
