"""The marched smoke shadow: closed forms, order of convergence, layers, mass, and equivalences."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.record import Samples
from warp_smoke.scene import PointLight
from warp_smoke.shadow.smoke import SmokeShadow
from warp_smoke.shadow.smoke_ray_traced import RayTracedSmokeShadow

ORIGIN = np.zeros(3)


def _shadow(launcher, lattice, light, density, extinction=1.0, origin=ORIGIN, layer=2):
    light = replace(light, smoke_shadow_layer=layer)
    shadow = SmokeShadow(launcher, lattice, light, origin, extinction)
    shadow.update(wp.array(np.asarray(density, np.float32), device=launcher.device), 1.0)
    return shadow


def _truth(launcher, lattice, light, density, extinction=1.0, step=0.25):
    shadow = RayTracedSmokeShadow(launcher, lattice, light, ORIGIN, extinction, step=step)
    shadow.update(wp.array(np.asarray(density, np.float32), device=launcher.device), 1.0)
    return shadow


def _centres(lattice):
    """World positions of the cells' centres, [nx, ny, nz, 3]."""
    index = np.stack(np.meshgrid(*map(np.arange, lattice.shape), indexing="ij"), axis=-1) + 0.5
    matrix = lattice.cells_to_world()
    return index @ matrix[:3, :3] + matrix[3, :3]


def _blob(lattice, centre=(0.1, -0.05, 0.08), width=0.2):
    """A Gaussian of peak 1 that ends well inside a box of side 2."""
    return np.exp(-0.5 * np.sum((_centres(lattice) - centre) ** 2, axis=-1) / width**2)


def _lights(point_light, distant_light):
    return [
        distant_light((0, -1, 0)),
        distant_light((0.6, -1.0, -0.8)),
        distant_light((-1, 0.1, 0.2)),
        point_light((0.5, 5, -1)),
        point_light((0.2, 0.3, -1.7)),
        point_light((-1.9, 1.2, 0.3)),
    ]


def _behind(light, count, rng):
    """Points behind the box of side 2 around the origin, seen from the light."""
    points = rng.uniform(-0.4, 0.4, (count, 3))
    if isinstance(light, PointLight):
        away = points - light.position_at(1.0)
    else:
        away = np.broadcast_to(light.direction_at(1.0), points.shape)
    return points + 4.0 * away / np.linalg.norm(away, axis=1, keepdims=True)


def _distance_from_ray(light, points, centre):
    """Distance of a centre from each point's ray to the light."""
    if isinstance(light, PointLight):
        ray = points - light.position_at(1.0)
    else:
        ray = np.broadcast_to(light.direction_at(1.0), points.shape)
    ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    offset = np.asarray(centre) - points
    return np.linalg.norm(offset - np.sum(offset * ray, axis=1)[:, None] * ray, axis=1)


@pytest.mark.parametrize("number", range(6))
def test_gaussian_blob(launcher, lattice_at, point_light, distant_light, transmittance, number):
    """T = exp(−σ ρ₀ s √(2π) e^(−b²/2s²)) behind a Gaussian blob, at second order."""
    light = _lights(point_light, distant_light)[number]
    centre, width, extinction = (0.1, -0.05, 0.08), 0.2, 3.0
    points = _behind(light, 3000, np.random.default_rng(0))
    b = _distance_from_ray(light, points, centre)
    expected = np.exp(-extinction * width * np.sqrt(2 * np.pi) * np.exp(-0.5 * (b / width) ** 2))
    assert expected.min() < 0.25
    errors = []
    for cells in (16, 32, 64):
        lattice = lattice_at((cells, cells, cells), voxel_size=2 / cells)
        shadow = _shadow(launcher, lattice, light, _blob(lattice, centre, width), extinction)
        errors.append(np.abs(transmittance(shadow, points=points) - expected).max())
    order = -np.polyfit(np.log([16, 32, 64]), np.log(errors), 1)[0]
    assert order > 1.8
    assert errors[-1] < 4e-3


@pytest.mark.parametrize("number", range(6))
def test_converges_to_rays_everywhere(launcher, lattice_at, point_light, distant_light, transmittance, number):
    """Anywhere, also inside the smoke and before it, the mean difference from traced rays falls at second order."""
    light = _lights(point_light, distant_light)[number]
    points = np.random.default_rng(1).uniform(-1.5, 1.5, (20_000, 3))
    fine = lattice_at((128,) * 3, voxel_size=2 / 128)
    truth = transmittance(_truth(launcher, fine, light, _blob(fine), 3.0), points=points)
    errors, largest = [], []
    for cells in (16, 32, 64):
        lattice = lattice_at((cells,) * 3, voxel_size=2 / cells)
        error = np.abs(transmittance(_shadow(launcher, lattice, light, _blob(lattice), 3.0), points=points) - truth)
        errors.append(error.mean())
        largest.append(error.max())
    assert -np.polyfit(np.log([16, 32, 64]), np.log(errors), 1)[0] > 1.8
    assert largest[-1] < 0.01


def test_slab_is_exact(launcher, lattice_at, distant_light, point_light, transmittance):
    """Behind uniform smoke as wide as the light's reach, τ = σ ρ · thickness / cos θ to round-off."""
    lattice = lattice_at((64, 8, 64), voxel_size=0.1)
    density = np.full(lattice.shape, 0.7)
    points = np.random.default_rng(0).uniform((-0.2, -0.8, -0.2), (0.2, -0.5, 0.2), (500, 3))
    for light in (distant_light((0, -1, 0)), distant_light((0.8, -1, 0.5)), point_light((0.3, 3, 0.1))):
        if isinstance(light, PointLight):
            away = points - light.position_at(1.0)
        else:
            away = np.broadcast_to(light.direction_at(1.0), points.shape)
        cosine = np.abs(away[:, 1]) / np.linalg.norm(away, axis=1)
        lit = transmittance(_shadow(launcher, lattice, light, density, 2.0), points=points)
        np.testing.assert_allclose(lit, np.exp(-2.0 * 0.7 * 0.8 / cosine), rtol=1e-5)


def test_floor_under_the_box(launcher, lattice_at, point_light, transmittance):
    """Round-off that puts a floor into the box it touches does not change its shadow, where rays leave by the bottom.

    The buffer's slices lie across x, so each ray leaves after another share of them; one layer holds them all.
    """
    lattice = lattice_at((32,) * 3, voxel_size=2 / 32)
    shadow = _shadow(launcher, lattice, point_light((3.0, 0.9, 0.1)), np.ones(lattice.shape), 3.0, layer=None)
    floor = np.random.default_rng(5).uniform((-0.9, -1, -0.9), (0.9, -1, 0.9), (500, 3))
    below, into = (transmittance(shadow, points=np.add(floor, (0, y * 2 / 32, 0))) for y in (-1e-4, 1e-4))
    assert below.max() < 0.9
    np.testing.assert_allclose(into, below, rtol=1e-3)  # a thousandth of a cell's smoke at most


def test_uniform_sphere(launcher, lattice_at, distant_light, transmittance):
    """Behind a uniform ball τ = σ 2 √(R² − b²); its sharp edge costs less than a cell's width of smoke."""
    cells, radius = 64, 0.7
    lattice = lattice_at((cells,) * 3, voxel_size=2 / cells)
    # The share of each cell inside the ball, from 4³ samples.
    sub = (np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5) / 4 - 0.5
    inside = [np.linalg.norm(_centres(lattice) + s * lattice.voxel_size, axis=-1) < radius for s in sub]
    light = distant_light((0.3, -1, 0.2))
    points = _behind(light, 5000, np.random.default_rng(0))
    b = _distance_from_ray(light, points, (0, 0, 0))
    depth = -np.log(transmittance(_shadow(launcher, lattice, light, np.mean(inside, axis=0)), points=points))
    chord = 2 * np.sqrt(np.maximum(radius**2 - b**2, 0))
    assert np.abs(depth - chord)[b < 0.6].max() < 0.5 * lattice.voxel_size
    assert np.abs(depth - chord).max() < np.sqrt(2 * radius * lattice.voxel_size)  # the chord one cell from the edge


@pytest.mark.parametrize("direction", [(0, -1, 0), (0.3, 1, 0.9), (1, 0.2, -0.3), (-0.4, 0.5, -1), (1, 1, 1)])
def test_buffer_holds_the_mass(launcher, lattice_at, distant_light, direction):
    """For parallel rays Σ τ · A over the buffer is σ times the mass, also where smoke touches the box's sides."""
    lattice = lattice_at((9, 14, 11), voxel_size=0.3, meters_per_unit=0.5)
    density = np.random.default_rng(0).random(lattice.shape)
    light = distant_light(direction)
    shadow = _shadow(launcher, lattice, light, density, 1.7)
    # A texel of one cell's width is A = h² |cos θ| across the rays.
    area = lattice.h**2 * np.abs(light.direction_at(1.0)).max()
    total = shadow.optical_depth()[-1].sum(dtype=float) * area
    assert total == pytest.approx(1.7 * density.sum() * lattice.h**3, rel=1e-5)


def test_layers_hold_what_lies_before_them(launcher, lattice_at, distant_light, transmittance):
    """At the end of every layer a receiver has exactly the slices before it, and between them a share; 1 before all."""
    lattice = lattice_at((6, 10, 6))
    density = np.random.default_rng(0).random(lattice.shape)
    light = distant_light((0, -1, 0))
    depth = np.cumsum(density[2, ::-1, 3])  # from the top down
    for slices in (1, 2, 4, 10):
        shadow = _shadow(launcher, lattice, light, density, layer=slices)
        ends = np.minimum(np.arange(slices, 10 + slices, slices), 10)
        points = np.column_stack([np.full(len(ends), -0.5), 5.0 - ends, np.full(len(ends), 0.5)])
        np.testing.assert_allclose(-np.log(transmittance(shadow, points=points)), depth[ends - 1], rtol=1e-5)
        middle = np.add(points[:1], [[0, 0.5 * slices, 0]])
        np.testing.assert_allclose(-np.log(transmittance(shadow, points=middle)), 0.5 * depth[ends[0] - 1], rtol=1e-5)
        above = [[-0.5, 5.0, 0.5], [-0.5, 7.0, 0.5], [2.9, 1e4, -2.9]]
        np.testing.assert_array_equal(transmittance(shadow, points=above), 1.0)


def test_no_smoke_lets_all_light_through(launcher, lattice_at, point_light, distant_light, transmittance):
    """An empty volume gives exactly 1 everywhere, and so does smoke for points beside it and before it."""
    lattice = lattice_at((16, 8, 12), voxel_size=0.1)
    points = np.random.default_rng(0).uniform(-3, 3, (2000, 3))
    for light in _lights(point_light, distant_light):
        np.testing.assert_array_equal(
            transmittance(_shadow(launcher, lattice, light, np.zeros(lattice.shape)), points=points), 1.0
        )
    shadow = _shadow(launcher, lattice, point_light((0, 2, 0)), np.ones(lattice.shape))
    beside = [[0, 3, 0], [0, 1.0, 0], [3, 0, 0], [0, 2.0, 0], [5, 2, 5], [0.2, 0.401, 0.1]]
    np.testing.assert_array_equal(transmittance(shadow, points=beside), 1.0)


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2), (0, 2, 1), (2, 1, 0)])
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1), (1, -1, 1)])
def test_turned_and_mirrored_axes(launcher, lattice_at, distant_light, point_light, transmittance, order, signs):
    """The same scene with its axes permuted and mirrored has the same shadow."""
    rng = np.random.default_rng(0)
    density = rng.random((6, 9, 7))
    points = rng.uniform(-8, 8, (400, 3))
    signs = np.array(signs)
    moved = density[tuple(slice(None, None, s) for s in signs)].transpose(order)
    for make, vector in ((distant_light, (0.3, -0.9, 0.5)), (point_light, (3, 12, -4))):
        expected = transmittance(
            _shadow(launcher, lattice_at(density.shape), make(vector), density, 0.3), points=points
        )
        turned = make((np.array(vector) * signs)[list(order)])
        actual = transmittance(
            _shadow(launcher, lattice_at(moved.shape), turned, moved, 0.3), points=(points * signs)[:, order]
        )
        np.testing.assert_allclose(actual, expected, rtol=2e-5)
        assert expected.min() < 0.5


def test_units_and_turned_boxes_far_from_the_origin(launcher, lattice_at, point_light, transmittance):
    """A turned lattice a million units away, in centimetres, has the shadow of the same one at home in metres."""
    rng = np.random.default_rng(0)
    density = rng.random((8, 10, 6))
    points = rng.uniform(-1.5, 1.5, (500, 3))
    light = np.array([0.4, 2.0, -0.3])
    home = transmittance(
        _shadow(launcher, lattice_at(density.shape, voxel_size=0.1), point_light(light), density), points=points
    )
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    origin = np.array([1e6, -1e6, 2e6])
    corner = origin + 100 * (-0.05 * np.array(density.shape)) @ turn
    far = lattice_at(density.shape, corner=corner, voxel_size=10.0, axes=turn, meters_per_unit=0.01)
    away = transmittance(
        _shadow(launcher, far, point_light(origin + 100 * light @ turn), density, origin=origin),
        points=100 * points @ turn,
    )
    np.testing.assert_allclose(away, home, atol=1e-4)  # cells at 1e6 units: 1e-7 of a cell; texel weights in float32
    assert home.min() < 0.7


def test_several_lights_are_independent(launcher, lattice_at, point_light, distant_light, transmittance):
    """Each light's shadow is the same with other lights around; shadows of two domains multiply."""
    lattice = lattice_at((16,) * 3, voxel_size=0.125)
    points = np.random.default_rng(0).uniform(-2, 2, (1000, 3))
    density = _blob(lattice)
    lights = _lights(point_light, distant_light)
    alone = [transmittance(_shadow(launcher, lattice, light, density), points=points) for light in lights]
    together = [_shadow(launcher, lattice, light, density) for light in lights]
    for shadow, expected in zip(together, alone, strict=True):
        np.testing.assert_array_equal(transmittance(shadow, points=points), expected)
    both = transmittance(together[0], together[1], points=points)
    np.testing.assert_allclose(both, alone[0] * alone[1], rtol=1e-6)


def test_far_point_light_becomes_a_distant_light(launcher, lattice_at, point_light, distant_light, transmittance):
    """The shadow of a point light at distance D tends to the distant light's like 1/D."""
    lattice = lattice_at((32,) * 3, voxel_size=1 / 16)
    direction = np.array([0.3, -1.0, 0.2]) / np.linalg.norm([0.3, -1.0, 0.2])
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (3000, 3))
    limit = transmittance(_shadow(launcher, lattice, distant_light(direction), _blob(lattice), 3.0), points=points)
    differences = []
    for distance in (10, 100, 1000, 1e9):
        light = point_light(-distance * direction)
        there = transmittance(_shadow(launcher, lattice, light, _blob(lattice), 3.0), points=points)
        differences.append(np.abs(there - limit).mean())
    assert differences[0] > 5 * differences[1]
    assert differences[-1] < 2e-4  # its texels begin elsewhere than the distant light's


def test_coarser_texels_cost_accuracy_only(launcher, lattice_at, point_light, transmittance):
    """`smoke_shadow_size` sets the texels: a third as many give a worse, twice as many no worse shadow."""
    lattice = lattice_at((32,) * 3, voxel_size=1 / 16)
    light = point_light((0.5, 4, -0.3))
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (5000, 3))
    truth = transmittance(_truth(launcher, lattice, light, _blob(lattice), 3.0), points=points)
    error = {}
    for size in (10, None, 80):
        shadow = _shadow(launcher, lattice, replace(light, smoke_shadow_size=size), _blob(lattice), 3.0)
        error[size] = np.abs(transmittance(shadow, points=points) - truth).mean()
    assert error[10] > 3 * error[None]
    assert error[80] < 1.1 * error[None]


def test_moving_light(launcher, lattice_at, placed, point_light, transmittance):
    """A light that goes round the box, changing axes, has at each time the shadow of a light that stands there."""
    path = [(0.3, 4, 0.2), (4, 0.5, 0.1), (0.2, -0.3, -5)]
    light = PointLight(path="/light", transform=Samples([1, 2, 3], [placed(p) for p in path]), smoke_shadow_layer=2)
    lattice = lattice_at((24, 32, 28), voxel_size=0.0625)
    density = _blob(lattice)
    array = wp.array(density.astype(np.float32), device=launcher.device)
    points = np.random.default_rng(0).uniform(-2, 2, (1000, 3))
    shadow = SmokeShadow(launcher, lattice, light, ORIGIN, 3.0)
    for time in (1, 2, 3, 2, 1):
        shadow.update(array, time)
        still = _shadow(launcher, lattice, point_light(path[time - 1]), density, 3.0)
        # Its texels may be wider: one buffer serves all times.
        np.testing.assert_allclose(transmittance(shadow, points=points), transmittance(still, points=points), atol=0.01)


def test_nothing_is_allocated_in_a_step(lattice_at, point_light, distant_light):
    """A light that stands still allocates at its first update and never again."""
    launcher = Launcher("cpu", 1)
    lattice = lattice_at((8, 8, 8))
    density = wp.zeros((8, 8, 8), dtype=float, device="cpu")
    for light in (distant_light((0, -1, 0.2)), point_light((0, 20, 0))):
        shadow = SmokeShadow(launcher, lattice, light, ORIGIN, 1.0)
        shadow.update(density, 1.0)
        allocated = dict(launcher.allocated)
        shadow.update(density, 2.0)
        assert dict(launcher.allocated) == allocated


@pytest.mark.parametrize("direction", [(1, 0.2, 0.3), (0.2, -1, 0.3), (0.2, 0.3, -1), (0.2, 0.3, 1)])
def test_smoke_that_left_is_forgotten(launcher, lattice_at, distant_light, direction):
    """A buffer that has held other smoke before is, to the bit, as one that has not, across each axis."""
    lattice, rng = lattice_at((21, 35, 18)), np.random.default_rng(0)
    densities = []
    for corner in ((0, 0, 0), (12, 20, 9), (3, 14, 2)):
        density = np.zeros(lattice.shape, np.float32)
        density[tuple(slice(c, c + 6) for c in corner)] = rng.random((6, 6, 6))
        densities.append(wp.array(density, device=launcher.device))
    light = replace(distant_light(direction), smoke_shadow_layer=4)
    used = SmokeShadow(launcher, lattice, light, ORIGIN, 1.0)
    for density in (*densities, wp.zeros(lattice.shape, dtype=float, device=launcher.device)):
        used.update(density, 1.0)
        fresh = SmokeShadow(launcher, lattice, light, ORIGIN, 1.0)
        fresh.update(density, 1.0)
        np.testing.assert_array_equal(used.optical_depth(), fresh.optical_depth())
    assert used.optical_depth().max() == 0.0


def test_light_inside_is_refused(launcher, lattice_at, point_light, placed):
    """A light inside the domain, now or later, raises one line that names it and what to do."""
    lattice = lattice_at((8, 8, 8))
    with pytest.raises(ValueError, match=r"/light: position is at \[1.0, 2.0, 3.0\].*ray_traced"):
        SmokeShadow(launcher, lattice, point_light((1, 2, 3)), ORIGIN, 1.0)
    light = PointLight(path="/light", transform=Samples([1, 2], [placed((0, 30, 0)), placed((0, 0, 0))]))
    with pytest.raises(ValueError, match="ray_traced"):
        SmokeShadow(launcher, lattice, light, ORIGIN, 1.0)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 40, 1), (40, 1, 1), (2, 1, 30)])
def test_thin_domains(launcher, lattice_at, point_light, distant_light, transmittance, shape):
    """Domains one cell thick have their exact shadow under straight light, from either kind of light."""
    lattice = lattice_at(shape)
    points = [[0.5 * (shape[0] % 2 - 1), -0.5 * shape[1] - 1, 0.5 * (shape[2] % 2 - 1)]]  # under a cell's centre
    for light, tolerance in ((distant_light((0, -1, 0)), 1e-5), (point_light((0, 1e5, 0)), 1e-3)):
        lit = transmittance(_shadow(launcher, lattice, light, np.ones(shape), 0.1), points=points)
        np.testing.assert_allclose(lit, np.exp(-0.1 * shape[1]), rtol=tolerance)


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads(lattice_at, point_light, transmittance):
    """1, 2 and 7 threads fill bit-equal buffers."""
    lattice = lattice_at((48, 64, 56))
    density = np.random.default_rng(0).random(lattice.shape)
    buffers = [
        _shadow(Launcher("cpu", n), lattice, point_light((5, 90, 3)), density).buffer.summed.numpy().copy()
        for n in (1, 2, 7)
    ]
    np.testing.assert_array_equal(buffers[1], buffers[0])
    np.testing.assert_array_equal(buffers[2], buffers[0])
    assert buffers[0][-1].max() > 10
