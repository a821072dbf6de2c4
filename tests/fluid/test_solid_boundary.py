"""Advection beside solids: traces stop, smoke neither leaks nor darkens, and air slips along."""

from dataclasses import dataclass

import numpy as np
import pytest
import warp as wp

from warp_smoke import ArrayEmitter, Collider, Emitter, Mesh, Samples, Scene, Simulation, SmokeDomain
from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.grid import Box, face_shape
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.fluid.solid_boundary import SolidBoundary
from warp_smoke.fluid.solid_faces import empty_solids
from warp_smoke.fluid.trace import Displacement
from warp_smoke.lattice import place_lattice

SHAPE = (12, 13, 14)
CLOSED = ("closed",) * 6
SCHEMES = pytest.mark.parametrize("scheme", ADVECTION_SCHEMES)


@dataclass
class Cells:
    """Solids at rest, given cell by cell."""

    fluid: wp.array
    wx: wp.array
    wy: wp.array
    wz: wp.array
    velocity: None = None
    changes: int = 0

    @property
    def box(self) -> Box:
        """All cells, for any may be solid."""
        return Box((0, 0, 0), self.fluid.shape)

    @property
    def held(self) -> wp.array:
        """Cells of fluid, for nothing moves."""
        return self.fluid

    def update(self, start: float, end: float, seconds: float) -> None:
        """Stands still."""
        self.changes = 1


def _cells(upload, side: np.ndarray) -> Cells:
    """Cells are solid where `side` is 0, and faces are open between cells with the same sign."""
    shares = []
    for axis in range(3):
        share = np.zeros(face_shape(side.shape, axis))
        along = np.sign(np.moveaxis(side, axis, 0))
        np.moveaxis(share, axis, 0)[1:-1] = along[1:] * along[:-1] > 0
        shares.append(upload(share))
    return Cells(upload(side != 0), *shares)


def _boundary(launcher, solids):
    boundary = SolidBoundary(launcher, solids)
    boundary.move(1.0, 1.0, 0.0)
    return boundary


def _ways_to_solid(fluid: np.ndarray, points: np.ndarray, ways: np.ndarray, least: float) -> np.ndarray:
    """Share of each way [n, 3] from a point [n, 3] to the first solid cell, of those it runs through for `least`."""
    result = np.ones(len(points))
    for cell in np.argwhere(fluid == 0):
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort((cell - points + np.array([-0.5, 0.5])[:, None, None]) / ways, axis=0)
        enter, leave = ends[0].max(axis=1), ends[1].min(axis=1)
        hit = (enter > 0) & (enter < result) & (leave - enter > least)
        result[hit] = enter[hit]
    return result


@pytest.mark.parametrize("reach", [0.8, 6.0])
def test_traces_stop_at_the_first_solid(launcher, upload, reach):
    """Among random solids each trace is cut where it enters the first one, found by trying them all in float64."""
    rng = np.random.default_rng(1)
    fluid = (rng.uniform(size=SHAPE) > 0.1).astype(float)
    asked = rng.uniform(-reach, reach, (*SHAPE, 3)).astype(np.float32)
    back = Displacement()
    back.x, back.y, back.z = (upload(asked[..., axis]) for axis in range(3))
    _boundary(launcher, _cells(upload, fluid)).stop(back, back)
    free = fluid.ravel() > 0
    centres = np.stack(np.indices(SHAPE).reshape(3, -1), axis=1)[free].astype(float)
    asked = asked.reshape(-1, 3)[free].astype(float)
    way = back.x.numpy().ravel()[free] / asked[:, 0]
    # A trace through an edge or a corner may or may not count as entering the cell.
    early, late = (_ways_to_solid(fluid, centres, asked, least) for least in (-1e-4, 1e-4))
    assert 50 < np.sum(late < 1) < len(late) - 50
    assert np.all(way >= 0.998 * early)
    assert np.all(way <= np.where(late < 1, 0.9995 * late, 1.0))


def _walls() -> dict[str, np.ndarray]:
    """1 on one side of a wall, −1 on the other, 0 in walls that are a cell thick; others are closed faces alone."""
    i, j, k = np.indices(SHAPE)
    return {
        "flat": np.sign(i - 6),
        "diagonal": np.sign(i + j - 12),  # neighbours in the wall share an edge
        "corner": np.sign(i + j + k - 18),  # or less
        "flat faces": np.sign(i - 5.5),
        "diagonal faces": np.sign(i + j - 11.5),
        "corner faces": np.sign(i + j + k - 17.5),
    }


@SCHEMES
@pytest.mark.parametrize("wall", _walls())
@pytest.mark.parametrize("courant", [0.7, 5.0, 1000.0])
def test_thin_walls_do_not_leak(launcher, upload, scheme, wall, courant):
    """Blown about by any wind, smoke stays on its side of a wall, a cell or nothing thick: not one float leaks."""
    side = _walls()[wall]
    advection = ADVECTION_SCHEMES[scheme](launcher, SHAPE, CLOSED, _boundary(launcher, _cells(upload, side)))
    rng = np.random.default_rng(2)
    density = upload(np.where(side > 0, rng.uniform(0.5, 1.0, SHAPE), 0.0))
    for _ in range(5):
        wind = tuple(upload(rng.uniform(-1, 1, face_shape(SHAPE, axis))) for axis in range(3))
        advection.trace(wind, courant)
        density = advection.advect_scalar(density, 0.0)
    values = density.numpy()
    assert values[side > 0].min() >= 0.5 - 1e-6
    np.testing.assert_array_equal(values[side <= 0], 0.0)


@SCHEMES
def test_smoke_does_not_darken_beside_solids(launcher, upload, scheme):
    """Smoke of one density stays so next to solids, which hold none; temperature in them is ambient."""
    rng = np.random.default_rng(3)
    fluid = (rng.uniform(size=SHAPE) > 0.15).astype(float)
    advection = ADVECTION_SCHEMES[scheme](launcher, SHAPE, CLOSED, _boundary(launcher, _cells(upload, fluid)))
    wind = tuple(upload(rng.uniform(-1, 1, face_shape(SHAPE, axis))) for axis in range(3))
    density, temperature = upload(0.75 * fluid), upload(np.where(fluid, 5.0, 2.0))
    advection.trace(wind, 2.0)
    density, temperature = advection.advect_scalar(density, 0.0), advection.advect_scalar(temperature, 2.0)
    np.testing.assert_allclose(density.numpy(), 0.75 * fluid, rtol=1e-6)
    np.testing.assert_allclose(temperature.numpy(), np.where(fluid, 5.0, 2.0), rtol=1e-6)


@SCHEMES
def test_far_from_solids_nothing_changes(launcher, upload, scheme):
    """Cells whose traces stay away from solids get the same bits as without any."""
    rng = np.random.default_rng(4)
    fluid = np.ones(SHAPE)
    fluid[0, 0, 0] = 0.0
    start = rng.uniform(0, 1, SHAPE) * fluid
    wind = tuple(upload(rng.uniform(-1, 1, face_shape(SHAPE, axis))) for axis in range(3))
    results = []
    for boundary in (None, _boundary(launcher, _cells(upload, fluid))):
        advection = ADVECTION_SCHEMES[scheme](launcher, SHAPE, CLOSED, boundary)
        advection.trace(wind, 1.5)
        results.append(advection.advect_scalar(upload(start), 0.0).numpy())
    apart = np.max(np.indices(SHAPE), axis=0) > 4
    np.testing.assert_array_equal(results[0][apart], results[1][apart])


@SCHEMES
def test_moving_solid_leaves_no_hole(launcher, scheme):
    """Cells that a moving box uncovers take the smoke that follows it, not the nothing that was in the box."""
    domain = SmokeDomain(path="/Smoke", resolution=12, boundary=CLOSED)
    lattice = place_lattice(Scene(domains=[domain]), domain)
    step = 2 / 12
    places = [np.eye(4), np.eye(4)]
    places[1][3, 0] = step
    box = Collider(path="/Box", mesh=Mesh.box(4 * step), transform=Samples([1.0, 2.0], places))
    solids = Solids(launcher, lattice, [box])
    boundary = SolidBoundary(launcher, solids)
    boundary.move(1.0, 1.0, 0.0)
    before = solids.fluid.numpy().copy()
    advection = ADVECTION_SCHEMES[scheme](launcher, lattice.shape, CLOSED, boundary)
    density = launcher.array(np.float32(0.5) * before, "test")
    boundary.move(1.0, 2.0, 1.0)
    after = solids.fluid.numpy()
    np.testing.assert_array_equal(np.argwhere(before < after)[:, 0], 4)  # a layer is uncovered
    wind = tuple(launcher.zeros(face_shape(lattice.shape, axis), "test") for axis in range(3))
    wind[0].fill_(0.9)
    advection.trace(wind, 1.0)
    density = advection.advect_scalar(density, 0.0)
    np.testing.assert_allclose(density.numpy(), 0.5 * after, rtol=1e-6)


def test_air_slips_along_solids(launcher, upload):
    """A face between two solid cells takes the mean of the open faces around it; all others keep their value."""
    fluid = np.ones(SHAPE)
    fluid[:, :6, :] = 0.0  # a floor
    solids = _cells(upload, fluid)
    rng = np.random.default_rng(5)
    before = [rng.standard_normal(face_shape(SHAPE, axis)).astype(np.float32) for axis in range(3)]
    velocity = tuple(map(upload, before))
    _boundary(launcher, solids).extend(velocity)
    for axis, (component, old) in enumerate(zip(velocity, before, strict=True)):
        expected = old.copy()
        if axis == 0:
            expected[1:-1, 5] = old[1:-1, 6]
        if axis == 2:
            expected[:, 5, 1:-1] = old[:, 6, 1:-1]
        np.testing.assert_array_equal(component.numpy(), expected)


def test_empty(launcher, upload):
    """Solid cells become ambient, others stay."""
    rng = np.random.default_rng(6)
    fluid, values = (rng.uniform(size=SHAPE) > 0.5).astype(float), rng.uniform(size=SHAPE)
    field = upload(values)
    empty_solids(launcher, upload(fluid), field, 3.0)
    np.testing.assert_array_equal(field.numpy(), np.where(fluid > 0, values.astype(np.float32), 3.0))


@pytest.mark.parametrize("scheme", ["maccormack", "bfecc"])
def test_only_cells_near_solids_are_looked_at(launcher, monkeypatch, scheme):
    """Beside a moving ball the smoke is the same to the bit as if all traces were followed for solids."""
    places = [np.eye(4), np.eye(4)]
    places[0][3, 1], places[1][3, :2] = -0.2, (0.5, 0.2)
    ball = Collider(path="/Ball", mesh=Mesh.sphere(0.3, 16), transform=Samples([1.0, 5.0], places))
    source = Emitter(path="/Source", mesh=Mesh.sphere(0.3, 16), transform=places[0], velocity=(4.0, 0.0, 1.0))
    domain = SmokeDomain(path="/Smoke", resolution=24, advection=scheme, buoyancy_temperature=4.0)
    scene = Scene(domains=[domain], emitters=[source], colliders=[ball])
    results = []
    for _ in range(2):
        simulation = Simulation(scene)
        for _ in range(6):
            simulation.step()
        results.append([each.numpy().copy() for each in (simulation.density, *simulation.velocity)])
        monkeypatch.setattr(SolidBoundary, "follow", lambda self, courant: None)
    assert results[0][0].any()
    for near, everywhere in zip(*results, strict=True):
        np.testing.assert_array_equal(near, everywhere)


@SCHEMES
@pytest.mark.parametrize("thickness", [0.5, 0.01], ids=["thick", "thin"])
@pytest.mark.parametrize("courant", [0.5, 4.0])
def test_piston_displaces_what_leaves(scheme, thickness, courant):
    """In a channel that a piston fills, full of smoke, as much leaves at the open end as the piston displaces.

    Cells that it runs over are emptied, but the air flows away from it as fast, and cells ahead take what was there:
    to push smoke out of them as well would make it twice.
    """
    n, frames = 16, round(8 / courant)
    places = [np.eye(4), np.eye(4)]
    places[0][3, 0], places[1][3, 0] = -0.5 - thickness / 2, 0.5 - thickness / 2
    path = Samples([1.0, 1.0 + frames], places)
    piston = Collider(path="/Piston", mesh=Mesh.box((thickness, 4, 4)), transform=path)
    boundary = ("closed", "open", *CLOSED[2:])
    domain = SmokeDomain(path="/Smoke", resolution=n, boundary=boundary, advection=scheme, max_courant=courant)
    smoke = np.zeros((n, n, n), np.float32)
    smoke[4:] = 1.0
    source = ArrayEmitter(path="/Source", density=np.zeros_like(smoke))
    simulation = Simulation(Scene(domains=[domain], emitters=[source], colliders=[piston]))
    simulation.step()
    simulation.density = smoke
    for frame in range(1, frames + 1):
        simulation.step()
        left = 12 - 8 * frame / frames  # layers of cells ahead of the piston, to half a cell
        mass = simulation.density.numpy().sum(dtype=float) / n**2
        assert mass == pytest.approx(left, abs=0.5 + 1e-4)
    assert mass == pytest.approx(4.0, abs=1e-4)


@pytest.mark.parametrize("thickness", [0.5, 0.001], ids=["thick", "thin"])
def test_mass_of_uneven_smoke_beside_a_piston_converges(thickness):
    """A hump of smoke against a moving piston keeps its mass, with an error of first order in the size of the cells."""
    sizes, errors = (32, 64, 128), []
    for n in sizes:
        frames = n // 2  # half a cell each, over a quarter of the channel
        places = [np.eye(4), np.eye(4)]
        places[0][3, 0], places[1][3, 0] = -thickness / 2, 0.25 - thickness / 2
        path = Samples([1.0, 1.0 + frames], places)
        piston = Collider(path="/Piston", mesh=Mesh.box((thickness, 4, 4)), transform=path)
        upper, boundary = (1.0, 4 / n, 4 / n), ("closed", "open", *CLOSED[2:])
        domain = SmokeDomain(path="/Smoke", lower=(0.0, 0.0, 0.0), upper=upper, resolution=n, boundary=boundary)
        hump = np.exp(-((((np.arange(n) + 0.5) / n - 0.1) / 0.12) ** 2))
        smoke = np.broadcast_to(hump[:, None, None], (n, 4, 4)).astype(np.float32)
        source = ArrayEmitter(path="/Source", density=np.zeros_like(smoke))
        simulation = Simulation(Scene(domains=[domain], emitters=[source], colliders=[piston]))
        simulation.step()
        simulation.density = smoke
        for _ in range(frames):
            simulation.step()
        errors.append(abs(simulation.density.numpy().sum(dtype=float) / smoke.sum(dtype=float) - 1.0))
    order = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert order > 0.9  # measured 1.0 and 1.2
