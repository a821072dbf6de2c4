"""Turbulence: a force without divergence, as strong as asked for, the same in every run, at any resolution."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import plume
from staggered import CLOSED, OPEN, SLAB, lattice_of

from warp_smoke import Emitter, Mesh, Samples, make_plan
from warp_smoke.fluid.emitters import Interval, Source
from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.solver import SmokeSolver
from warp_smoke.fluid.turbulence import PEAK, Turbulence
from warp_smoke.timing import Timings


def _force(launcher, n=32, voxel_size=1 / 32, scale=0.25, strength=2.0, time=0.3):
    """The acceleration on the faces of a box."""
    lattice = lattice_of((n, n, n), voxel_size=voxel_size)
    velocity = tuple(launcher.zeros(face_shape((n, n, n), axis), "test") for axis in range(3))
    turbulence = Turbulence(launcher, lattice, strength, scale)
    turbulence.turn(time)
    turbulence.add(velocity, strength, 1.0)
    return [component.numpy().astype(float) for component in velocity]


@pytest.mark.parametrize("scale", [0.25, 1e-6], ids=["eddies", "smaller than cells"])
def test_free_of_divergence(launcher, scale):
    """In every cell what goes in comes out, to round-off."""
    u, v, w = _force(launcher, scale=scale)
    divergence = np.diff(u, axis=0) + np.diff(v, axis=1) + np.diff(w, axis=2)
    assert np.abs(divergence).max() < 1e-5 * np.abs(u).max()


def test_fits_around_periodic_axes(launcher):
    """Where sides are periodic the force goes on at the other end: as smooth and free of divergence as elsewhere."""
    shape = (20, 24, 17)
    lattice = lattice_of(shape, SLAB, voxel_size=1 / 20)
    velocity = tuple(launcher.zeros(face_shape(shape, axis), "test") for axis in range(3))
    turbulence = Turbulence(launcher, lattice, 1.0, 0.3)  # 3.33 and 2.83 eddies would not fit
    turbulence.turn(0.3)
    turbulence.add(velocity, 1.0, 1.0)
    u, v, w = (component.numpy().astype(float) for component in velocity)
    np.testing.assert_array_equal(u[0], u[-1])
    np.testing.assert_array_equal(w[..., 0], w[..., -1])
    divergence = np.diff(u, axis=0) + np.diff(v, axis=1) + np.diff(w, axis=2)
    assert np.abs(divergence).max() < 1e-5 * np.abs(u).max()
    for component in (v, w[..., :-1]):
        steps = np.abs(np.diff(component, axis=0, append=component[:1]))
        assert steps[-1].max() <= steps[:-1].max()


@pytest.mark.parametrize("strength", [0.1, 3.0])
def test_as_strong_as_asked_for(launcher, strength):
    """The root mean square is the strength, and the peak what the step count allows for; no axis is favoured."""
    components = _force(launcher, n=64, voxel_size=1 / 64, scale=1 / 8, strength=strength)
    squares = [(component**2).mean() for component in components]
    assert np.sqrt(sum(squares)) == pytest.approx(strength, rel=0.1)  # of 8³ eddies
    np.testing.assert_allclose(squares, np.mean(squares), rtol=0.25)
    assert max(np.abs(component).max() for component in components) < PEAK * strength


def test_does_not_depend_on_the_resolution(launcher):
    """Twice the cells: faces of the coarse lattice have the mean of the four fine ones in them, to order 2."""
    coarse = _force(launcher, n=16, voxel_size=1 / 16, scale=0.5)[0]
    fine = _force(launcher, n=32, voxel_size=1 / 32, scale=0.5)[0]
    means = fine[::2].reshape(17, 16, 2, 16, 2).mean(axis=(2, 4))
    assert np.abs(means - coarse).max() < 0.05 * np.abs(coarse).max()


def test_changes_in_time_and_is_repeatable(launcher):
    """The same time gives the same bits; an eddy is another after its turnover time √(scale / strength)."""
    now, again, soon, later = (_force(launcher, time=time)[1] for time in (0.3, 0.3, 0.31, 1.3))
    np.testing.assert_array_equal(now, again)
    assert np.abs(soon - now).mean() < 0.2 * np.abs(now).mean() < np.abs(later - now).mean()


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.55, -0.3, 0.0)], ids=["inside", "across a side"])
def test_emitter_stirs_the_air_inside_it(launcher, place):
    """The force is that of the whole domain on faces between cells inside, half of it on its border, else nothing."""
    shape, lattice = (16, 16, 16), lattice_of((16, 16, 16), voxel_size=1 / 16)
    lower = np.round(16 * (np.array([0.25, 0.375, 0.5]) + place)).astype(int)
    inside = np.zeros(shape)
    inside[tuple(slice(max(0, n), n + 5) for n in lower)] = 1.0
    emitter = Emitter(path="/Source", mesh=Mesh.box(5 / 16, lower=lower / 16), turbulence=3.0)
    source, turbulence = Source(launcher, lattice, emitter), Turbulence(launcher, lattice, 3.0, 0.25)
    source.place(Interval(1.0, 1.0, 0.0))
    forces = [tuple(launcher.zeros(face_shape(shape, axis), "test") for axis in range(3)) for _ in range(2)]
    turbulence.turn(0.3)
    turbulence.add(forces[0], 3.0, 0.5)
    turbulence.add_inside(source, forces[1], 3.0, 0.5)
    for axis, (everywhere, there) in enumerate(zip(*forces, strict=True)):
        pads = [(int(a == axis),) * 2 for a in range(3)]
        padded = np.moveaxis(np.pad(inside, pads), axis, 0)
        share = np.moveaxis(0.5 * (padded[1:] + padded[:-1]), 0, axis)
        np.testing.assert_allclose(there.numpy(), share * everywhere.numpy(), rtol=1e-5, atol=1e-6)
        assert there.numpy().any()


def test_emitter_stirs_while_it_is_on(launcher):
    """An emitter with turbulence alone moves the air from the frame on in which it is switched on."""
    scene = plume()
    source = replace(scene.emitters[0], turbulence=2.0, enabled=Samples([1.0, 3.0], [False, True]))
    still = replace(scene.domains[0], buoyancy_temperature=0.0)
    (plan,) = make_plan(replace(scene, domains=[still], emitters=[source])).domains
    assert "stir_air" in plan.passes
    solver = SmokeSolver(launcher, plan, Timings(launcher))
    solver.begin(1)
    speeds = [solver.advance(frame, frame + 1, 1 / 12).speed for frame in (1, 2, 3)]
    assert speeds[0] == 0.0
    assert speeds[2] > speeds[1] > 0.0


@pytest.mark.parametrize("boundary", [OPEN, CLOSED], ids=["open", "closed"])
def test_stirs_still_air(launcher, boundary):
    """Turbulence alone moves air, as fast as its strength and size make it, and stays bounded."""
    scene = plume(boundary=boundary, turbulence=1.0, turbulence_scale=0.5)
    scene = replace(scene, domains=[replace(scene.domains[0], buoyancy_temperature=0.0)])
    (plan,) = make_plan(scene).domains
    solver = SmokeSolver(launcher, plan, Timings(launcher))
    solver.begin(1)
    speeds = [solver.advance(frame, frame + 1, 1 / 12).speed for frame in range(1, 25)]
    assert 0.2 < max(speeds) < 5.0
