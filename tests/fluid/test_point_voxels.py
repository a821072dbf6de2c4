"""Points as small spheres: their volume at any place and size, overlaps, motion, and what they emit."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from staggered import lattice_of

from warp_smoke.fluid.emitters import Source
from warp_smoke.fluid.point_voxels import PointVoxels
from warp_smoke.geometry import Points
from warp_smoke.launch import Launcher
from warp_smoke.record import FieldError, Samples
from warp_smoke.scene import Emitter


def voxels_of(launcher, lattice, points, widths, transform=None, time=0.0):
    """Voxels of points at a time."""
    transform = np.eye(4) if transform is None else transform
    emitter = Emitter(path="/points", mesh=Points(points, widths), transform=transform)
    voxels = PointVoxels(launcher, lattice, emitter, "test")
    voxels.update(time, time, 0.0)
    return voxels


def whole(voxels, lattice):
    """The fraction over the whole lattice."""
    fraction = np.zeros(lattice.shape)
    if 0 not in voxels.shape:
        box = tuple(slice(low, low + n) for low, n in zip(voxels.lower, voxels.shape, strict=True))
        fraction[box] = voxels.fraction.numpy()
    return fraction


@settings(max_examples=40, deadline=None)
@given(st.tuples(*[st.floats(5.0, 7.0)] * 3), st.floats(0.02, 8.0))
def test_volume_of_a_sphere(place, width):
    """A sphere of any size at any place fills cells by 4/3 π r³ in all."""
    lattice = lattice_of((12, 12, 12))
    fraction = whole(voxels_of(Launcher("cpu", 1), lattice, [place], [width]), lattice)
    assert fraction.sum() == pytest.approx(np.pi * width**3 / 6.0, rel=1e-4)
    assert fraction.max() <= 1.0


def test_cells_inside_and_outside_a_sphere(launcher):
    """Cells wholly inside are 1, those wholly outside 0."""
    lattice = lattice_of((12, 12, 12))
    fraction = whole(voxels_of(launcher, lattice, [[6.1, 5.8, 6.3]], [8.0]), lattice)
    distance = np.linalg.norm(np.indices((12, 12, 12)).T + 0.5 - [6.1, 5.8, 6.3], axis=3).T
    assert np.all(fraction[distance < 4.0 - 0.87] == 1.0)
    assert not fraction[distance > 4.0 + 0.87].any()


def test_many_spheres_add_up(launcher):
    """500 spheres of various sizes give the sum of what each gives alone, up to 1."""
    rng, lattice = np.random.default_rng(0), lattice_of((20, 18, 22), voxel_size=0.5)
    points, widths = rng.uniform(0.0, 10.0, (60, 3)), rng.uniform(0.05, 1.5, 60)
    expected = np.zeros(lattice.shape)
    for point, width in zip(points, widths, strict=True):
        expected += whole(voxels_of(launcher, lattice, [point], [width]), lattice)
    found = whole(voxels_of(launcher, lattice, points, widths), lattice)
    np.testing.assert_allclose(found, np.minimum(expected, 1.0), atol=1e-5)


def test_transform_scales_widths(launcher):
    """A transform scales the spheres; scaled unevenly they keep the volume of the ellipsoids they would be."""
    lattice, scale = lattice_of((16, 16, 16)), np.diag([2.0, 3.0, 0.5, 1.0])
    fraction = whole(voxels_of(launcher, lattice, [[4, 2.5, 16]], [1.5], scale), lattice)
    assert fraction.sum() == pytest.approx(3.0 * np.pi * 1.5**3 / 6.0, rel=1e-4)


def test_nothing(launcher):
    """No points, points without width and points outside fill nothing."""
    lattice = lattice_of((4, 4, 4))
    for points, widths in ((np.zeros((0, 3)), []), ([[2, 2, 2]], [0.0]), ([[20, 2, 2]], [1.0])):
        assert not whole(voxels_of(launcher, lattice, points, widths), lattice).any()


def test_points_that_move_and_grow(launcher):
    """Spheres are where they are at each time, have their velocity in m/s, and are left alone once they rest."""
    lattice = lattice_of((12, 8, 8), voxel_size=0.5, meters_per_unit=0.1)
    path = Samples(np.array([0.0, 1.0]), np.array([[[1.0, 2, 2]], [[4.0, 2, 2]]]))
    widths = Samples(np.array([0.0, 1.0]), np.array([[1.0], [2.0]]))
    emitter = Emitter(path="/points", mesh=Points(path, widths))
    voxels = PointVoxels(launcher, lattice, emitter, "test")
    assert voxels.moves
    assert voxels.update(0.0, 0.5, 0.2)
    fraction = whole(voxels, lattice)
    assert fraction.sum() * 0.5**3 == pytest.approx(np.pi * 1.5**3 / 6, rel=1e-4)
    centre = np.sum(fraction[..., None] * (np.indices(lattice.shape).T.swapaxes(0, 2) + 0.5), axis=(0, 1, 2))
    np.testing.assert_allclose(centre / fraction.sum(), [5.0, 4.0, 4.0], atol=1e-3)
    inside = voxels.fraction.numpy() > 0
    np.testing.assert_allclose(voxels.velocity[0].numpy()[inside], 1.5 * 0.1 / 0.2, rtol=1e-5)
    assert voxels.travel(0.0, 0.5) == pytest.approx(3.0)
    assert voxels.update(0.5, 1.0, 0.2)
    assert voxels.update(1.0, 2.0, 0.2)
    assert not voxels.velocity[0].numpy().any()
    launches = launcher.launches.copy()
    assert not voxels.update(2.0, 3.0, 0.2)
    assert launcher.launches == launches


@pytest.mark.parametrize("steps", [1, 3])
def test_rate_of_points(launcher, steps):
    """Points that cross the domain emit rate · dt · density · volume for any number of steps."""
    lattice = lattice_of((24, 8, 8), voxel_size=0.25)
    start = np.array([[1.0, 1.0, 1.0], [1.0, 1.2, 0.9]])
    path = Samples(np.array([0.0, 1.0]), np.stack([start, start + np.array([4.0, 0, 0])]))
    emitter = Emitter(path="/points", mesh=Points(path, [0.1, 0.05]), rate=2.0, density=3.0)
    source, density = Source(launcher, lattice, emitter), launcher.zeros(lattice.shape, "test")
    times = np.linspace(0.0, 1.0, steps + 1)
    for first, last in pairwise(times):
        for interval in source.sweep(first, last, 0.5 / steps):
            source.place(interval)
            source.emit_density(interval, density)
    mass = density.numpy().sum(dtype=float) * 0.25**3
    assert mass == pytest.approx(2.0 * 0.5 * 3.0 * np.pi * (0.1**3 + 0.05**3) / 6.0, rel=1e-4)
    assert density.numpy()[5:20].sum(axis=(1, 2)).min() > 0.0


@pytest.mark.parametrize("widths", [[1.0], [1.0, -1.0], [1.0, np.nan]])
def test_widths_that_are_refused(widths):
    """Widths must be finite, at least 0, and one for each point."""
    with pytest.raises(FieldError, match="widths"):
        Points(np.zeros((2, 3)), widths)


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads():
    """1, 2 and 7 threads give bit-equal shares and velocities."""
    rng = np.random.default_rng(1)
    points = rng.uniform(0.0, 60.0, (2, 3000, 3))
    emitter = Emitter(path="/points", mesh=Points(Samples(np.array([0.0, 1.0]), points), rng.uniform(0.1, 3.0, 3000)))
    results = []
    for threads in (1, 2, 7):
        voxels = PointVoxels(Launcher("cpu", threads), lattice_of((60, 60, 60)), emitter, "test")
        voxels.update(0.0, 0.01, 0.1)
        results.append([array.numpy().copy() for array in (voxels.fraction, *voxels.velocity)])
    for result in results[1:]:
        for one, other in zip(results[0], result, strict=True):
            np.testing.assert_array_equal(one.view(np.int32), other.view(np.int32))
