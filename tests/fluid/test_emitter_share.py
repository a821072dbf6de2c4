"""What part of an emitter makes smoke: skins one voxel thick, and noise that is bounded, in place and repeatable."""

import numpy as np
import pytest

from warp_smoke import Emitter, Mesh, Scene, SmokeDomain
from warp_smoke.fluid.emitters import Source
from warp_smoke.lattice import place_lattice

N = 16  # cells along each side of a domain of 2 × 2 × 2 stage units: h = 1/8
H = 2 / N
SHARE = 5e-6  # how well a cell's share inside a mesh is known in float32


def _emit(launcher, time=1.0, resolution=N, **fields):
    """The density that an emitter holds in an empty domain, a box of 8 × 8 × 8 cells of N unless told."""
    domain = SmokeDomain(path="/Smoke", resolution=resolution)
    lattice = place_lattice(Scene(domains=[domain]), domain)
    fields = {"mesh": Mesh.box(8 * H, lower=(-0.5, -0.5, -0.5))} | fields
    source = Source(launcher, lattice, Emitter(path="/Source", **fields))
    density = launcher.zeros((resolution,) * 3, "test")
    (interval,) = source.sweep(time, time + 1.0, 0.04)
    source.place(interval)
    source.emit_density(interval, density)
    return density.numpy()


def test_skin_of_a_box_is_a_voxel_thick(launcher):
    """A box of whole cells: its outermost cells, and none inside."""
    expected = np.zeros((N, N, N))
    expected[4:12, 4:12, 4:12] = 1.0
    expected[5:11, 5:11, 5:11] = 0.0
    np.testing.assert_allclose(_emit(launcher, source="surface"), expected, atol=SHARE)


def test_skin_between_cells_is_as_thick(launcher):
    """Half a cell farther, the skin lies half in one layer of cells and half in the next."""
    density = _emit(launcher, source="surface", mesh=Mesh.box(8 * H, lower=(-0.5 + H / 2,) * 3))
    np.testing.assert_allclose(density[:, 8, 8], [0] * 4 + [0.5, 0.5, 0, 0, 0, 0, 0, 0.5, 0.5] + [0] * 3, atol=SHARE)


def test_skin_ends_at_the_domain(launcher):
    """Where the emitter goes on beyond the domain there is no skin: the domain's side is not its surface."""
    density = _emit(launcher, source="surface", mesh=Mesh.box(8.0, lower=(-4.0, -0.5, -4.0)))
    assert density[:, 4].min() > 1.0 - SHARE
    np.testing.assert_allclose(density[:, 5:], 0.0, atol=SHARE)


def test_skin_of_a_ball(launcher):
    """The skin's volume is the area times a voxel, within what a diamond differs from a ball; the middle is empty."""
    density = _emit(launcher, source="surface", resolution=64, mesh=Mesh.sphere(0.5, 48))
    assert density[32, 32, 32] == 0.0
    thickness = density.sum(dtype=float) / (4 * np.pi * 16.0**2)
    assert 0.57 < thickness < 1.0  # 1 along the axes, 1/√3 along diagonals


@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_noise_is_bounded(launcher, noise):
    """Between (1 − noise) and 1 of the even density, and uneven by a good part of that; nothing outside."""
    density, even = _emit(launcher, noise=noise, noise_scale=0.3), _emit(launcher)
    inside = even > 0
    assert not density[~inside].any()
    ratio = density[inside] / even[inside]
    assert 1.0 - noise - 1e-6 <= ratio.min() < ratio.max() <= 1.0 + 1e-6
    assert ratio.std() > 0.1 * noise


def test_noise_is_the_same_in_every_run(launcher):
    """The same time gives the same bits, another time another pattern, a frame later nearly the same one."""
    first = _emit(launcher, noise=1.0)
    np.testing.assert_array_equal(_emit(launcher, noise=1.0), first)
    near = np.abs(_emit(launcher, noise=1.0, time=2.0) - first).mean()
    far = np.abs(_emit(launcher, noise=1.0, time=200.0) - first).mean()
    assert 0.0 < near < 0.5 * far


def test_noise_stays_in_place_at_any_resolution(launcher):
    """Twice the cells show the same pattern: blocks of 2 × 2 × 2 cells have the coarse cells' densities, to order 2."""
    coarse = _emit(launcher, noise=1.0, noise_scale=1.0)
    fine = _emit(launcher, noise=1.0, noise_scale=1.0, resolution=2 * N)
    blocks = fine.reshape(N, 2, N, 2, N, 2).mean(axis=(1, 3, 5))
    assert np.abs(blocks - coarse)[5:11, 5:11, 5:11].max() < 0.02


@pytest.mark.parametrize(
    ("field", "value"), [("noise", 1.5), ("noise", -0.1), ("noise_scale", 0.0), ("source", "skin")]
)
def test_bad_fields_are_named(field, value):
    """A value out of range is an error that names the field."""
    with pytest.raises(ValueError, match=rf"/Source: {field} is {value}; allowed"):
        Emitter(path="/Source", mesh=Mesh.box(1.0), **{field: value})
