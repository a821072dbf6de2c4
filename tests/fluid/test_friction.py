"""Friction: the air beside walls that slide along themselves, thick and thin, and walls from arrays."""

import numpy as np
import pytest
from scipy.special import erfc
from staggered import lattice_of

from warp_smoke import ArrayCollider, Collider, Mesh, Samples
from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.diffusion import DIFFUSION_SOLVERS, DiffusionProblem
from warp_smoke.fluid.grid import face_shape

CELLS, WALL, SPEED, VISCOSITY = 48, 8, 2.0, 0.5
SHAPE = (4, CELLS, 3)
CHANNEL = ("periodic", "periodic", "closed", "closed", "periodic", "periodic")


def sliding(mesh, axis, friction=1.0, deforms=False):
    """A mesh that slides along an axis with `SPEED` from time 0 to 1, as it is or by its points."""
    way = np.zeros(3)
    way[axis] = SPEED
    times = np.array([0.0, 1.0])
    if deforms:
        mesh = Mesh(points=Samples(times, np.stack([mesh.points, mesh.points + way])), triangles=mesh.triangles)
        return Collider(path="/Wall", mesh=mesh, friction=friction)
    matrices = np.stack([np.eye(4)] * 2)
    matrices[1, 3, :3] = way
    return Collider(path="/Wall", mesh=mesh, transform=Samples(times, matrices), friction=friction)


THICK = Mesh.box((100.0, 2 * WALL, 100.0))
SHEET = Mesh.grid((-50.0, WALL + 0.2, -50.0), (100.0, 0, 0), (0, 0, 100.0))
SHELL = Mesh.box((100.0, 0.3, 100.0), lower=(-50.0, WALL - 0.1, -50.0))


def flow(launcher, colliders, axis, steps, dt, start=0.0, no_slip=(False,) * 6):
    """One component of the velocity after some steps of diffusion beside colliders that go on as they do."""
    solids = Solids(launcher, lattice_of(SHAPE, CHANNEL), colliders)
    solids.update(0.0, 1.0, 1.0)
    problem = DiffusionProblem(SHAPE, CHANNEL, no_slip, (axis,), 5000, solids)
    diffusion = DIFFUSION_SOLVERS["jacobi"](launcher, problem)
    velocity = tuple(launcher.zeros(face_shape(SHAPE, a), "test") for a in range(3))
    velocity[axis].assign(np.broadcast_to(start, velocity[axis].shape).astype(np.float32))
    for _ in range(steps):
        solids.apply(velocity)
        diffusion.diffuse(axis, velocity[axis], VISCOSITY * dt)
    return velocity[axis].numpy()


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("mesh", [THICK, SHEET, SHELL], ids=["thick", "sheet", "shell"])
def test_still_air_over_a_sliding_wall(launcher, mesh, axis):
    """Stokes' first problem: u = U erfc(y / √(4 ν t)) over a wall that slides, however thin it is."""
    time, steps = 40.0, 80
    u = flow(launcher, [sliding(mesh, axis)], axis, steps, time / steps)
    y = np.arange(CELLS - WALL) + 0.5
    exact = SPEED * erfc(y / np.sqrt(4.0 * VISCOSITY * time))
    # Implicit steps in time are of first order: 0.5 % with 80; the wall starts at once, as if over a whole step.
    np.testing.assert_allclose(u[:, WALL:], np.broadcast_to(exact[None, :, None], u[:, WALL:].shape), atol=0.01 * SPEED)


@pytest.mark.parametrize("friction", [0.3, 1.0])
@pytest.mark.parametrize("deforms", [False, True], ids=["rigid", "deforming"])
def test_thin_walls_pull_like_thick_ones(launcher, deforms, friction):
    """The air above a sheet, or a plate thinner than a cell, moves as above a plate of eight cells, to round-off."""
    thick, sheet, shell = (
        flow(launcher, [sliding(mesh, 0, friction, deforms)], 0, 5, 1.0)[:, WALL:] for mesh in (THICK, SHEET, SHELL)
    )
    assert thick[:, 0].min() > 0.1 * SPEED
    np.testing.assert_allclose(sheet, thick, rtol=1e-6)
    np.testing.assert_allclose(shell, thick, rtol=1e-6)


def test_flow_between_a_sliding_sheet_and_its_sides(launcher):
    """Couette: a velocity that falls evenly from the sheet's to 0 at sides without slip stays as it is."""
    below, above = (np.arange(n) + 0.5 for n in (WALL, CELLS - WALL))
    exact = SPEED * np.concatenate([below / WALL, 1.0 - above / (CELLS - WALL)])[None, :, None]
    u = flow(launcher, [sliding(SHEET, 0)], 0, 2, 20.0, exact, no_slip=(False, False, True, True, False, False))
    np.testing.assert_allclose(u, np.broadcast_to(exact, u.shape), atol=1e-5 * SPEED)


def test_wall_with_more_friction_wins(launcher):
    """Where two sheets close the same faces, the air goes with the one that has more friction, whatever their order."""
    rough, smooth = sliding(SHEET, 0, 0.8), Collider(path="/Other", mesh=SHEET, friction=0.3)
    alone = flow(launcher, [rough], 0, 3, 1.0)
    assert alone.max() > 0.1 * SPEED
    for both in ([rough, smooth], [smooth, rough]):
        np.testing.assert_array_equal(flow(launcher, both, 0, 3, 1.0), alone)
    still = flow(launcher, [Collider(path="/Other", mesh=SHEET, friction=0.9), rough], 0, 3, 1.0)
    assert not still.any()


def test_array_holds_back_like_a_mesh(launcher):
    """A box of whole cells has the same friction on the same faces, to the bit, from a mesh and from an array."""
    shape, inside = (8, 7, 6), np.zeros((8, 7, 6), bool)
    inside[2:5, 1:4, 3:6] = True
    mesh = Mesh.box((3, 3, 3), lower=(2, 1, 3))
    alike = Collider(path="/Wall", mesh=mesh, friction=0.7), ArrayCollider(path="/Wall", solid=inside, friction=0.7)
    found = []
    for collider in alike:
        solids = Solids(launcher, lattice_of(shape), [collider])
        solids.update(1.0, 1.0, 0.0)
        found.append([each.numpy() for each in solids.friction])
    assert np.count_nonzero(found[0][0]) == 4 * 3 * 3
    for of_mesh, of_array in zip(*found, strict=True):
        np.testing.assert_array_equal(of_array, of_mesh)


def test_piston_from_an_array_pulls_like_a_mesh(launcher):
    """A wall that moves across itself gives its faces the same pull from a mesh and from a distance, to round-off."""
    shape, times = (4, 9, 5), np.array([0.0, 1.0])
    distance = np.broadcast_to((np.arange(9) + 0.5 - 3.0)[None, :, None], shape)
    moving = Samples(times, np.stack([distance, distance - SPEED]))
    array = ArrayCollider(path="/Wall", solid=moving, friction=0.7)
    mesh = sliding(Mesh.box(100.0, lower=(-50.0, -97.0, -50.0)), 1, 0.7)
    pulls = []
    for collider in (array, mesh):
        solids = Solids(launcher, lattice_of(shape), [collider])
        solids.update(0.0, 1.0, 1.0)
        pulls.append(solids.pull)
    assert pulls[0][1, 0].numpy().max() > 0
    for axes, pull in pulls[0].items():
        np.testing.assert_allclose(pull.numpy(), pulls[1][axes].numpy(), atol=1e-5 * SPEED)


@pytest.mark.parametrize("friction", [-0.1, 1.5, np.nan])
def test_friction_of_an_array_that_is_refused(friction):
    """From 0 to 1, else an error that names collider and field."""
    with pytest.raises(ValueError, match="/Wall: friction"):
        ArrayCollider(path="/Wall", solid=np.zeros((2, 2, 2), bool), friction=friction)
