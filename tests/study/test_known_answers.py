"""The known answers, and the error columns against closed forms."""

import numpy as np
import pytest
from staggered import laplacian_matrix, open_shares

from warp_smoke.lattice import Lattice
from warp_smoke.study.advection import density_errors
from warp_smoke.study.answers import GHIA_U, GHIA_V, GHIA_X, GHIA_Y, cosine_hill, deformation, taylor_green
from warp_smoke.study.outcome import mean_over
from warp_smoke.study.pressure import manufactured, residual_of


def test_deformation_has_no_divergence():
    """∂u/∂x + ∂v/∂y + ∂w/∂z = 0 by central differences, to their error; no air goes through the cube's sides."""
    rng, step = np.random.default_rng(1), 1e-5
    points = rng.random((3, 50))
    total = 0.0
    for axis in range(3):
        shift = np.zeros((3, 1))
        shift[axis] = step
        total = total + (deformation(*(points + shift))[axis] - deformation(*(points - shift))[axis]) / (2 * step)
    assert np.abs(total).max() < 1e-8
    for axis in range(3):
        side = points.copy()
        side[axis] = 1.0
        assert np.abs(deformation(*side)[axis]).max() < 1e-15


def test_vortex_decays_as_viscosity_says():
    """The velocity at time t is that at time 0 times e^(−2νπ²t), and it is at rest across the sides."""
    x = np.linspace(0, 1, 9)
    u0, v0 = taylor_green(x[:, None], x[None], 0.1, 0.0)
    u1, _ = taylor_green(x[:, None], x[None], 0.1, 0.5)
    np.testing.assert_allclose(u1, u0 * np.exp(-0.1 * np.pi**2), rtol=1e-14)
    assert np.abs(u0[[0, -1]]).max() < 1e-15
    assert np.abs(v0[:, [0, -1]]).max() < 1e-15


def test_hill_has_half_its_height_half_way_out():
    """1 at its top, ½ at half the radius, 0 at and beyond the radius."""
    np.testing.assert_allclose(cosine_hill(np.array([0.0, 0.1, 0.2, 0.3]), 0.2), [1.0, 0.5, 0.0, 0.0], atol=1e-15)


def test_cavity_tables_are_complete():
    """As many velocities as places for each Reynolds number, and the places ascend within the cavity."""
    for places, table in ((GHIA_Y, GHIA_U), (GHIA_X, GHIA_V)):
        assert list(places) == sorted(places)
        assert {len(values) for values in table.values()} == {len(places)}
        assert set(table) == {100, 400, 1000}


def test_density_errors_of_a_constant_shift():
    """A field of 1s that is off by ½ in half of its cells: every norm is known."""
    exact = np.ones((4, 4, 4))
    found = exact.copy()
    found[:2] += 0.5
    errors = density_errors(found, exact)
    expected = {"l1": 0.25, "l2": 0.125**0.5, "linf": 0.5, "relative_l2": 0.125**0.5, "mass_drift": 0.25}
    assert errors == pytest.approx(expected | {"least": 1.0, "most": 1.5}, rel=1e-12)


def test_manufactured_laplacian():
    """Second differences of the manufactured pressure approach its Laplacian with order 2."""
    off = []
    for n in (64, 128):
        pressure, laplacian = manufactured((np.arange(n) + 0.5) / n)
        padded = [np.pad(pressure, [(int(a == b),) * 2 for b in range(3)], "edge") for a in range(3)]
        found = sum(np.diff(values, 2, axis=axis) for axis, values in enumerate(padded)) * n**2
        off.append(np.abs(found - laplacian).max())
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.02)


def test_residual_is_that_of_the_matrix():
    """The residual of a random pressure is d − L q by the sparse matrix of the closed box; of no pressure it is 1."""
    rng, shape = np.random.default_rng(2), (5, 6, 7)
    pressure, divergence = rng.standard_normal(shape), rng.standard_normal(shape)
    divergence -= divergence.mean()
    closed = ("closed",) * 6
    matrix = laplacian_matrix(open_shares(np.ones(shape), closed), closed)
    left = divergence - (matrix @ pressure.ravel()).reshape(shape)
    rms, most = residual_of(pressure, divergence, None)
    assert rms == pytest.approx(np.linalg.norm(left) / np.linalg.norm(divergence), rel=1e-12)
    assert most == pytest.approx(np.abs(left).max() / np.abs(divergence).max(), rel=1e-12)
    assert residual_of(0 * pressure, divergence, None) == pytest.approx((1.0, 1.0))


def _lattice(shape, voxel_size, corner=(0.0, 0.0, 0.0)):
    to_world = np.eye(4)
    to_world[3, :3] = corner
    return Lattice(
        shape=shape, voxel_size=voxel_size, to_world=to_world, meters_per_unit=1.0, sides=("open",) * 6, up=(0, 1, 0)
    )


def test_means_over_coarser_cells():
    """Two to one they are the means of eight cells; three to two they keep the mass; shifted cells count by overlap."""
    rng = np.random.default_rng(3)
    density = rng.random((6, 6, 6))
    fine = _lattice((6, 6, 6), 1.0)
    blocks = density.reshape(3, 2, 3, 2, 3, 2).mean(axis=(1, 3, 5))
    np.testing.assert_allclose(mean_over(density, fine, _lattice((3, 3, 3), 2.0)), blocks, rtol=1e-12)
    means = mean_over(density, fine, _lattice((4, 4, 4), 1.5))
    assert means.sum() * 1.5**3 == pytest.approx(density.sum())
    shifted = mean_over(density, fine, _lattice((3, 3, 3), 2.0, corner=(0.5, 0.0, 0.0)))
    np.testing.assert_allclose(
        shifted[0, 0, 0], (0.25 * density[0] + 0.5 * density[1] + 0.25 * density[2])[:2, :2].mean()
    )
