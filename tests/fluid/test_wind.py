"""Wind: what is uniform stays so to the bit, inflow takes its value, a plume is blown aside, obstacles are passed."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import at, plume
from staggered import CLOSED, OPEN, lattice_of

from warp_smoke import Collider, Mesh, make_plan
from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.solver import SmokeSolver
from warp_smoke.fluid.wind import Wind
from warp_smoke.timing import Timings


def run(launcher, scene, frames, seconds=1 / 12):
    """A solver after some frames, and their reports."""
    (plan,) = make_plan(scene).domains
    solver = SmokeSolver(launcher, plan, Timings(launcher))
    solver.begin(1)
    return solver, [solver.advance(frame, frame + 1, seconds) for frame in range(1, frames + 1)]


@pytest.mark.parametrize("advection", ["semi_lagrangian", "maccormack"])
@pytest.mark.parametrize("max_courant", [0.7, 5.0])
def test_uniform_wind_stays_uniform(launcher, advection, max_courant):
    """In an open box with no other force the wind is the same to the bit after many steps, and carries smoke away."""
    wind = (1.0, -0.5, 0.25)
    scene = plume(boundary=OPEN, wind=wind, advection=advection, max_courant=max_courant)
    scene = replace(scene, domains=[replace(scene.domains[0], buoyancy_temperature=0.0)])
    solver, _ = run(launcher, scene, frames=8)
    for component, speed in zip(solver.state.velocity, wind, strict=True):
        np.testing.assert_array_equal(component.numpy(), np.float32(speed))
    density = solver.state.density.numpy().sum(axis=(1, 2))
    assert density[8:].sum() > 2 * density[:8].sum()


def test_stage_axes(launcher):
    """The wind's numbers are along the stage's axes, not those of a turned box."""
    turn = np.eye(4)
    turn[:3, :3] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]  # the lattice's i runs along the stage's +y, j along −x
    wind = Wind(launcher, lattice_of((3, 4, 5), to_world=turn), (1.0, 2.0, 3.0))
    assert wind.velocity == (2.0, -1.0, 3.0)


@pytest.mark.parametrize("axis", range(3))
def test_only_what_comes_in_takes_the_wind(launcher, upload, axis):
    """On open sides, faces with inward flow take the wind and others stay; all others and closed sides stay."""
    shape = (4, 3, 5)
    rng = np.random.default_rng(1)
    values = [rng.standard_normal(face_shape(shape, a)).astype(np.float32) for a in range(3)]
    sides = list(CLOSED)
    sides[2 * axis] = sides[2 * axis + 1] = "open"
    velocity = [upload(each) for each in values]
    Wind(launcher, lattice_of(shape, tuple(sides)), (1.0, 2.0, -3.0)).let_in(velocity)
    expected = [each.copy() for each in values]
    faces, speed = np.moveaxis(expected[axis], axis, 0), (1.0, 2.0, -3.0)[axis]
    faces[0][faces[0] > 0] = speed
    faces[-1][faces[-1] < 0] = speed
    for component, each in zip(velocity, expected, strict=True):
        np.testing.assert_array_equal(component.numpy(), each)


def test_wind_stops_at_closed_sides(launcher):
    """At the beginning no air moves through closed sides, and air in a closed box is at rest."""
    lattice = lattice_of((4, 4, 4), ("closed", "open", "closed", "closed", "open", "open"))
    velocity = [launcher.zeros(face_shape((4, 4, 4), a), "test") for a in range(3)]
    Wind(launcher, lattice, (1.0, 2.0, 3.0)).fill(velocity)
    u, v, w = (component.numpy() for component in velocity)
    assert not u[0].any()
    assert not v[:, [0, -1]].any()
    np.testing.assert_array_equal(u[1:], 1.0)
    np.testing.assert_array_equal(w, 3.0)
    closed = make_plan(plume(wind=(1.0, 0.0, 0.0), boundary=CLOSED))
    assert "blow_wind" not in closed.domains[0].passes


def _middle(density, axis):
    """Centre of mass along an axis [cells]."""
    along = density.astype(float).sum(axis=tuple(a for a in range(3) if a != axis))
    return (along * (np.arange(len(along)) + 0.5)).sum() / along.sum()


def test_plume_is_blown_aside(launcher):
    """The same plume rises with and without wind; with it, it leans that way, more the stronger it is."""
    leans, heights = [], []
    for speed in (0.0, 0.25, 0.5):
        solver, reports = run(launcher, plume(resolution=24, wind=(0.0, 0.0, speed)), frames=10)
        density = solver.state.density.numpy()
        leans.append(_middle(density, 2) - 12.0)
        heights.append(_middle(density, 1))
        assert all(status.converged for report in reports for status in report.pressure)
    assert abs(leans[0]) < 0.01
    assert leans[2] > leans[1] + 0.5 > leans[0] + 1.0
    assert min(heights) > 5.0 + 1.0  # the source is at cell 4.8


@pytest.mark.parametrize("advection", ["semi_lagrangian", "maccormack"])
def test_wind_around_a_ball(launcher, advection):
    """Free of divergence from the first frame, faster beside the ball, steady in the end, bounded by a few winds."""
    ball = Collider(path="/World/Ball", mesh=Mesh.sphere(0.3, 16), transform=at(0, 1, 0))
    scene = plume(resolution=24, boundary=OPEN, wind=(1.0, 0.0, 0.0), advection=advection)
    scene = replace(scene, domains=[replace(scene.domains[0], buoyancy_temperature=0.0)], colliders=[ball])
    solver, _ = run(launcher, scene, frames=0)
    u, v, w = (component.numpy() for component in solver.state.velocity)
    divergence = np.diff(u, axis=0) + np.diff(v, axis=1) + np.diff(w, axis=2)
    assert np.abs(divergence * solver.solids.fluid.numpy()).max() < 0.01  # the solver's tolerance
    assert u[12, 16, 12] > 1.05
    solver, reports = run(launcher, scene, frames=12)
    speeds = [report.speed for report in reports]
    assert max(speeds) < 2.0
    assert solver.state.velocity[0].numpy()[0].mean() > 0.8
