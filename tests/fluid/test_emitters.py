"""Emitters: what is held, how much a rate adds, and that a moving one leaves neither gaps nor extra mass."""

from itertools import pairwise

import numpy as np
import pytest

from warp_smoke import Emitter, Mesh, Samples, Scene, SmokeDomain
from warp_smoke.fluid.emitters import Source
from warp_smoke.fluid.grid import face_shape
from warp_smoke.lattice import place_lattice

N = 16  # cells along each side of a domain of 2 × 2 × 2 stage units: h = 1/8
H = 2 / N
SHARE = 5e-6  # how well a cell's share inside a mesh is known in float32


def _moved(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[3, :3] = x, y, z
    return matrix


def _lattice(boundary=("open",) * 6, transform=None):
    domain = SmokeDomain(
        path="/Smoke", resolution=N, boundary=boundary, transform=np.eye(4) if transform is None else transform
    )
    return place_lattice(Scene(domains=[domain]), domain)


def _source(launcher, lattice=None, **fields):
    """An emitter of 4 × 4 × 4 whole cells from cell (4, 4, 4) on, unless another mesh is given."""
    fields = {"mesh": Mesh.box(4 * H, lower=(-0.5, -0.5, -0.5))} | fields
    return Source(launcher, lattice or _lattice(), Emitter(path="/Source", **fields))


def _emit_density(source, density, start=1.0, end=2.0, dt=0.04):
    for interval in source.sweep(start, end, dt):
        source.place(interval)
        source.emit_density(interval, density)


INSIDE = (slice(4, 8),) * 3


def test_holds_its_density(launcher, upload):
    """Whole cells inside get the density, others stay; denser smoke stays; doing it again changes nothing."""
    values = np.random.default_rng(1).uniform(0.0, 2.0, (N, N, N)).astype(np.float32)
    density, source = upload(values), _source(launcher, density=1.25)
    _emit_density(source, density)
    expected = values.copy()
    expected[INSIDE] = np.maximum(values[INSIDE], np.float32(1.25))
    np.testing.assert_allclose(density.numpy(), expected, rtol=SHARE)
    once = density.numpy().copy()
    _emit_density(source, density)
    np.testing.assert_array_equal(density.numpy(), once)


@pytest.mark.parametrize("value", [5.0, -5.0])
def test_holds_what_departs_further(launcher, upload, value):
    """Hot or cold, a temperature replaces what departs less from ambient, on whichever side of it that is."""
    ambient = 1.0
    before = np.array([-9.0, -4.0, 0.0, 1.0, 2.0, 6.0, 9.0, 1.0], np.float32)
    temperature = upload(np.broadcast_to(np.tile(before, 2)[:, None, None], (N, N, N)))
    source = _source(launcher, mesh=Mesh.box(2.0), temperature=value)
    (interval,) = source.sweep(1.0, 2.0, 0.04)
    source.place(interval)
    source.emit_temperature(interval, temperature, ambient)
    expected = np.where(abs(value - ambient) > np.abs(before - ambient), np.float32(value), before)
    np.testing.assert_allclose(temperature.numpy()[:8, 5, 5], expected, rtol=SHARE)


def test_cells_count_by_their_share(launcher):
    """A box whose faces run through the middle of cells gives half the density there, a quarter at edges."""
    density = launcher.zeros((N, N, N), "test")
    _emit_density(_source(launcher, mesh=Mesh.box(5 * H, lower=(-0.5 + H / 2,) * 3)), density)
    profile = density.numpy()[:, 6, 6]
    np.testing.assert_allclose(profile[3:11], [0, 0.5, 1, 1, 1, 1, 0.5, 0], atol=SHARE)


CHANGES = {
    "constant": {"rate": 2.0},
    "rising": {"rate": Samples([1.0, 2.0], [0.0, 4.0])},
    "up and down": {"rate": Samples([1.0, 1.3, 2.0], [0.0, 4.0, 0.0])},
    "on and off": {"rate": 4.0, "enabled": Samples([1.0, 1.2, 1.7], [False, True, False])},
    "moving, on and off": {
        "rate": 4.0,
        "enabled": Samples([1.0, 1.2, 1.7], [False, True, False]),
        "transform": Samples([1.0, 2.0], [_moved(0, 0, 0), _moved(0.5, 0.25, 0)]),
    },
}


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
@pytest.mark.parametrize("steps", [1, 2, 7])
def test_rate_adds_the_same_mass_for_any_number_of_steps(launcher, changes, steps, record_property):
    """Mass = mean rate · dt · density · volume, however the rate rises and falls or is switched within a step."""
    density = launcher.zeros((N, N, N), "test")
    source = _source(launcher, density=3.0, **changes)
    times = np.linspace(1.0, 2.0, steps + 1)
    for start, end in pairwise(times):
        _emit_density(source, density, start, end, 0.5 / steps)
    mass, expected = density.numpy().sum(dtype=float) * H**3, 2.0 * 0.5 * 3.0 * (4 * H) ** 3
    record_property("mass off by a share of", float(abs(mass / expected - 1.0)))
    assert mass == pytest.approx(expected, rel=1e-5)


def test_moving_rate_adds_the_same_mass(launcher):
    """An emitter that crosses half of the domain in one step adds the mass of one that stands still."""
    path = Samples([1.0, 2.0], [_moved(0, 0, 0), _moved(0.5, 0.25, 0)])
    density = launcher.zeros((N, N, N), "test")
    _emit_density(_source(launcher, rate=2.0, transform=path), density, dt=0.5)
    assert density.numpy().sum(dtype=float) * H**3 == pytest.approx(2.0 * 0.5 * (4 * H) ** 3, rel=1e-4)


@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize("radius", [0.3 * H, 2.3 * H], ids=["small", "large"])
def test_moving_ball_adds_its_mass(launcher, radius, steps, record_property):
    """Mass = rate · dt · density · volume of the mesh, wherever the ball is, however small, for any number of steps."""
    path = Samples([1.0, 2.0], [_moved(-0.41, 0.03, 0.11), _moved(0.37, 0.25, -0.07)])
    density, ball = launcher.zeros((N, N, N), "test"), Mesh.sphere(radius)
    source = _source(launcher, mesh=ball, rate=2.0, transform=path)
    for start, end in pairwise(np.linspace(1.0, 2.0, steps + 1)):
        _emit_density(source, density, start, end, 0.5 / steps)
    a, b, c = (ball.points[ball.triangles[:, n]].astype(float) for n in range(3))
    volume = np.einsum("ni,ni", a, np.cross(b, c)) / 6
    mass, expected = density.numpy().sum(dtype=float) * H**3, 2.0 * 0.5 * volume
    record_property("mass off by a share of", float(abs(mass / expected - 1.0)))
    assert mass == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("height", [0.0, 0.3 * H, 0.5 * H])
def test_skin_of_a_sheet(launcher, height):
    """A sheet across the domain, which has no inside, makes a layer of smoke one voxel thick, wherever it lies."""
    density, sheet = launcher.zeros((N, N, N), "test"), Mesh.grid((-5, height, -5), (10, 0, 0), (0, 0, 10))
    _emit_density(_source(launcher, mesh=sheet, source="surface"), density)
    # Cells count behind planes of which no direction cosine is less than 1e-5.
    np.testing.assert_allclose(density.numpy().sum(axis=1), 1.0, atol=1e-4)
    assert np.count_nonzero(density.numpy().max(axis=(0, 2)) > 1e-4) == 1 + (height != 0.5 * H)


def test_moving_emitter_leaves_no_gaps(launcher):
    """A ball of one cell's radius that crosses the domain in one step leaves a line of smoke without holes."""
    path = Samples([1.0, 2.0], [_moved(-0.75, 0.05, 0.05), _moved(0.75, 0.05, 0.05)])
    density = launcher.zeros((N, N, N), "test")
    _emit_density(_source(launcher, mesh=Mesh.sphere(H), transform=path), density)
    along = density.numpy()[:, 8, 8]
    assert along[3:14].min() > 0.8
    assert along[0] == along[-1] == 0.0


def test_switch_and_place(launcher):
    """Nothing is emitted while the emitter is off, or where its mesh lies outside the domain."""
    density = launcher.zeros((N, N, N), "test")
    off = _source(launcher, enabled=Samples([1.0, 2.0, 3.0], [False, False, True]))
    _emit_density(off, density, 1.0, 2.0)
    _emit_density(_source(launcher, transform=_moved(5, 0, 0)), density)
    assert not density.numpy().any()
    _emit_density(off, density, 2.0, 3.0)
    assert density.numpy()[INSIDE].all()


def _pushed(launcher, source, start=1.0, end=2.0, dt=0.5):
    velocity = tuple(launcher.zeros(face_shape((N, N, N), axis), "test") for axis in range(3))
    for interval in source.sweep(start, end, dt):
        source.place(interval)
        source.emit_velocity(interval, velocity)
    return [component.numpy() for component in velocity]


def test_velocity_follows_the_lattice(launcher):
    """A velocity along the stage's axes is turned into those of the lattice; faces count by their share inside."""
    turn = np.eye(4)
    turn[:3, :3] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]  # the lattice's i runs along the stage's +y, j along −x
    source = _source(launcher, lattice=_lattice(transform=turn), mesh=Mesh.box(4 * H), velocity=(1.0, 2.0, 3.0))
    assert source.pushes
    u, v, w = _pushed(launcher, source)
    assert (u[8, 8, 8], v[8, 8, 8], w[8, 8, 8]) == pytest.approx((2.0, -1.0, 3.0))
    np.testing.assert_allclose(u[5:13, 8, 8], [0, 1, 2, 2, 2, 1, 0, 0], atol=SHARE)


def test_velocity_is_held_in_its_own_direction(launcher, upload):
    """Each component replaces what is slower that way or moves the other way; 0 changes nothing; twice is once."""
    before = np.array([-3.0, -1.0, 0.0, 0.5, 1.0, 2.0, 4.0, 0.0], np.float32)
    values = [np.resize(before, face_shape((N, N, N), axis)).astype(np.float32) for axis in range(3)]
    velocity = tuple(upload(each) for each in values)
    source = _source(launcher, mesh=Mesh.box(4.0), velocity=(1.0, 0.0, -2.0))
    (interval,) = source.sweep(1.0, 2.0, 0.5)
    source.place(interval)
    inside = (slice(1, -1),) * 3  # faces on the sides are half outside
    for _ in range(2):
        source.emit_velocity(interval, velocity)
        u, v, w = (component.numpy() for component in velocity)
        np.testing.assert_array_equal(u[inside], np.maximum(values[0], 1.0)[inside])
        np.testing.assert_array_equal(v, values[1])
        np.testing.assert_array_equal(w[inside], np.minimum(values[2], -2.0)[inside])


def test_moving_emitter_lets_its_smoke_rise(launcher, upload):
    """An emitter that moves along x alone leaves what has begun to rise inside it as it is."""
    path = Samples([1.0, 2.0], [_moved(0, 0, 0), _moved(0.1, 0, 0)])
    rising = np.full(face_shape((N, N, N), 1), 0.7, np.float32)
    velocity = tuple(upload(np.zeros(face_shape((N, N, N), axis)) if axis != 1 else rising) for axis in range(3))
    source = _source(launcher, transform=path)
    (interval,) = source.sweep(1.0, 2.0, 0.5)
    source.place(interval)
    source.emit_velocity(interval, velocity)
    np.testing.assert_array_equal(velocity[1].numpy(), rising)
    assert velocity[0].numpy()[6, 6, 6] == pytest.approx(0.2, rel=1e-4)


def test_motion_is_inherited(launcher):
    """Air inside gets the emitter's own velocity plus its share of the motion, metres per second of smoke."""
    path = Samples([1.0, 2.0], [_moved(0, 0, 0), _moved(0.1, 0, -0.05)])  # less than a cell
    source = _source(launcher, transform=path, velocity=(0.0, 0.25, 0.0), inherit_velocity=0.5)
    u, v, w = _pushed(launcher, source, dt=0.5)
    assert (u[6, 6, 6], v[6, 6, 6], w[6, 6, 6]) == pytest.approx((0.5 * 0.1 / 0.5, 0.25, -0.5 * 0.05 / 0.5), rel=1e-4)
    assert not _source(launcher, transform=path, inherit_velocity=0.0).pushes
    assert not _source(launcher).pushes


def test_a_turn_at_the_end_of_a_step_makes_no_part_of_its_own(launcher):
    """A switch that rounding puts just inside a step leaves it whole: over 1e-15 s a motion would be noise."""
    path = Samples([1.0, 2.0], [_moved(0, 0, 0), _moved(0.1, 0, -0.05)])
    for switch in (np.nextafter(1.0, 2.0), np.nextafter(1.5, 1.0)):
        changes = {"enabled": Samples([0.0, switch], [False, True]), "transform": path}
        source = _source(launcher, rate=2.0, inherit_velocity=1.0, **changes)
        assert [tuple(each) for each in source.sweep(1.0, 1.5, 0.5)] == [(1.0, 1.5, 0.5)]


@pytest.mark.parametrize("axis", range(3))
def test_closed_sides_stay_closed(launcher, axis):
    """An emitter that sticks out of the domain pushes the faces of open sides, and not those of closed ones."""
    for side, end in ((2 * axis, 0), (2 * axis + 1, -1)):
        boundary = ["open"] * 6
        boundary[side] = "closed"
        source = _source(launcher, _lattice(tuple(boundary)), mesh=Mesh.box(4.0), velocity=(1.0, 1.0, 1.0))
        faces = np.moveaxis(_pushed(launcher, source)[axis], axis, 0)
        np.testing.assert_array_equal(faces[end], 0.0)
        np.testing.assert_array_equal(faces[-1 - end], 0.5)  # half of such a face's volume is outside
        np.testing.assert_array_equal(faces[1:-1], 1.0)
