"""Traced smoke shadow: closed forms, the light and the receiver anywhere."""

import numpy as np
import pytest
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.scene import PointLight
from warp_smoke.shadow.smoke_ray_traced import RayTracedSmokeShadow

ORIGIN = np.zeros(3)


def _shadow(launcher, lattice, light, density, extinction=1.0, step=0.5):
    shadow = RayTracedSmokeShadow(launcher, lattice, light, ORIGIN, extinction, step=step)
    shadow.update(wp.array(np.asarray(density, np.float32), device=launcher.device), 1.0)
    return shadow


def _chord(points, towards, half):
    """Length within a box (−half … half) of the segments points … points + towards, [n]."""
    with np.errstate(divide="ignore"):
        t = np.sort(np.stack([(side * np.asarray(half) - points) / towards for side in (-1, 1)]), axis=0)
    share = np.clip(t[1].min(axis=1), 0, 1) - np.clip(t[0].max(axis=1), 0, 1)
    return np.maximum(share, 0) * np.linalg.norm(towards, axis=1)


def test_uniform_box_is_exact(launcher, lattice_at, point_light, distant_light, transmittance):
    """In uniform smoke τ is σ ρ times the ray's length within the box, for lights and points inside and outside."""
    lattice = lattice_at((10, 6, 8), voxel_size=0.25, meters_per_unit=0.5)
    half = 0.125 * np.array(lattice.shape)
    points = np.random.default_rng(0).uniform(-3, 3, (4000, 3)).astype(np.float32)
    for light in (
        point_light((0.3, 2.5, -0.4)),
        point_light((0.1, -0.2, 0.3)),
        point_light((0, 0.75, 0)),
        distant_light((0, -1, 0)),
        distant_light((0.3, 0.4, -0.9)),
    ):
        if isinstance(light, PointLight):
            towards = light.position_at(1.0) - points
        else:
            towards = np.broadcast_to(-100.0 * light.direction_at(1.0), points.shape)
        depth = 1.3 * 0.8 * 0.5 * _chord(points, towards, half)
        lit = transmittance(_shadow(launcher, lattice, light, np.full(lattice.shape, 0.8), 1.3), points=points)
        np.testing.assert_allclose(lit, np.exp(-depth), atol=2e-6)


def test_rays_along_the_sides(launcher, lattice_at, distant_light, transmittance):
    """Rays in the plane of a side, along an edge or through a corner give no NaN, and the box's or no shadow."""
    lattice = lattice_at((4, 4, 4), voxel_size=0.5)
    points = [[1, -2, 0.2], [1, -2, 1], [-1, -2, -1], [1, 1, 1], [0.2, -1, 0.3], [0.2, 1, 0.3]]
    lit = transmittance(_shadow(launcher, lattice, distant_light((0, -1, 0)), np.ones(lattice.shape)), points=points)
    full = np.exp(-2.0)
    for value, allowed in zip(lit, [(full, 1), (full, 1), (full, 1), (1,), (full,), (1,)], strict=True):
        assert min(abs(value - a) for a in allowed) < 1e-6


@pytest.mark.parametrize("light_at", [(0.4, 3.0, -0.2), (0.15, 0.1, -0.1)], ids=["outside", "inside"])
def test_gaussian_blob(launcher, lattice_at, point_light, transmittance, light_at):
    """Through a Gaussian blob τ is a difference of error functions along the ray, at second order."""
    from scipy.special import erf

    centre, width, extinction = np.array([0.1, -0.05, 0.08]), 0.2, 3.0
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (3000, 3))
    towards = np.array(light_at) - points
    length = np.linalg.norm(towards, axis=1)
    along = np.sum((centre - points) * towards, axis=1) / length
    b2 = np.sum((centre - points) ** 2, axis=1) - along**2
    span = erf((length - along) / (width * np.sqrt(2))) + erf(along / (width * np.sqrt(2)))
    expected = np.exp(-extinction * width * np.sqrt(np.pi / 2) * np.exp(-0.5 * b2 / width**2) * span)
    errors = []
    for cells in (16, 32, 64):
        lattice = lattice_at((cells,) * 3, voxel_size=2 / cells)
        index = (np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1) + 0.5) * 2 / cells - 1
        density = np.exp(-0.5 * np.sum((index - centre) ** 2, axis=-1) / width**2)
        lit = transmittance(_shadow(launcher, lattice, point_light(light_at), density, extinction), points=points)
        errors.append(np.abs(lit - expected).max())
    assert -np.polyfit(np.log([16, 32, 64]), np.log(errors), 1)[0] > 1.8
    assert errors[-1] < 4e-3


def test_no_smoke_lets_all_light_through(launcher, lattice_at, point_light, transmittance):
    """An empty volume gives exactly 1, and the light's own place too."""
    lattice = lattice_at((4, 4, 4))
    points = np.concatenate([np.random.default_rng(0).uniform(-3, 3, (500, 3)), [[0.5, 0.5, 0.5]]])
    light = point_light((0.5, 0.5, 0.5))
    lit = transmittance(_shadow(launcher, lattice, light, np.zeros(lattice.shape)), points=points)
    np.testing.assert_array_equal(lit, 1.0)
    lit = transmittance(_shadow(launcher, lattice, light, np.ones(lattice.shape)), points=points)
    assert lit[-1] == 1.0


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 7, 1), (2, 1, 9)])
def test_thin_domains(launcher, lattice_at, distant_light, transmittance, shape):
    """Domains one cell thick have their exact shadow."""
    lattice = lattice_at(shape)
    points = [[0.1, -0.5 * shape[1] - 1, 0.2]]
    lit = transmittance(_shadow(launcher, lattice, distant_light((0, -1, 0)), np.ones(shape), 0.3), points=points)
    np.testing.assert_allclose(lit, np.exp(-0.3 * shape[1]), rtol=1e-5)


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads(lattice_at, point_light, transmittance):
    """1, 2 and 7 threads give bit-equal results."""
    lattice = lattice_at((8, 9, 7))
    density = np.random.default_rng(0).random(lattice.shape)
    points = np.random.default_rng(1).uniform(-6, 6, (5000, 3))
    results = [
        transmittance(_shadow(Launcher("cpu", n), lattice, point_light((1, 9, 2)), density, 0.2), points=points)
        for n in (1, 2, 7)
    ]
    np.testing.assert_array_equal(results[1], results[0])
    np.testing.assert_array_equal(results[2], results[0])
    assert results[0].min() < 0.6
