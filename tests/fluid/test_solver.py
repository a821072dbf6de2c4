"""The whole step: symmetries, limits, what is left out, and that nothing grows by itself."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scenes import at, plume

from warp_smoke import Collider, Emitter, Mesh, Samples, Scene, SmokeDomain, make_plan
from warp_smoke.fluid.measures import Measures
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.fluid.solver import SmokeSolver
from warp_smoke.launch import Launcher
from warp_smoke.timing import Timings

CLOSED = ("closed",) * 6


def make_solver(launcher, scene: Scene, **changes) -> SmokeSolver:
    """A solver of the scene's only domain; changes are made to its plan."""
    (plan,) = make_plan(scene).domains
    return SmokeSolver(launcher, replace(plan, **changes), Timings(launcher))


def run(launcher, scene: Scene, frames: int = 4, seconds: float = 1 / 12, **changes):
    """A solver after some frames, and their reports."""
    solver = make_solver(launcher, scene, **changes)
    solver.begin(1)
    return solver, [solver.advance(frame, frame + 1, seconds) for frame in range(1, frames + 1)]


def fields(solver: SmokeSolver) -> dict[str, np.ndarray]:
    """Copies of all fields."""
    state = solver.state
    found = {"density": state.density, "temperature": state.temperature}
    found |= dict(zip("uvw", state.velocity or (None,) * 3, strict=True))
    return {name: array.numpy().copy() for name, array in found.items() if array is not None}


def changed(scene: Scene, **domain) -> Scene:
    """The scene with changes to its only domain."""
    return replace(scene, domains=[replace(scene.domains[0], **domain)])


def lively(**domain) -> Scene:
    """A plume off the middle, with every effect that a domain without colliders has."""
    effects = {"buoyancy_density": 0.5, "vorticity": 0.3, "density_dissipation": 0.2, "temperature_cooling": 0.4}
    scene = changed(plume(resolution=20), **effects | domain)
    source = replace(scene.emitters[0], transform=at(0.2, 0.4, -0.1), velocity=(0.5, 1.0, -0.3))
    return replace(scene, emitters=[source])


def largest_difference(a: np.ndarray, b: np.ndarray) -> float:
    """Relative to the largest value."""
    return float(np.abs(a - b).max() / np.abs(b).max())


# A few float32 steps differ by about 1e-6, which a plume amplifies; a wrong sign or index is off by far more.
ROUND_OFF = 2e-5


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("advection", ADVECTION_SCHEMES)
def test_mirrored_scene_gives_mirrored_smoke(launcher, axis, advection):
    """Everything mirrored along an axis, the sides of the domain too: the smoke is mirrored, to round-off."""
    boundary = ("open", "closed", "closed", "open", "closed", "open")
    scene = lively(boundary=boundary, advection=advection)
    mirror = np.diag(np.where(np.arange(4) == axis, -1.0, 1.0))
    swapped = list(boundary)
    swapped[2 * axis], swapped[2 * axis + 1] = boundary[2 * axis + 1], boundary[2 * axis]
    (domain,), (source,) = scene.domains, scene.emitters
    # The domain stands at (0, 1, 0), and up is mirrored with it: so mirror about its own middle, and turn buoyancy.
    middle = at(0, 1, 0)
    flip = np.linalg.inv(middle) @ mirror @ middle
    sign = -1.0 if axis == 1 else 1.0
    other = replace(
        scene,
        domains=[
            replace(
                domain,
                boundary=swapped,
                buoyancy_density=sign * domain.buoyancy_density,
                buoyancy_temperature=sign * domain.buoyancy_temperature,
            )
        ],
        emitters=[
            replace(source, transform=source.transform @ flip, velocity=np.asarray(source.velocity) @ mirror[:3, :3])
        ],
    )
    (one, reports), (two, mirrored_reports) = run(launcher, scene), run(launcher, other)
    assert [r.substeps for r in reports] == [r.substeps for r in mirrored_reports]
    for name, values in fields(one).items():
        expected = np.flip(values, axis) * (-1.0 if name == "uvw"[axis] else 1.0)
        assert largest_difference(fields(two)[name], expected) < ROUND_OFF, name


def test_up_axis_only_names_the_axes(launcher):
    """The same scene with Z up instead of Y gives the same smoke, its axes permuted, to round-off."""
    boundary = ("open", "closed", "closed", "open", "closed", "open")
    scene = lively(boundary=boundary, active_box=False)  # the box is fitted to whole blocks of rows along one axis
    (domain,), (source,) = scene.domains, scene.emitters
    turn = np.eye(4)[[1, 2, 0, 3]]  # (x, y, z) becomes (z, x, y)
    other = replace(
        scene,
        up_axis="Z",
        domains=[replace(domain, transform=at(0, 0, 1), boundary=boundary[4:] + boundary[:4])],
        emitters=[
            replace(source, transform=source.transform @ turn, velocity=np.asarray(source.velocity) @ turn[:3, :3])
        ],
    )
    (one, _), (two, _) = run(launcher, scene), run(launcher, other)
    names = {"density": "density", "temperature": "temperature", "u": "v", "v": "w", "w": "u"}
    for name, values in fields(one).items():
        assert largest_difference(fields(two)[names[name]], values.transpose(2, 0, 1)) < ROUND_OFF, name


@pytest.mark.parametrize("metres", [0.001, 0.01, 1000.0])
def test_unit_of_length_does_not_matter(launcher, metres):
    """The scene in millimetres, its numbers 1000 times as large, gives the same smoke to round-off."""
    scene = lively()
    (domain,), (source,) = scene.domains, scene.emitters
    zoom = np.diag([1 / metres] * 3 + [1.0])
    other = replace(
        scene,
        meters_per_unit=metres,
        domains=[replace(domain, transform=domain.transform @ zoom)],
        emitters=[replace(source, transform=source.transform @ zoom)],
    )
    (one, _), (two, _) = run(launcher, scene), run(launcher, other)
    for name, values in fields(one).items():
        assert largest_difference(fields(two)[name], values) < ROUND_OFF, name


def obstacle(resolution: int = 20) -> Scene:
    """A plume and a ball that moves above its source."""
    path = Samples([1.0, 5.0], [at(-0.3, 1.2, 0), at(0.3, 1.2, 0)])
    scene = lively(resolution=resolution, viscosity=0.01, density_diffusion=0.001, wind=(0.5, 0.0, 0.2), turbulence=0.5)
    return replace(scene, colliders=[Collider(path="/World/Ball", mesh=Mesh.sphere(0.3, 16), transform=path)])


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads():
    """1, 2 and 7 threads: the same bits in every field after several steps around a moving ball."""
    results = [fields(run(Launcher("cpu", threads), obstacle(40), frames=3)[0]) for threads in (1, 2, 7)]
    for name, values in results[0].items():
        for other in results[1:]:
            np.testing.assert_array_equal(other[name].view(np.int32), values.view(np.int32), err_msg=name)


@pytest.mark.parametrize("scene", [lively(), obstacle()], ids=["plume", "obstacle"])
def test_state_is_all_that_lasts(launcher, scene):
    """A new solver that is given the state of another at a frame goes on with the same bits."""
    whole, _ = run(launcher, scene, frames=2)
    second = make_solver(launcher, scene)
    second.begin(3)
    old, new = whole.state, second.state
    pairs = [*zip(old.velocity, new.velocity, strict=True), (old.density, new.density)]
    for source, target in [*pairs, (old.temperature, new.temperature), (old.pressure, new.pressure)]:
        target.assign(source.numpy())
    new.energy_lost = old.energy_lost
    for solver in (whole, second):
        solver.advance(3, 4, 1 / 12)
        solver.advance(4, 5, 1 / 12)
    for name, values in fields(whole).items():
        np.testing.assert_array_equal(fields(second)[name], values, err_msg=name)


@pytest.mark.parametrize("limit", [0.5, 2.0])
def test_courant_number_is_respected(launcher, limit):
    """A jet that starts at once, and heat that accelerates: no advection is done with more than max_courant."""
    scene = lively(max_courant=limit)
    scene = replace(scene, emitters=[replace(scene.emitters[0], velocity=(0.0, 8.0, 0.0))])
    _, reports = run(launcher, scene)
    largest = max(report.courant for report in reports)
    assert 0.5 * limit < largest <= limit * 1.0001  # the limit itself is met to round-off
    assert all(report.substeps > 1 for report in reports[1:])
    assert all(status.converged for report in reports for status in report.pressure)


@pytest.mark.parametrize("advection", ADVECTION_SCHEMES)
@pytest.mark.parametrize("courant", [100.0, 10_000.0])
def test_huge_steps_stay_bounded(launcher, advection, courant):
    """Steps of a minute, Courant numbers of 100 and 10 000: finite, and within the range of ambient and source."""
    scene = lively(max_courant=courant, advection=advection, ambient_temperature=-1.0)
    solver, reports = run(launcher, scene, frames=3, seconds=60.0)
    assert max(report.courant for report in reports) > 0.1 * courant
    found = fields(solver)
    assert all(np.isfinite(values).all() for values in found.values())
    round_off = 1e-5
    assert found["density"].min() >= 0.0
    assert found["density"].max() <= 1.0 + round_off
    assert -1.0 - round_off <= found["temperature"].min() <= found["temperature"].max() <= 1.0 + round_off


FREE = ("emit_density", "confine_vorticity", "project_pressure", "advect_velocity", "advect_density")


@pytest.mark.parametrize("advection", ADVECTION_SCHEMES)
@pytest.mark.parametrize("vorticity", [0.0, 1.0, 1e6])
@pytest.mark.parametrize("courant", [0.5, 20.0])
def test_energy_never_grows_without_a_force(launcher, advection, courant, vorticity):
    """In a closed box, from a random flow, whatever ε: kinetic energy after projection never grows, to round-off.

    That is what a step leaves and what its advection lost: the next one's confinement may give that back, no more.
    """
    scene = plume(resolution=16, boundary=CLOSED, max_courant=courant, vorticity=vorticity)
    (plan,) = make_plan(scene).domains
    solver = SmokeSolver(launcher, replace(plan, passes=FREE, advection=advection), Timings(launcher))
    rng = np.random.default_rng(1)
    for component in solver.state.velocity:
        component.assign(rng.standard_normal(component.shape).astype(np.float32))
    measures = Measures(launcher, plan.lattice.shape)
    h, energies = plan.lattice.h, []
    for _ in range(12):
        speed, energy = measures.motion(solver.state.velocity)
        energies.append(energy + solver.state.energy_lost)
        solver.step(1, 2, courant * h / speed)
    assert np.all(np.diff(energies) <= 1e-6 * energies[0])
    assert energies[-1] > 0.0


def test_strength_of_zero_changes_nothing(launcher):
    """Passes of strength 0, forced into the plan, give the same bits as a plan without them."""
    scene = lively(vorticity=0.0, density_dissipation=0.0, temperature_cooling=0.0)
    (plan,) = make_plan(scene).domains
    effects = (
        "blow_wind",
        "stir_air",
        "confine_vorticity",
        "diffuse_velocity",
        "diffuse_density",
        "dissipate_density",
        "cool_temperature",
    )
    assert not set(effects) & set(plan.passes)
    one, _ = run(launcher, scene)
    two, _ = run(launcher, scene, passes=plan.passes + effects)
    for name, values in fields(one).items():
        np.testing.assert_array_equal(fields(two)[name], values, err_msg=name)


# By pass: kernels that only it launches, and a scene without it.
KERNELS = {
    "confine_vorticity": ({"_measure_vorticity", "_confine", "_measure_work"}, lively(vorticity=0.0)),
    "add_buoyancy": ({"_accelerate"}, lively(buoyancy_density=0.0, buoyancy_temperature=0.0, vorticity=0.0)),
    "emit_velocity": ({"_push"}, plume()),
    "blow_wind": ({"_let_in"}, lively()),
    "stir_air": ({"_fill_potential", "_stir"}, lively()),
    "diffuse_velocity": ({"_sweep_faces"}, lively()),
    "diffuse_density": ({"_sweep_cells"}, lively()),
    "dissipate_density": ({"_decay"}, lively(density_dissipation=0.0, temperature_cooling=0.0)),
    "voxelize_colliders": ({"_mark_obstructed", "_stop_at_solids", "_sample_near_solids", "_extend"}, lively()),
}


@pytest.mark.parametrize("left_out", KERNELS)
def test_left_out_passes_launch_nothing(device, left_out):
    """A pass that the plan leaves out launches none of its kernels; with it, all of them are launched."""
    kernels, without = KERNELS[left_out]
    launched = []
    for scene in (obstacle(), without):
        (plan,) = make_plan(scene).domains
        launcher = Launcher(device)
        run(launcher, scene, frames=2)
        launched.append(kernels & launcher.launches.keys())
        assert (left_out in plan.passes) == bool(launched[-1])
    assert launched == [kernels, set()]


def test_still_air_costs_nothing(device):
    """Where nothing moves the air, smoke is emitted and decays, exactly: no velocity, no pressure, no advection."""
    scene = changed(plume(), buoyancy_temperature=0.0, density_dissipation=0.5)
    source = replace(scene.emitters[0], enabled=Samples([1.0, 2.0], [True, False]))
    launcher = Launcher(device)
    solver, reports = run(launcher, replace(scene, emitters=[source]), frames=4, seconds=0.25)
    assert solver.state.velocity is None
    assert solver.state.pressure is None
    assert not {"velocity", "pressure", "advection", "temperature"} & launcher.allocated.keys()
    of_moving_air = {"trace_both_ways_by_midpoint", "_guess", "_measure_divergence_whole", "_measure_motion"}
    assert not of_moving_air & launcher.launches.keys()
    assert [report.pressure for report in reports] == [[]] * 4
    assert solver.state.density.numpy().max() == pytest.approx(np.exp(-0.5 * 4 * 0.25), rel=1e-6)
    run(launcher, plume(), frames=2)
    assert of_moving_air <= launcher.launches.keys()


@pytest.mark.parametrize("scene", [lively(), obstacle()], ids=["plume", "obstacle"])
def test_steps_allocate_nothing(device, scene):
    """After the first frame no step allocates on the device."""
    launcher = Launcher(device)
    solver, _ = run(launcher, scene, frames=1)
    before = dict(launcher.allocated)
    for frame in (2, 3):
        solver.advance(frame, frame + 1, 1 / 12)
    assert launcher.allocated == before


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("field", ["velocity", "density", "temperature"])
def test_stops_at_what_is_not_finite(launcher, field, bad):
    """A field that is not finite stops the run at once: path, field, place, frame, and what wrote it, are named."""
    solver, _ = run(launcher, lively(), frames=1)
    array = solver.state.velocity[1] if field == "velocity" else getattr(solver.state, field)
    values = array.numpy().copy()
    values[5, 6, 7] = bad
    array.assign(values)
    place = "on face v" if field == "velocity" else "in cell "
    line = f"/World/Smoke: {field} is {bad:g} {place}[5, 6, 7] at frame 3, after frame 2"
    with pytest.raises(FloatingPointError, match=f"^{re.escape(line)}$"):
        solver.advance(2, 3, 1 / 12)


@pytest.mark.parametrize("size", [(1.0, 1.0, 1.0), (0.01, 1.0, 1.0), (1.0, 0.01, 1.0), (1.0, 1.0, 0.001)])
@pytest.mark.parametrize("boundary", [None, CLOSED])
def test_thin_domains_run(launcher, size, boundary):
    """Single cells and sheets one cell thick run and stay finite and bounded."""
    domain = SmokeDomain(
        path="/Smoke",
        lower=tuple(-x for x in size),
        upper=size,
        resolution=1 if size == (1.0, 1.0, 1.0) else 12,
        boundary=boundary,
        vorticity=0.5,
    )
    emitter = Emitter(path="/Source", mesh=Mesh.box(1.0))
    solver, _ = run(launcher, Scene(domains=[domain], emitters=[emitter]), frames=3, seconds=0.25)
    found = fields(solver)
    assert all(np.isfinite(values).all() for values in found.values())
    assert 0.0 < found["density"].max() <= 1.0 + 1e-6


@pytest.mark.parametrize("solver", ["spectral", "jacobi"])
def test_diffusion_is_stable(launcher, solver):
    """Very viscous air and smoke that spreads at once: finite, no energy made, no negative smoke; the bound is told."""
    scene = lively(viscosity=1e6, density_diffusion=1e6, diffusion_solver=solver, boundary=("no_slip",) * 6)
    solver_at_work, reports = run(launcher, scene)
    found = fields(solver_at_work)
    assert all(np.isfinite(values).all() for values in found.values())
    assert 0.0 <= found["density"].min() <= found["density"].max() <= 1.0 + 1e-5
    assert (max(report.diffusion for report in reports) > 0.9) == (solver == "jacobi")  # 20 sweeps are too few


def test_diffusion_solvers_agree(launcher):
    """A viscous plume by enough sweeps is the one by exact diffusion, to what the sweeps leave and steps amplify."""
    scene = lively(viscosity=0.02, density_diffusion=0.01, diffusion_sweeps=500)
    one, _ = run(launcher, changed(scene, diffusion_solver="spectral"))
    two, _ = run(launcher, changed(scene, diffusion_solver="jacobi"))
    for name, values in fields(one).items():
        assert largest_difference(fields(two)[name], values) < 10 * ROUND_OFF, name


def test_smoke_spreads_in_still_air(launcher):
    """Where nothing moves the air, density diffusion alone acts: the puff's variance grows by 2 κ t along each axis."""
    scene = changed(plume(resolution=32), buoyancy_temperature=0.0, density_diffusion=0.01, boundary=CLOSED)
    source = replace(scene.emitters[0], transform=at(0, 1, 0), enabled=Samples([1.0, 2.0], [True, False]))
    solver = make_solver(launcher, replace(scene, emitters=[source]))
    solver.begin(1)

    def variance():
        density = solver.state.density.numpy().astype(float).sum(axis=(1, 2))
        x = (np.arange(32) + 0.5) / 16 - 1.0
        return (density * x * x).sum() / density.sum()

    before = variance()
    for frame in range(2, 6):
        solver.advance(frame, frame + 1, 0.25)
    assert solver.state.velocity is None
    assert variance() - before == pytest.approx(2 * 0.01 * 1.0, rel=0.01)  # little has reached the sides


def test_smoke_rises_around_a_ball(launcher):
    """Smoke passes a moving ball and gets above it; none is in the ball, from the first frame on."""
    scene = obstacle()
    solver = make_solver(launcher, scene)
    solver.begin(1)
    for frame in range(1, 5):
        density, fluid = solver.state.density.numpy(), solver.solids.fluid.numpy()
        assert fluid.min() == 0.0
        np.testing.assert_array_equal(density[fluid == 0], 0.0)
        solver.advance(frame, frame + 1, 1 / 2)
    assert solver.state.density.numpy()[:, 16, :].max() > 0.05
