"""Splats of voxels on the light buffer: mass, closed forms, order of convergence, and the weights themselves."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

from warp_smoke.launch import Launcher
from warp_smoke.scene import PointLight
from warp_smoke.shadow.light_buffer import GAUSSIAN_REACH, fit_shear
from warp_smoke.shadow.smoke import SmokeShadow
from warp_smoke.shadow.splats import SPLATS, splat_taps

ORIGIN = np.zeros(3)
BLOB = {"centre": np.array([0.1, -0.05, 0.08]), "width": 0.2, "extinction": 3.0}


def _shadow(launcher, lattice, light, density, extinction=1.0, **fields):
    shadow = SmokeShadow(launcher, lattice, replace(light, **fields), ORIGIN, extinction)
    shadow.update(wp.array(np.asarray(density, np.float32), device=launcher.device), 1.0)
    return shadow


def _blob(lattice):
    """The Gaussian blob at the cells' centres."""
    index = np.stack(np.indices(lattice.shape), axis=-1) + 0.5
    matrix = lattice.cells_to_world()
    offset = index @ matrix[:3, :3] + matrix[3, :3] - BLOB["centre"]
    return np.exp(-0.5 * np.sum(offset**2, axis=-1) / BLOB["width"] ** 2)


def _behind_blob(light, count):
    """Points behind the blob, and τ there in closed form."""
    points = np.random.default_rng(0).uniform(-0.4, 0.4, (count, 3))
    if isinstance(light, PointLight):
        away = points - light.position_at(1.0)
    else:
        away = np.broadcast_to(light.direction_at(1.0), points.shape)
    away = away / np.linalg.norm(away, axis=1, keepdims=True)
    offset = BLOB["centre"] - points
    b = np.linalg.norm(offset - np.sum(offset * away, axis=1)[:, None] * away, axis=1)
    width = BLOB["width"]
    depth = BLOB["extinction"] * width * np.sqrt(2 * np.pi) * np.exp(-0.5 * (b / width) ** 2)
    return points + 4.0 * away, depth


@pytest.mark.parametrize("splat", SPLATS)
@pytest.mark.parametrize("size", [None, 7, 40])
@pytest.mark.parametrize("direction", [(0, -1, 0), (0.3, 1, 0.9), (1, 0.2, -0.3), (-0.4, 0.5, -1)])
def test_buffer_holds_the_mass(launcher, lattice_at, distant_light, splat, size, direction):
    """For parallel rays Σ buf · A is σ times the mass, for every splat and however wide the texels are."""
    lattice = lattice_at((9, 14, 11), voxel_size=0.3, meters_per_unit=0.5)
    density = np.random.default_rng(0).random(lattice.shape)
    light = distant_light(direction)
    shadow = _shadow(launcher, lattice, light, density, 1.7, smoke_shadow=splat, smoke_shadow_size=size)
    area = (shadow.buffer.texel * lattice.h) ** 2 * np.abs(light.direction_at(1.0)).max()
    total = shadow.optical_depth()[-1].sum(dtype=float) * area
    assert total == pytest.approx(1.7 * density.sum() * lattice.h**3, rel=1e-5)


@given(
    splat=st.sampled_from(list(SPLATS)),
    light=st.tuples(st.floats(-9, 9), st.floats(40, 90), st.floats(-9, 9), st.sampled_from([0.0, 1.0])),
    shape=st.tuples(*[st.integers(1, 20)] * 3),
    size=st.none() | st.integers(4, 50),
)
def test_every_cell_gives_its_all(splat, light, shape, size):
    """On each slice Σ over texels of weight · a is 1 along either axis: no cell's smoke is lost or doubled."""
    shear = fit_shear(np.array(light), shape, size, reach=GAUSSIAN_REACH if splat == "gaussian" else 0.5, margin=1)
    sides = tuple(n for axis, n in enumerate(shape) if axis != shear.axis)
    depths = SPLATS[splat].depths
    a = shear.slice_places(depths)[:, 0]
    for taps, cells, share in zip(splat_taps(SPLATS[splat], shear, sides), sides, (1 / len(depths), 1), strict=True):
        given_away = np.zeros((len(a), cells))
        count = taps.weight.shape[2]
        samples = np.arange(len(a))[:, None, None]
        np.add.at(given_away, (samples, taps.first[..., None] + np.arange(count)), taps.weight * a[:, None, None])
        np.testing.assert_allclose(given_away, share, rtol=1e-5)


@pytest.mark.parametrize("splat", ["nearest", "bilinear", "footprint"])
def test_slab_is_exact(launcher, lattice_at, distant_light, transmittance, splat):
    """Behind uniform smoke as wide as the light's reach, τ = σ ρ · thickness / cos θ to round-off."""
    lattice = lattice_at((64, 8, 64), voxel_size=0.1)
    points = np.random.default_rng(0).uniform((-0.2, -0.8, -0.2), (0.2, -0.5, 0.2), (500, 3))
    for light in (distant_light((0, -1, 0)), distant_light((0.8, -1, 0.5))):
        shadow = _shadow(launcher, lattice, light, np.full(lattice.shape, 0.7), 2.0, smoke_shadow=splat)
        expected = np.exp(-2.0 * 0.7 * 0.8 / np.abs(light.direction_at(1.0)[1]))
        np.testing.assert_allclose(transmittance(shadow, points=points), expected, rtol=1e-5)


def test_footprint_of_a_slab_under_a_point_light(launcher, lattice_at, point_light, transmittance):
    """Footprints leave neither gaps nor overlaps where texels and cells differ in width from slice to slice."""
    lattice = lattice_at((64, 8, 64), voxel_size=0.1)
    light = point_light((0.3, 3, 0.1))
    points = np.random.default_rng(0).uniform((-0.2, -0.8, -0.2), (0.2, -0.5, 0.2), (500, 3))
    away = points - light.position_at(1.0)
    cosine = np.abs(away[:, 1]) / np.linalg.norm(away, axis=1)
    for size in (None, 25, 150):
        fields = {"smoke_shadow": "footprint", "smoke_shadow_size": size}
        shadow = _shadow(launcher, lattice, light, np.full(lattice.shape, 0.7), 2.0, **fields)
        np.testing.assert_allclose(transmittance(shadow, points=points), np.exp(-2.0 * 0.7 * 0.8 / cosine), rtol=1e-5)


@pytest.mark.parametrize(
    ("method", "low", "high"),
    [
        ("nearest", 0.7, 2.3),
        ("bilinear", 0.9, 2.3),
        ("gaussian", 1.8, 2.2),
        ("footprint", 1.8, 2.2),
        ("march", 1.8, 2.2),
    ],
)
@pytest.mark.parametrize("number", range(3))
def test_order_of_convergence(
    launcher, lattice_at, point_light, distant_light, transmittance, method, low, high, number
):
    """Doubling texture and grid together, the mean error behind a Gaussian blob falls at the splat's order.

    Second for gaussian, footprint and march. Nearest and bilinear are first at worst; where the slices' shifts differ,
    their errors cancel.
    """
    light = [distant_light((0.6, -1.0, -0.8)), distant_light((-1, 0.13, 0.27)), point_light((0.5, 5, -1))][number]
    points, depth = _behind_blob(light, 4000)
    errors = []
    sizes = (16, 32, 64, 128)
    for cells in sizes:
        lattice = lattice_at((cells,) * 3, voxel_size=2 / cells)
        shadow = _shadow(launcher, lattice, light, _blob(lattice), BLOB["extinction"], smoke_shadow=method)
        errors.append(np.abs(transmittance(shadow, points=points) - np.exp(-depth)).mean())
    assert low < -np.polyfit(np.log(sizes), np.log(errors), 1)[0] < high


@pytest.mark.parametrize("splat", SPLATS)
def test_no_smoke_lets_all_light_through(launcher, lattice_at, point_light, transmittance, splat):
    """An empty volume gives exactly 1 everywhere, and skips every row."""
    lattice = lattice_at((16, 8, 12), voxel_size=0.1)
    points = np.random.default_rng(0).uniform(-3, 3, (2000, 3))
    shadow = _shadow(launcher, lattice, point_light((0.5, 5, -1)), np.zeros(lattice.shape), smoke_shadow=splat)
    np.testing.assert_array_equal(transmittance(shadow, points=points), 1.0)


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads(lattice_at, point_light):
    """1, 2 and 7 threads fill bit-equal buffers with every splat."""
    lattice = lattice_at((20, 33, 24))
    density = np.random.default_rng(0).random(lattice.shape)
    for splat in SPLATS:
        fields = {"smoke_shadow": splat, "smoke_shadow_layer": 4, "smoke_diffusion": 0.7, "smoke_diffuser": "sweeps"}
        buffers = [
            _shadow(Launcher("cpu", n), lattice, point_light((5, 90, 3)), density, **fields).optical_depth()
            for n in (1, 2, 7)
        ]
        np.testing.assert_array_equal(buffers[1], buffers[0])
        np.testing.assert_array_equal(buffers[2], buffers[0])
        assert buffers[0][-1].max() > 5
