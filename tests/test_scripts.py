"""A simulation driven by a script: a force in each substep, sources and solids from arrays, fields written in place."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from scenes import at, plume

import warp_smoke as ws
from warp_smoke import make_plan
from warp_smoke.vdb import read_vdb

SHAPE = (16, 16, 16)
X, Y, Z = np.indices(SHAPE) + 0.5
H = 2 / 16
BALL = 3.5 - np.sqrt((X - 8) ** 2 + (Y - 6) ** 2 + (Z - 8) ** 2)  # positive inside [cells]
SMOKE = np.clip(BALL, 0.0, 1.0)


def scene(emitters, colliders=(), grids=("density", "velocity"), **fields):
    """A closed box of side 2 and 16³ cells around the origin, 24 frames a second."""
    domain = ws.SmokeDomain(path="/Smoke", resolution=16, boundary=("closed",) * 6, grids=grids, **fields)
    return ws.Scene(domains=[domain], emitters=emitters, colliders=colliders)


def held(**fields):
    """An emitter from arrays."""
    return ws.ArrayEmitter(path="/Array", **fields)


def test_force_in_each_substep():
    """A uniform force on air in an open box is felt in full: u = f t, in as many calls as there were substeps."""
    calls = []

    def push(solver, time, dt):
        calls.append((time, dt))
        solver.state.velocity[0].numpy()[...] += 3.0 * dt

    domain = ws.SmokeDomain(path="/Smoke", resolution=16, boundary=("open", "open", *("closed",) * 4))
    still = ws.Scene(domains=[domain], emitters=[held(density=np.zeros(SHAPE))])
    assert "project_pressure" not in make_plan(still).domains[0].passes  # it is the force that moves the air
    simulation = ws.Simulation(still, on_substep=push)
    frames = [simulation.step() for _ in range(3)]
    assert len(calls) == sum(frame.steps["/Smoke"].substeps for frame in frames[1:])
    assert sum(dt for _, dt in calls) == pytest.approx(2 / 24)
    assert [time for time, _ in calls][-1] == pytest.approx(3.0)
    np.testing.assert_allclose(simulation.velocity[0].numpy(), 3.0 * 2 / 24, rtol=1e-5)


def gust(solver, time, dt):
    """A force that changes with time."""
    solver.state.velocity[0].numpy()[...] += dt * 30.0 * np.cos(time)


def test_a_run_writes_what_a_force_moves(tmp_path):
    """The volumes are the fields of the Simulation with that force, from the second frame on others than without."""
    domain = ws.SmokeDomain(path="/Smoke", resolution=16, grids=("density", "velocity"))
    ball = ws.Emitter(path="/Ball", mesh=ws.Mesh.sphere(0.4, 16), temperature=0.0)
    still = ws.Scene(domains=[domain], emitters=[ball], end=3)
    assert "project_pressure" not in make_plan(still).domains[0].passes  # it is the force that moves the air
    result = ws.run(still, tmp_path / "gust", on_substep=gust)
    without = ws.run(still, tmp_path / "still")
    assert (result.report["on_substep"], without.report["on_substep"]) == (True, False)
    simulation = ws.Simulation(still, on_substep=gust)
    for number in still.frames:
        expected = simulation.step().smoke["/Smoke"]
        files = [each.folder / f"volumes/Smoke.{number:04d}.vdb" for each in (result, without)]
        # Half precision, and voxels that dim light by less than 1e-6 are dropped.
        moved, unmoved = (dense(file, "density") for file in files)
        np.testing.assert_allclose(moved, expected.density, rtol=2**-11, atol=1e-5)
        assert np.array_equal(moved, unmoved) == (number == 1)
    assert np.abs(expected.velocity[..., 0]).max() > 0.5


def dense(file, name):
    """A grid of a volume in the whole box."""
    grid = read_vdb(file)[name]
    values = np.zeros(SHAPE, np.float32)
    values[tuple(slice(o, o + n) for o, n in zip(grid.origin, grid.values.shape, strict=True))] = grid.values
    return values


def test_a_run_with_a_force_goes_on_with_it_alone(tmp_path):
    """Resumed with the force the files are the same to the bit; without it the run is refused, finished or not."""
    scene = replace(plume(frames=4), surfaces=())

    def stop(frame):
        if frame.number == 2:
            raise KeyboardInterrupt

    whole = ws.run(scene, tmp_path / "whole", on_substep=gust)
    with pytest.raises(KeyboardInterrupt):
        ws.run(scene, tmp_path / "cut", on_substep=gust, on_frame=stop, checkpoint_every=1)
    with pytest.raises(ValueError, match=r"another run: the script's on_substep is gone; allowed: the same"):
        ws.run(scene, tmp_path / "cut", resume=True)
    result = ws.run(scene, tmp_path / "cut", on_substep=gust, resume=True)
    assert result.report["resumed_after"] == 2
    for file in whole.folder.glob("volumes/*.vdb"):
        assert (result.folder / "volumes" / file.name).read_bytes() == file.read_bytes()


def test_a_force_needs_air_that_moves():
    """A plan that was made without it, in which it would never be called, is refused."""
    scene = ws.Scene(domains=[ws.SmokeDomain(path="/Smoke", resolution=16)], emitters=[held(density=SMOKE)])
    with pytest.raises(ValueError, match="/Smoke: on_substep is given"):
        ws.Simulation(make_plan(scene), on_substep=gust)
    ws.Simulation(make_plan(scene, "on_substep"), on_substep=gust).step()


def test_still_air_has_no_velocity():
    """It reads as zeros, whatever was written there, in the shapes of air that moves; assigning is refused."""
    simulation = ws.Simulation(scene([held(density=SMOKE)]))
    assert "still_air" not in simulation.launcher.allocated
    for _ in range(2):
        simulation.step()
        assert [each.shape for each in simulation.velocity] == [(17, 16, 16), (16, 17, 16), (16, 16, 17)]
        assert not any(each.numpy().any() for each in simulation.velocity)
        simulation.velocity[1].numpy()[...] = 7.0
    assert simulation.launcher.allocated["still_air"] == 4 * 3 * 17 * 16 * 16
    with pytest.raises(ValueError, match="/Smoke: velocity is written"):
        simulation.velocity = simulation.velocity


def test_same_bits_with_a_script():
    """With a force and arrays, results do not depend on the number of threads, nor on the run."""

    def stir(solver, time, dt):
        u, _, w = (component.numpy() for component in solver.state.velocity)
        u[...] += dt * np.sin(time + np.arange(16, dtype=np.float32))
        w[...] -= dt * 0.5

    emitters = [held(density=SMOKE, temperature=SMOKE)]
    solid = ws.ArrayCollider(path="/Solid", solid=np.roll(BALL, 6, axis=1) > 0)
    fields = []
    for threads in (1, 2, 7):
        simulation = ws.Simulation(scene(emitters, [solid], vorticity=0.5), threads=threads, on_substep=stir)
        for _ in range(4):
            simulation.step()
        fields.append([each.numpy().copy() for each in (simulation.density, *simulation.velocity)])
    for others in fields[1:]:
        for a, b in zip(fields[0], others, strict=True):
            np.testing.assert_array_equal(a.view(np.int32), b.view(np.int32))


def test_held_arrays():
    """Density and temperature are what the arrays say at the first frame; temperature where it departs from ambient."""
    temperature = np.where(BALL > 0, 3.0, 1.0)
    grids = ("density", "temperature")
    simulation = ws.Simulation(
        scene([held(density=SMOKE, temperature=temperature)], grids=grids, ambient_temperature=2.0)
    )
    smoke = simulation.step().smoke["/Smoke"]
    np.testing.assert_array_equal(smoke.density, SMOKE.astype(np.float32))
    np.testing.assert_array_equal(smoke.temperature, np.where(BALL > 0, 3.0, 1.0).astype(np.float32))


def test_rate_adds_mass():
    """Mass = rate · t · Σ density, whatever the substeps, and within them too; off, it adds nothing."""
    steady = held(density=SMOKE, rate=2.5, enabled=ws.Samples(np.array([1.0, 3.0]), np.array([True, False])))
    simulation = ws.Simulation(scene([steady], turbulence=1.0, max_courant=0.05))
    substeps = [simulation.step().steps.get("/Smoke") for _ in range(5)]
    assert substeps[1].substeps > 1
    # Advection in a closed box at these Courant numbers keeps mass to a per cent.
    assert simulation.density.numpy().sum() == pytest.approx(2.5 * (2 / 24) * SMOKE.sum(), rel=0.02)
    still = ws.Simulation(scene([replace(steady, enabled=ws.Samples([1.0, 1.4, 3.3], [False, True, False]))]))
    for _ in range(5):
        still.step()
    assert still.density.numpy().sum(dtype=float) == pytest.approx(2.5 * (1.9 / 24) * SMOKE.sum(), rel=1e-6)


def test_pushing_arrays():
    """Air takes the mean velocity of the cells beside each face; faster air and closed sides keep theirs."""
    velocity = np.zeros((*SHAPE, 3))
    velocity[..., 1] = np.where(BALL > 0, -2.0, 0.0)
    simulation = ws.Simulation(scene([held(density=SMOKE, velocity=velocity)]))
    u, v, w = simulation.velocity
    faster = np.zeros(v.shape)
    faster[:, 7] = -1.5
    v.assign(faster)
    simulation.step()
    assert not u.numpy().any()
    assert not w.numpy().any()
    expected = np.zeros(v.shape)
    expected[:, 1:-1] = 0.5 * (velocity[:, 1:, :, 1] + velocity[:, :-1, :, 1])
    np.testing.assert_array_equal(v.numpy(), np.minimum(expected, faster))


def test_warp_arrays_are_used_in_place():
    """What a script writes into a Warp array after the start is emitted; a NumPy array was copied."""
    density = wp.zeros(SHAPE, dtype=float, device="cpu")
    values = np.zeros(SHAPE, np.float32)
    simulation = ws.Simulation(scene([held(density=density), ws.ArrayEmitter(path="/Copied", density=values)]))
    assert not simulation.step().smoke["/Smoke"].density.any()
    density.fill_(0.25)
    values[...] = 7.0
    np.testing.assert_array_equal(simulation.step().smoke["/Smoke"].density, 0.25)


@pytest.mark.parametrize("form", ["mask", "distance"])
def test_solid_from_an_array_is_like_a_mesh(form):
    """A box whose sides lie on faces of cells makes the same plume to the bit from a mesh, a mask or a distance.

    Viscous air sticks to it.
    """
    inside = (abs(X - 8) < 3) & (abs(Y - 11) < 2) & (abs(Z - 8) < 3)
    distance = np.maximum(np.maximum(abs(X - 8) - 3, abs(Y - 11) - 2), abs(Z - 8) - 3) * H
    array = ws.ArrayCollider(path="/Box", solid=inside if form == "mask" else distance, friction=1.0)
    mesh = ws.Collider(path="/Box", mesh=ws.Mesh.box((6 * H, 4 * H, 6 * H)), transform=at(0, 3 * H, 0), friction=1.0)
    frames = []
    for collider in (array, mesh):
        simulation = ws.Simulation(scene([held(density=SMOKE, temperature=4 * SMOKE)], [collider], viscosity=0.01))
        frames.append([simulation.step() for _ in range(6)][-1].smoke["/Smoke"])
    assert frames[0].density.sum() > 0
    np.testing.assert_array_equal(frames[0].density, frames[1].density)
    np.testing.assert_array_equal(frames[0].velocity, frames[1].velocity)


def test_moving_solid_pushes_the_air():
    """A wall whose distance changes at 1.2 m/s moves the air of an open channel at that speed."""
    wall = (Y - 3.0) * H  # solid below 3 cells
    moved = ws.Samples(np.array([1.0, 25.0]), np.stack([wall, wall - 1.2]))
    domain = ws.SmokeDomain(path="/Smoke", resolution=16, boundary=(*("closed",) * 3, "open", *("closed",) * 2))
    collider = ws.ArrayCollider(path="/Wall", solid=moved)
    simulation = ws.Simulation(ws.Scene(domains=[domain], emitters=[held(density=SMOKE)], colliders=[collider]))
    for _ in range(4):
        simulation.step()
    np.testing.assert_allclose(simulation.velocity[1].numpy()[:, 5:], 1.2, rtol=2e-3)


def test_fields_are_written_in_place_and_by_assignment():
    """On the CPU a field's NumPy array is the field; assignment copies, and tells of a wrong shape or missing field."""
    simulation = ws.Simulation(scene([held(density=SMOKE, temperature=SMOKE)]))
    simulation.step()
    simulation.density.numpy()[...] = 0.5
    assert np.all(simulation.density.numpy() == 0.5)
    simulation.velocity = [np.full(each.shape, 2.0, np.float32) for each in simulation.velocity]
    simulation.temperature = wp.full(SHAPE, 3.0, dtype=float, device="cpu")
    assert np.all(simulation.velocity[2].numpy() == 2.0)
    assert np.all(simulation.temperature.numpy() == 3.0)
    with pytest.raises(ValueError, match=r"/Smoke: density is of shape"):
        simulation.density = np.zeros((2, 2, 2), np.float32)
    with pytest.raises(ValueError, match=r"/Smoke: velocity is written"):
        ws.Simulation(scene([held(density=SMOKE)])).velocity = simulation.velocity


BAD = {
    "shape": (dict(density=np.zeros((3, 4, 5))), r"/Array: density is an array \[3, 4, 5\]"),
    "flat": (dict(density=np.zeros(5)), r"/Array: density is an array \[5\]; allowed: an array \[nx, ny, nz\]"),
    "channels": (dict(velocity=np.zeros(SHAPE)), r"/Array: velocity is an array .*nx, ny, nz, 3"),
    "nan": (dict(temperature=np.full(SHAPE, np.nan)), "/Array: temperature is not finite"),
    "negative": (dict(density=-np.ones(SHAPE)), "/Array: density is -1.0; allowed: ≥ 0"),
    "rate": (dict(density=SMOKE, rate=-1.0), "/Array: rate"),
    "domain": (dict(density=SMOKE, domain="/Other"), "/Array: domain is /Other; allowed: None or one of /Smoke"),
    "type": (dict(density=wp.zeros(SHAPE, dtype=wp.float64, device="cpu")), "/Array: density .*float32"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_arrays(name):
    """An array that cannot be used raises one clear error with path and field."""
    fields, message = BAD[name]
    with pytest.raises(ValueError, match=message):
        ws.Simulation(scene([held(**fields)]))


def test_arrays_are_no_part_of_a_stage(tmp_path):
    """A scene with arrays is not saved without them: the error says which record."""
    with pytest.raises(ValueError, match="/Array: shape is arrays over cells"):
        scene([held(density=SMOKE)]).save(tmp_path / "scene.usda")


def test_a_mesh_and_an_array_together():
    """Emitters of both kinds make smoke in one domain."""
    both = plume(resolution=16)
    both = ws.Scene(domains=both.domains, emitters=[*both.emitters, held(density=np.full(SHAPE, 0.125))], end=2)
    density = ws.Simulation(both).step().smoke["/World/Smoke"].density
    assert density.max() == 1.0
    assert density.min() == 0.125
