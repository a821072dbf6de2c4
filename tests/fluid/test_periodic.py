"""Periodic domains: shifted scenes, flows across the seam with known answers, momentum, solids and emitters on it."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from staggered import PERIODIC, SLAB, random_velocity

from warp_smoke import Collider, Emitter, Mesh, Points, Samples, Scene, SmokeDomain, make_plan
from warp_smoke.fluid.grid import face_shape, ghost_samples
from warp_smoke.fluid.halo import Halo
from warp_smoke.fluid.operators import measure_divergence, subtract_gradient
from warp_smoke.fluid.pressure.spectral import SpectralPressure
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.fluid.solver import SmokeSolver
from warp_smoke.timing import Timings

FREE = ("emit_density", "diffuse_velocity", "project_pressure", "advect_velocity", "advect_density")


def _solver(launcher, scene, **changes):
    (plan,) = make_plan(scene).domains
    return SmokeSolver(launcher, replace(plan, **changes), Timings(launcher))


@pytest.mark.parametrize("axis", [None, 0, 1, 2])
@pytest.mark.parametrize(("shape", "width"), [((5, 4, 6), 3), ((2, 7, 1), 5)], ids=["thick", "thin"])
def test_ghosts_repeat_the_field(launcher, upload, axis, shape, width):
    """A padded field is NumPy's, wrapped along periodic axes, also where ghosts are deeper than the domain is thick."""
    halo = Halo(launcher, shape, SLAB, width)
    values = np.random.default_rng(1).standard_normal(shape).astype(np.float32)
    pads = [(width, width), (0, 0), (width, width)]
    expected = np.pad(values, pads, mode="wrap")
    if axis is not None:
        values = values.take(range(shape[axis] + 1), axis, mode="wrap")
        pads[axis] = (pads[axis][0], pads[axis][1] + 1)
        expected = np.pad(values.take(range(shape[axis]), axis), pads, mode="wrap")
    padded = halo.pad(upload(values), halo.zeros("test", axis), axis)
    np.testing.assert_array_equal(padded.numpy(), expected)
    back = launcher.zeros(values.shape, "test")
    halo.crop(padded, back)
    np.testing.assert_array_equal(back.numpy(), values)
    assert not ghost_samples(shape, (0, 0, 0), axis)


def _scene(shift, collider=None, mesh=None, **domain):
    """A hot, pushing ball of 1.1 m in a box of 4 × 4 × 4 m, 16³ cells, moved by so many cells."""
    matrix = np.eye(4)
    matrix[3, :3] = np.multiply(shift, 0.25)
    fields = {"temperature": 2.0, "velocity": (0.6, 0.9, -0.4), "rate": 4.0, "transform": matrix}
    emitter = Emitter(path="/Source", mesh=mesh or Mesh.sphere(0.55, 16), **fields)
    box = SmokeDomain(path="/Smoke", lower=(-2, -2, -2), upper=(2, 2, 2), resolution=16, **domain)
    colliders = [Collider(path="/Wall", mesh=collider, transform=matrix, friction=0.5)] if collider else []
    return Scene(domains=[box], emitters=[emitter], colliders=colliders)


def _fields(launcher, scene, frames=3):
    """Density, and u, v, w without the second copies of faces on periodic sides."""
    solver = _solver(launcher, scene)
    solver.begin(1)
    for frame in range(1, 1 + frames):
        solver.advance(frame, frame + 1, 0.2)
    shape = solver.state.density.shape
    inner = tuple(slice(0, n) for n in shape)
    return [each.numpy()[inner].copy() for each in (solver.state.density, *solver.state.velocity)]


PLATE = Mesh.box(0.5, lower=(-0.9, -0.6, -0.35))
POINTS = Points(points=np.array([[0.3, 0.1, 0.0], [-0.4, 0.0, 0.3]]), widths=np.array([0.7, 0.9]))
MORE = {"vorticity": 0.3, "viscosity": 0.02, "density_diffusion": 0.01}


@pytest.mark.parametrize(
    ("collider", "mesh", "domain"),
    [
        (None, None, {}),
        (None, None, MORE),
        (None, None, MORE | {"diffusion_solver": "jacobi", "advection": "bfecc", "pressure_solver": "multigrid"}),
        (None, POINTS, {"advection": "semi_lagrangian_cubic", "active_box": False}),
        (PLATE, None, MORE),
        (PLATE, None, {"pressure_solver": "red_black", "advection": "semi_lagrangian"}),
    ],
    ids=["plain", "more", "other", "points", "plate", "relaxed"],
)
def test_shifted_scene_gives_shifted_smoke(launcher, collider, mesh, domain):
    """In a periodic box, all of it moved by whole cells across the seams gives the same smoke, moved."""
    options = {"boundary": PERIODIC, "pressure_tolerance": 1e-6} | domain
    here = _fields(launcher, _scene((0, 0, 0), collider, mesh, **options))
    there = _fields(launcher, _scene((8, -6, 7), collider, mesh, **options))
    assert here[0].max() > 0.5
    for one, other in zip(here, there, strict=True):
        # Round-off, and the pressure's residual, which the plume amplifies a little.
        np.testing.assert_allclose(other, np.roll(one, (8, -6, 7), axis=(0, 1, 2)), atol=2e-4 * np.abs(one).max())


def test_moving_wall_crosses_the_seam(launcher):
    """A ball that leaves the box on one side pushes the air on the other, like one that was there all the time."""
    results = []
    for start in (0.0, 4.0):  # a whole box apart
        places = np.array([np.eye(4), np.eye(4)])
        places[:, 3, 0] = start + 1.0, start + 2.6
        ball = Collider(path="/Ball", mesh=Mesh.sphere(0.6, 16), transform=Samples(np.array([1.0, 5.0]), places))
        scene = _scene((0, 0, 0), boundary=PERIODIC, pressure_tolerance=1e-6)
        results.append(_fields(launcher, replace(scene, colliders=[ball])))
    for one, other in zip(*results, strict=True):
        np.testing.assert_allclose(other, one, atol=2e-4 * np.abs(one).max())


def test_uniform_heat_rises_freely(launcher):
    """In a periodic box nothing holds air of one temperature: v = β ΔT t everywhere, and u = w = 0."""
    box = SmokeDomain(path="/Smoke", resolution=12, boundary=PERIODIC, buoyancy_temperature=3.0)
    scene = Scene(domains=[box], emitters=[Emitter(path="/Source", mesh=Mesh.box(4.0), temperature=0.5)])
    solver = _solver(launcher, scene)
    solver.begin(1)
    for frame in range(1, 6):
        solver.advance(frame, frame + 1, 0.1)
    u, v, w = (component.numpy() for component in solver.state.velocity)
    np.testing.assert_allclose(v, 3.0 * 0.5 * 0.5, rtol=1e-5)
    assert max(np.abs(u).max(), np.abs(w).max()) < 1e-6


def _vortex(x, y, drift, viscosity, time):
    """Taylor and Green's vortices in the unit square, carried along by a drift."""
    x, y = 2 * np.pi * (x - drift[0] * time), 2 * np.pi * (y - drift[1] * time)
    decay = np.exp(-8 * viscosity * np.pi**2 * time)
    return drift[0] + decay * np.sin(x) * np.cos(y), drift[1] - decay * np.cos(x) * np.sin(y)


def _drifting_vortex(launcher, n, advection, drift=(1.0, 0.7)):
    """Root mean square error of u after 0.4 s at ν = 0.02, and the change of the mean velocity."""
    box = SmokeDomain(
        path="/Smoke", lower=(0, 0, 0), upper=(1, 1, 1 / n), resolution=n, boundary=PERIODIC, viscosity=0.02
    )
    scene = Scene(domains=[box], emitters=[Emitter(path="/Source", mesh=Mesh.box(1.0), velocity=(1, 0, 0))])
    solver = _solver(launcher, scene, passes=FREE, emitters=(), advection=advection)
    face, cell = np.arange(n + 1) / n, (np.arange(n) + 0.5) / n
    for component, x, y, axis in zip(solver.state.velocity[:2], (face, cell), (cell, face), (0, 1), strict=True):
        component.assign(_vortex(x[:, None], y[None], drift, 0.02, 0.0)[axis][..., None].astype(np.float32))
    steps = n**2 // 16
    for _ in range(steps):
        solver.step(1, 2, 0.4 / steps)
    u, v = (component.numpy()[..., 0].astype(float) for component in solver.state.velocity[:2])
    np.testing.assert_array_equal(u[0], u[-1])
    exact = _vortex(face[:, None], cell[None], drift, 0.02, 0.4)[0]
    return float(np.sqrt(((u - exact) ** 2).mean())), max(
        abs(u[:-1].mean() - drift[0]), abs(v[:, :-1].mean() - drift[1])
    )


def test_drifting_vortices(launcher):
    """Vortices that decay while they drift across the seams are reached with order 2, and the drift is kept."""
    sizes = [12, 24, 48]
    results = [_drifting_vortex(launcher, n, "maccormack") for n in sizes]
    errors, drifts = zip(*results, strict=True)
    assert -np.polyfit(np.log(sizes), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.25)
    assert max(drifts) < 2e-3  # the scheme does not conserve momentum to round-off


def test_projection_keeps_momentum(launcher):
    """Σ u, Σ v and Σ w over the faces of a periodic box are the same before and after the pressure, to round-off."""
    shape = (12, 9, 10)
    velocity = random_velocity(launcher, shape, sides=PERIODIC)
    inner = tuple(slice(0, n) for n in shape)
    before = [component.numpy()[inner].sum(dtype=float) for component in velocity]
    divergence, pressure = launcher.zeros(shape, "test"), launcher.zeros(shape, "test")
    measure_divergence(launcher, velocity, divergence)
    SpectralPressure(launcher, shape, PERIODIC).solve(divergence, pressure)
    subtract_gradient(launcher, pressure, PERIODIC, velocity)
    after = [component.numpy()[inner].sum(dtype=float) for component in velocity]
    np.testing.assert_allclose(after, before, atol=1e-4)  # 1080 numbers with errors of 1e-7


@pytest.mark.parametrize("scheme", ADVECTION_SCHEMES)
def test_whole_cells_around_the_box(launcher, scheme):
    """Drift by whole cells carries smoke once around the box and back to where it was, to the bit."""
    box = SmokeDomain(path="/Smoke", lower=(0, 0, 0), upper=(8, 6, 7), resolution=8, boundary=PERIODIC)
    scene = Scene(domains=[box], emitters=[Emitter(path="/Source", mesh=Mesh.box(1.0), velocity=(1, 0, 0))])
    solver = _solver(launcher, scene, passes=FREE, emitters=(), advection=scheme)
    for component, speed in zip(solver.state.velocity, (2.0, -1.0, 3.0), strict=True):
        component.fill_(speed)
    before = np.random.default_rng(2).uniform(size=(8, 6, 7)).astype(np.float32)
    solver.state.density.assign(before)
    for step in range(1, 4):
        solver.step(1, 2, 1.0)
        moved = np.roll(before, (2 * step, -step, 3 * step), axis=(0, 1, 2))
        np.testing.assert_array_equal(solver.state.density.numpy(), moved)
    assert [component.shape for component in solver.state.velocity] == [face_shape((8, 6, 7), a) for a in range(3)]


def _channel(launcher, friction, cells=12, **domain):
    """A flow along x between two plates in a periodic box, `cells` apart."""
    n = cells + 8
    box = SmokeDomain(
        path="/Smoke", lower=(0, 0, 0), upper=(0.2, 1, 0.1), resolution=n, boundary=PERIODIC, viscosity=0.05, **domain
    )
    plates = [
        Collider(path=f"/Plate{number}", mesh=Mesh.box((1.0, 4 / n, 1.0), lower=(-0.4, low, -0.4)), friction=friction)
        for number, low in enumerate((0.0, 1.0 - 4 / n))
    ]
    emitter = Emitter(path="/Source", mesh=Mesh.box(1.0), velocity=(1, 0, 0))
    scene = Scene(domains=[box], emitters=[emitter], colliders=plates)
    solver = _solver(launcher, scene, passes=("voxelize_colliders", *FREE), emitters=(), diffusion_solver="jacobi")
    solver.begin(1)
    return solver, n


@pytest.mark.parametrize("friction", [0.0, 1.0])
def test_flow_between_plates(launcher, friction):
    """Without friction a plug flow lasts; with friction 1, u = sin(π y / H) decays by e^(−ν π² t / H²)."""
    solver, n = _channel(launcher, friction)
    cells, dt, steps = n - 8, 0.01, 20
    y = (np.arange(cells) + 0.5) / cells
    profile = np.sin(np.pi * y) if friction else np.ones(cells)
    u = np.zeros(solver.state.velocity[0].shape, np.float32)
    u[:, 4:-4] = profile[None, :, None]
    solver.state.velocity[0].assign(u)
    for _ in range(steps):
        solver.step(1, 2, dt)
    found = solver.state.velocity[0].numpy()[:, 4:-4]
    r = 0.05 * dt * n**2
    discrete = (1.0 + r * (2.0 - 2.0 * np.cos(np.pi / cells))) ** -steps if friction else 1.0
    np.testing.assert_allclose(found, np.broadcast_to((discrete * profile)[None, :, None], found.shape), atol=2e-5)
    if friction:  # the difference is the implicit step's, ½ (ν π² dt / H²)² each time
        rate = 0.05 * np.pi**2 / (cells / n) ** 2
        assert discrete == pytest.approx(np.exp(-rate * dt * steps), rel=0.02)


def test_more_friction_holds_back_more(launcher):
    """A plug flow between plates is slowed down the more, the greater their friction is."""
    left = []
    for friction in (0.0, 0.25, 0.5, 1.0):
        solver, _ = _channel(launcher, friction)
        u = np.zeros(solver.state.velocity[0].shape, np.float32)
        u[:, 4:-4] = 1.0
        solver.state.velocity[0].assign(u)
        solver.step(1, 2, 0.1)
        left.append(solver.state.velocity[0].numpy()[:, 4:-4].mean())
    assert left[0] == pytest.approx(1.0, abs=1e-5)
    assert all(b < a - 0.01 for a, b in pairwise(left))


@pytest.mark.parametrize("solver_name", ["spectral", "jacobi"])
@pytest.mark.parametrize("boundary", [("open",) * 6, PERIODIC], ids=["open", "periodic"])
def test_heat_spreads_as_a_gaussian(launcher, solver_name, boundary):
    """In still air of 5 degrees a Gaussian of heat stays one, with σ² + 2 κ t, by the rules of linear diffusion."""
    n, kappa, time, steps = 40, 0.02, 0.5, 40
    box = SmokeDomain(
        path="/Smoke",
        lower=(0, 0, 0),
        upper=(2, 2, 0.05),
        resolution=n,
        boundary=boundary[:4] + PERIODIC[4:],
        ambient_temperature=5.0,
        buoyancy_temperature=0.0,
        temperature_diffusion=kappa,
        diffusion_solver=solver_name,
        diffusion_sweeps=1000,
        grids=("density", "temperature"),
    )
    scene = Scene(domains=[box], emitters=[Emitter(path="/Source", mesh=Mesh.box(1.0), temperature=9.0)])
    solver = _solver(launcher, scene, emitters=())
    x = (np.arange(n) + 0.5) / 20 - 1.0
    square = (x[:, None] ** 2 + x**2)[..., None]

    def gaussian(variance):
        return 5.0 + 0.01 / variance * np.exp(-square / (2 * variance))

    solver.state.temperature.assign(gaussian(0.02).astype(np.float32))
    for _ in range(steps):
        solver.step(1, 2, time / steps)
    found = solver.state.temperature.numpy()
    exact = gaussian(0.02 + 2 * kappa * time)
    # Second order in space, (h / σ)² / 8 = 0.015 at first, and first in time, of a hill 0.25 high.
    np.testing.assert_allclose(found, exact, atol=5e-3)
    assert found.min() >= 5.0 - 1e-5
