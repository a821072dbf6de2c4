"""The active box: what it covers, that it cuts nothing off, and how little it changes."""

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from scenes import at, plume

import warp_smoke as ws
from warp_smoke.fluid.active_box import FAST, fit_boxes, hull
from warp_smoke.fluid.grid import Box, face_shape
from warp_smoke.fluid.measures import Measures
from warp_smoke.fluid.periodic_advection import PeriodicAdvection, advection_halo
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.fluid.solver import SmokeSolver
from warp_smoke.timing import Timings

SHAPE = (48, 40, 56)
STAGES = Path(__file__).parents[2] / "stages"


def test_boxes_reach_beyond_what_moves():
    """Multiples of 8 that reach at least courant + 2 cells beyond smoke, and farther beyond it and fast air."""
    smoke, fast = Box((20, 16, 24), (26, 24, 30)), Box((22, 16, 20), (24, 24, 40))
    air, scalars = fit_boxes(smoke, fast, 1.5, SHAPE)
    assert scalars == Box((16, 8, 16), (32, 32, 40))
    assert air == Box((8, 8, 8), (40, 32, 48))
    assert fit_boxes(smoke, fast, 1e9, SHAPE) == (Box((0, 0, 0), SHAPE),) * 2
    nothing = Box((0, 0, 0), (0, 0, 0))
    assert fit_boxes(None, None, 3.0, SHAPE) == (nothing, nothing)
    assert fit_boxes(None, fast, 1.5, SHAPE)[1] == nothing
    assert hull([smoke, None, fast]) == Box((20, 16, 20), (26, 24, 40))


@pytest.mark.parametrize("lower", [(0, 0, 0), (3, 9, 5), (39, 29, 49)])
def test_measures_find_what_departs(launcher, upload, lower):
    """One cell apart from ambient, one fast face: a box of that cell along i and k, of its eight rows along j."""
    measures = Measures(launcher, SHAPE)
    scalar = np.full(SHAPE, 2.0)
    scalar[lower] = 1.0
    scalar[0, 0, 0] += 0.5e-4  # below 1e-4 of the typical departure
    velocity = [np.zeros(face_shape(SHAPE, axis)) for axis in range(3)]
    velocity[0][lower], velocity[0][1, 1, 1] = 1.0, 0.2
    first = lower[1] // 8 * 8
    expected = Box((lower[0], first, lower[2]), (lower[0] + 1, min(first + 8, SHAPE[1]), lower[2] + 1))
    assert measures.departed(upload(scalar), 2.0, 1.0) == expected
    measures.motion(tuple(map(upload, velocity)))
    below = tuple(max(n - (axis == 0), 0) for axis, n in enumerate(expected.lower))  # a face has a cell on either side
    assert measures.fast_air(0.5) == Box(below, expected.upper)
    assert measures.departed(upload(np.full(SHAPE, 2.0)), 2.0, 1.0) is None


@pytest.mark.parametrize("scheme", ADVECTION_SCHEMES)
def test_carries_in_the_boxes_alone(launcher, upload, scheme):
    """Inside, to the bit what is carried without boxes, as far as traces stay inside; outside nothing changes."""
    rng = np.random.default_rng(1)
    velocity = [rng.uniform(-1, 1, face_shape(SHAPE, axis)) for axis in range(3)]
    scalar = rng.uniform(0, 1, SHAPE)
    results = []
    for boxes in (None, (Box((8, 8, 8), (40, 32, 48)), Box((16, 8, 16), (32, 24, 40)))):
        advection = ADVECTION_SCHEMES[scheme](launcher, SHAPE, ("open",) * 6)
        flow, field = tuple(map(upload, velocity)), upload(scalar)
        if boxes:
            # What was traced before in a larger box is forgotten.
            advection.trace(flow, 1.0)
            advection.activate(*boxes)
        advection.trace(flow, 1.0)
        carried = (*advection.advect_velocity(flow), advection.advect_scalar(field, 0.0))
        results.append([each.numpy() for each in carried])
    reach = 4  # of traces by less than a cell, both ways, with their stencils
    for axis, (before, whole, part) in enumerate(zip((*velocity, scalar), *results, strict=True)):
        air, smoke = boxes
        lower, upper = smoke if axis == 3 else air
        inside = tuple(slice(low + reach, high - reach) for low, high in zip(lower, upper, strict=True))
        np.testing.assert_array_equal(part[inside], whole[inside])
        assert np.any(part[inside] != before.astype(np.float32)[inside])
        outside = np.ones(before.shape, bool)
        outside[tuple(slice(low, high) for low, high in zip(lower, upper, strict=True))] = False
        for a in range(3):  # faces on open sides go on as the next inside
            np.moveaxis(outside, a, 0)[[0, -1]] = False
        np.testing.assert_array_equal(part[outside], before.astype(np.float32)[outside])


@pytest.mark.parametrize("scheme", ["maccormack", "bfecc"])
@pytest.mark.parametrize("sides", [("open",) * 6, ("closed", "closed", "periodic", "periodic", "open", "open")])
def test_reads_no_farther_than_traces_reach(launcher, upload, scheme, sides):
    """Who says how fast the air is saves copies of what no trace can reach, and changes no bit.

    In a second step, so that what was not copied is out of date.
    """
    rng = np.random.default_rng(1)
    velocity = [rng.uniform(-1, 1, face_shape(SHAPE, axis)) for axis in range(3)]
    velocity[1][:, -1] = velocity[1][:, 0]
    scalar, results = rng.uniform(0, 1, SHAPE), []
    halo = advection_halo(launcher, SHAPE, sides, 3.0)
    for courant in (inf, 3.0):
        advection = ADVECTION_SCHEMES[scheme](launcher, SHAPE, sides)
        if halo:
            advection = PeriodicAdvection(launcher, ADVECTION_SCHEMES[scheme], sides, halo)
        flow, field = tuple(map(upload, velocity)), upload(scalar)
        advection.activate(Box((16, 1, 16), (32, 17, 40)), Box((24, 2, 24), (32, 14, 32)))
        for _ in range(2):
            advection.trace(flow, 3.0, courant)
            flow, field = advection.advect_velocity(flow), advection.advect_scalar(field, 0.0)
        results.append([each.numpy().copy() for each in (*flow, field)])
    for far, near in zip(*results, strict=True):
        np.testing.assert_array_equal(near.view(np.int32), far.view(np.int32))


def _fields(scene: ws.Scene, frames: int, threads: int = 1) -> tuple[ws.Simulation, list[np.ndarray]]:
    simulation = ws.Simulation(scene, threads=threads)
    return simulation, [simulation.step().smoke["/World/Smoke"].density for _ in range(frames)]


def _roomy(**source) -> ws.Scene:
    """A plume of one tenth the width of its domain."""
    scene = plume(resolution=48, frames=40, lower=(-2, -1, -2), upper=(2, 3, 2), vorticity=0.3)
    return replace(scene, surfaces=(), emitters=[replace(scene.emitters[0], **source)])


def _switched_off(scene: ws.Scene) -> ws.Scene:
    return replace(scene, domains=[replace(scene.domains[0], active_box=False)])


MOVING = ws.Samples([1.0, 16.0], [at(-1.5, 0.5, 0.0), at(3.0, 1.5, 0.5)])
BALL = ws.Samples([1.0, 16.0], [at(-1.5, 1.0, 0.0), at(1.5, 1.0, 0.0)])
CASES = {
    "plume": _roomy(),
    "jet": _roomy(velocity=(0.0, 12.0, 3.0)),
    "leaving emitter": _roomy(transform=MOVING, inherit_velocity=0.3),
    "moving ball": replace(
        _roomy(), colliders=[ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3), transform=BALL)]
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_changes_little_and_cuts_nothing_off(case):
    """Density with the box on and off differs by 1 % in L2 at most, and its mass by 0.1 %, at every frame."""
    _, on = _fields(CASES[case], 16)
    _, off = _fields(_switched_off(CASES[case]), 16)
    for part, whole in zip(on, off, strict=True):
        assert np.linalg.norm(part - whole) <= 1e-2 * np.linalg.norm(whole)
        assert part.sum() == pytest.approx(whole.sum(), rel=1e-3)


def test_sixty_frames_of_the_plume():
    """The example's density differs by 0.1 % in L2 at most over 60 frames: five times what was measured."""
    scene = ws.Scene.open(STAGES / "plume.usda")
    scene = replace(scene, surfaces=(), lights=(), end=scene.start + 59)
    on, off = ws.Simulation(scene), ws.Simulation(_switched_off(scene))
    for _ in scene.frames:
        on.step()
        off.step()
        part, whole = on.density.numpy(), off.density.numpy()
        assert np.linalg.norm(part - whole) <= 1e-3 * np.linalg.norm(whole)
    assert whole.sum() > 0


def test_the_box_is_a_part_of_the_domain():
    """A small plume in a large domain: less than half of its cells are active, with no memory of their own."""
    on, _ = _fields(CASES["plume"], 3)
    off, _ = _fields(_switched_off(CASES["plume"]), 3)
    assert on.launcher.allocated == off.launcher.allocated
    assert "fit_active_box" in on.timings.seconds
    assert "fit_active_box" not in off.timings.seconds
    state, measures = on.solver().state, Measures(on.launcher, on.density.shape)
    smoke = measures.departed(state.density, 0.0, 1.0)
    measures.motion(state.velocity)
    for box in fit_boxes(smoke, measures.fast_air(FAST), 1.0, on.density.shape):
        assert np.prod(np.subtract(box.upper, box.lower)) < 0.5 * np.prod(on.density.shape)


def test_smoke_written_outside_is_taken_up():
    """A script puts hot smoke far away from the emitter: it rises as it does without the box."""
    moved = []
    for scene in (CASES["plume"], _switched_off(CASES["plume"])):
        simulation, _ = _fields(scene, 2)
        density = simulation.density.numpy().copy()
        density[38:44, 4:10, 38:44] = 1.0
        simulation.density.assign(density)
        heat = simulation.solver().state.temperature
        temperature = heat.numpy().copy()
        temperature[38:44, 4:10, 38:44] = 3.0
        heat.assign(temperature)
        for _ in range(8):
            frame = simulation.step()
        moved.append(frame.smoke["/World/Smoke"].density[34:48, :, 34:48])
    part, whole = moved
    heights = (part.sum(axis=(0, 2)) * np.arange(part.shape[1])).sum() / part.sum()
    assert heights > 8.0  # it began at 6.5
    assert np.linalg.norm(part - whole) <= 1e-2 * np.linalg.norm(whole)


def test_same_bits_for_any_number_of_threads():
    """1, 2 and 7 threads: the same bits, in boxes that grow."""
    results = [_fields(CASES["jet"], 5, threads)[1] for threads in (1, 2, 7)]
    for other in results[1:]:
        for a, b in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(a.view(np.int32), b.view(np.int32))


def test_a_new_solver_goes_on_with_the_same_boxes(launcher):
    """The boxes follow from the state alone: a new solver that is given it goes on with the same bits."""
    (plan,) = ws.make_plan(CASES["jet"]).domains
    first, second = (SmokeSolver(launcher, plan, Timings(launcher)) for _ in range(2))
    for solver, start in ((first, 1), (second, 4)):
        solver.begin(start)
    for frame in (1, 2, 3):
        first.advance(frame, frame + 1, 1 / 24)
    old, new = first.state, second.state
    for name in ("density", "temperature", "pressure"):
        getattr(new, name).assign(getattr(old, name).numpy())
    for source, target in zip(old.velocity, new.velocity, strict=True):
        target.assign(source.numpy())
    new.energy_lost = old.energy_lost
    for solver in (first, second):
        solver.advance(4, 5, 1 / 24)
    np.testing.assert_array_equal(first.state.density.numpy(), second.state.density.numpy())
