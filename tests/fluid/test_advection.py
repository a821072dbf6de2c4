"""Advection: exact cases first, then order of convergence, bounds, and the sides of the domain."""

from itertools import pairwise

import numpy as np
import pytest

from warp_smoke.fluid.advection import limit_energy
from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.fluid.unlimited import UNLIMITED_SCHEMES

CLOSED, OPEN = ("closed",) * 6, ("open",) * 6
SCHEMES = pytest.mark.parametrize("scheme", ADVECTION_SCHEMES)
AXIS = np.array([1.0, 2.0, 2.0]) / 3.0


def _uniform(*velocity):
    return lambda x, y, z: velocity


def _box(shape, lower, upper):
    """1 in cells lower … upper − 1, else 0."""
    values = np.zeros(shape, np.float32)
    values[tuple(slice(a, b) for a, b in zip(lower, upper, strict=True))] = 1.0
    return values


@SCHEMES
def test_whole_cells_are_exact(launcher, upload, sample_velocity, scheme):
    """A flow of whole cells per step moves scalars and velocity by whole cells, to the bit."""
    shape, steps = (14, 15, 16), 3
    advection = ADVECTION_SCHEMES[scheme](launcher, shape, CLOSED)
    inner = tuple(slice(5, -5) for _ in range(3))  # what comes from the sides cannot reach these cells
    rng = np.random.default_rng(1)
    fields = [rng.standard_normal(face_shape(shape, axis)) for axis in range(3)] + [rng.standard_normal(shape)]
    *velocity, scalar = (upload(field) for field in fields)
    flow = sample_velocity(_uniform(2.0, -1.0, 1.0), shape)
    for _ in range(steps):
        advection.trace(flow, 0.5)
        advection.trace(flow, 1.0)  # the later trace counts
        velocity = advection.advect_velocity(velocity)
        scalar = advection.advect_scalar(scalar, 0.0)
        for before, after in zip(fields, (*velocity, scalar), strict=True):
            moved = np.roll(before.astype(np.float32), (2, -1, 1), axis=(0, 1, 2))
            np.testing.assert_array_equal(after.numpy()[inner], moved[inner])
        fields = [after.numpy().copy() for after in (*velocity, scalar)]


def _rotation_errors(launcher, upload, sample_velocity, scheme: str, n: int) -> list[float]:
    """RMS errors of a smooth field without extrema after half a radian of solid rotation at Courant number 1.

    Of its samples at cell centres, carried as a scalar, and of those on the faces across each axis, as a velocity.
    """
    shape, angle = (n, n, n), 0.5
    middle = np.full(3, (n - 1) / 2)

    def turning(x, y, z):
        return np.moveaxis(np.cross(AXIS, np.stack([x, y, z], axis=-1) - middle), -1, 0)

    def field(x, y, z):
        x, y, z = ((each - (n - 1) / 2) / n for each in (x, y, z))
        return x + 0.5 * y - 0.7 * z + 0.3 * np.sin(3 * x + 1) * np.sin(2 * y + z)

    def turned(x, y, z):
        r = np.stack([x, y, z], axis=-1) - middle
        along = (r @ AXIS)[..., None] * AXIS
        return field(
            *np.moveaxis(middle + along + np.cos(angle) * (r - along) - np.sin(angle) * np.cross(AXIS, r), -1, 0)
        )

    advection = ADVECTION_SCHEMES[scheme](launcher, shape, CLOSED)
    flow, steps = sample_velocity(turning, shape), round(angle * n / 2)
    scalar, velocity = upload(field(*np.indices(shape))), sample_velocity(lambda *place: [field(*place)] * 3, shape)
    for _ in range(steps):
        advection.trace(flow, angle / steps)
        scalar, velocity = advection.advect_scalar(scalar, 0.0), advection.advect_velocity(velocity)
    errors = []
    for axis, carried in enumerate((*velocity, scalar)):
        points = np.indices(carried.shape) - 0.5 * (np.arange(3) == axis)[:, None, None, None]
        inside = np.linalg.norm(points - middle[:, None, None, None], axis=0) < 0.3 * n
        errors.append(float(np.sqrt(np.mean((carried.numpy() - turned(*points))[inside] ** 2))))
    return errors


@pytest.mark.parametrize(
    ("scheme", "order"), [("semi_lagrangian", 1), ("semi_lagrangian_cubic", 2), ("maccormack", 2), ("bfecc", 2)]
)
def test_order_of_convergence(launcher, upload, sample_velocity, scheme, order):
    """Half the cell and half the step: half the error (semi-Lagrangian), or a quarter; scalars and velocity alike."""
    sizes = (16, 32, 64)
    errors = [_rotation_errors(launcher, upload, sample_velocity, scheme, n) for n in sizes]
    slopes = -np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    np.testing.assert_allclose(slopes, order, atol=0.1)


def _hill_error(launcher, upload, sample_velocity, scheme: str, n: int) -> float:
    """Relative L2 error of a cosine hill carried 0.3 box lengths by a uniform flow of 0.4 cells a step."""
    shape, steps = (n, 4, 4), round(0.3 * n / 0.4)

    def hill(middle):
        r = np.abs((np.arange(n) + 0.5) / n - middle) / 0.25
        return np.broadcast_to(np.where(r < 1, 0.5 + 0.5 * np.cos(np.pi * r), 0.0)[:, None, None], shape)

    advection = ADVECTION_SCHEMES[scheme](launcher, shape, OPEN)
    velocity, scalar = sample_velocity(_uniform(1.0, 0.0, 0.0), shape), upload(hill(0.3))
    for _ in range(steps):
        advection.trace(velocity, 0.4)
        scalar = advection.advect_scalar(scalar, 0.0)
    exact = hill(0.3 + 0.4 * steps / n)
    return float(np.linalg.norm(scalar.numpy() - exact) / np.linalg.norm(exact))


@pytest.mark.parametrize(
    ("scheme", "order"),
    [("semi_lagrangian", 0.85), ("semi_lagrangian_cubic", 1.6), ("maccormack", 1.6), ("bfecc", 1.6)],
)
def test_hill_converges(launcher, upload, sample_velocity, scheme, order):
    """A hill with a top converges too; the clamp at the top costs a part of order 2."""
    sizes = (64, 128, 256)
    errors = [_hill_error(launcher, upload, sample_velocity, scheme, n) for n in sizes]
    assert -np.polyfit(np.log(sizes), np.log(errors), 1)[0] > order
    assert all(b < a for a, b in pairwise(errors))


@SCHEMES
@pytest.mark.parametrize("courant", [0.3, 100.0, 10_000.0])
@pytest.mark.parametrize("sides", [CLOSED, OPEN])
def test_stays_within_its_range(launcher, upload, scheme, courant, sides):
    """However large the step, scalars stay within start and ambient, and velocity within its own range."""
    shape = (20, 21, 22)
    rng = np.random.default_rng(2)
    velocity = [rng.uniform(-1, 1, face_shape(shape, axis)) for axis in range(3)]
    for axis, component in enumerate(velocity):
        faces = np.moveaxis(component, axis, 0)
        faces[[end for end in (0, -1) if sides[2 * axis + end] == "closed"]] = 0.0
    advection = ADVECTION_SCHEMES[scheme](launcher, shape, sides)
    flow, carried = tuple(map(upload, velocity)), tuple(map(upload, velocity))
    scalar = upload(rng.uniform(1.0, 2.0, shape))
    ambient = 0.5
    for _ in range(3):
        advection.trace(flow, courant)
        carried, scalar = advection.advect_velocity(carried), advection.advect_scalar(scalar, ambient)
    low = 1.0 if sides == CLOSED else ambient
    round_off = 1e-6  # of an interpolation in float32
    assert low - round_off <= scalar.numpy().min() <= scalar.numpy().max() <= 2.0 + round_off
    for component in carried:
        assert np.abs(component.numpy()).max() <= 1.0 + round_off


@pytest.mark.parametrize("scheme", UNLIMITED_SCHEMES)
def test_limits_keep_the_range(launcher, upload, sample_velocity, scheme):
    """A box carried by 0.4 cells a step stays within 0 … 1 where limited, and leaves that by 5 % and more where not.

    Limits change nothing of a field without steps, where the scheme would not leave the range anyway.
    """
    shape = (32, 4, 4)
    velocity = sample_velocity(_uniform(1.0, 0.0, 0.0), shape)
    ramp = np.broadcast_to(np.linspace(0.0, 1.0, 32)[:, None, None], shape)
    results = []
    for kind in (ADVECTION_SCHEMES, UNLIMITED_SCHEMES):
        advection = kind[scheme](launcher, shape, CLOSED)
        advection.trace(velocity, 0.4)
        scalar, smooth = upload(_box(shape, (8, 0, 0), (16, 4, 4))), upload(ramp)
        for _ in range(8):
            scalar = advection.advect_scalar(scalar, 0.0)
        results.append((scalar.numpy().copy(), advection.advect_scalar(smooth, 0.0).numpy()[2:-2]))
    (limited, limited_ramp), (free, free_ramp) = results
    assert limited.min() >= 0.0
    assert limited.max() <= 1.0
    assert free.min() < -0.05
    assert free.max() > 1.05
    np.testing.assert_allclose(limited_ramp, free_ramp, atol=1e-6)


@SCHEMES
def test_constant_stays_in_a_closed_box(launcher, upload, scheme):
    """Nothing comes through closed sides: a constant field stays, to the bit, in any flow; their faces stay at 0."""
    shape = (9, 10, 11)
    rng = np.random.default_rng(3)
    velocity = []
    for axis in range(3):
        component = 10 * rng.standard_normal(face_shape(shape, axis))
        np.moveaxis(component, axis, 0)[[0, -1]] = 0.0
        velocity.append(upload(component))
    advection = ADVECTION_SCHEMES[scheme](launcher, shape, CLOSED)
    scalar = upload(np.full(shape, 0.75))
    for _ in range(2):
        advection.trace(velocity, 1.0)
        scalar = advection.advect_scalar(scalar, 0.0)
        velocity = advection.advect_velocity(velocity)
    np.testing.assert_array_equal(scalar.numpy(), 0.75)
    for axis, component in enumerate(velocity):
        np.testing.assert_array_equal(np.moveaxis(component.numpy(), axis, 0)[[0, -1]], 0.0)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_air_comes_in_through_open_sides(launcher, upload, sample_velocity, axis, direction):
    """A flow of ¾ cell a step through an open box mixes ¾ ambient into the first cell, and 1 from 1¾ cells on."""
    shape = (5, 6, 7)
    flow = sample_velocity(_uniform(*(direction * np.eye(3)[axis])), shape)
    results = []
    for courant in (0.75, 1.75):
        advection = ADVECTION_SCHEMES["semi_lagrangian"](launcher, shape, OPEN)
        advection.trace(flow, courant)
        scalar = advection.advect_scalar(upload(np.full(shape, 3.0)), 1.0)
        along = np.moveaxis(scalar.numpy(), axis, 0)
        results.append(along if direction > 0 else along[::-1])
    slow, fast = results
    np.testing.assert_allclose(slow[0], 1.0 + 0.25 * 2.0, rtol=1e-6)
    np.testing.assert_array_equal(slow[1:], 3.0)
    np.testing.assert_array_equal(fast[0], 1.0)
    np.testing.assert_allclose(fast[1], 1.0 + 0.25 * 2.0, rtol=1e-6)
    np.testing.assert_array_equal(fast[2:], 3.0)


@SCHEMES
def test_smoke_leaves_through_open_sides(launcher, upload, sample_velocity, scheme):
    """Smoke blown out of an open box is gone, and nothing comes back."""
    shape = (8, 8, 8)
    advection = ADVECTION_SCHEMES[scheme](launcher, shape, OPEN)
    flow = sample_velocity(_uniform(0.9, 0.6, -0.7), shape)
    scalar = upload(_box(shape, (2, 2, 2), (6, 6, 6)))
    for _ in range(30):
        advection.trace(flow, 1.0)
        scalar = advection.advect_scalar(scalar, 0.0)
    assert scalar.numpy().max() < 1e-9


@SCHEMES
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 6, 5), (6, 1, 5), (6, 5, 1)])
@pytest.mark.parametrize("sides", [CLOSED, OPEN])
def test_thin_domains(launcher, upload, sample_velocity, scheme, shape, sides):
    """One cell thick along any axis: a constant flow and a constant field among air of the same value stay."""
    advection = ADVECTION_SCHEMES[scheme](launcher, shape, sides)
    velocity = sample_velocity(_uniform(0.5, -0.25, 0.75), shape)
    scalar = upload(np.full(shape, 2.0))
    advection.trace(velocity, 1.0)
    np.testing.assert_array_equal(advection.advect_scalar(scalar, 2.0).numpy(), 2.0)
    carried = advection.advect_velocity(velocity)
    for axis, value in enumerate((0.5, -0.25, 0.75)):
        faces = np.moveaxis(carried[axis].numpy(), axis, 0)
        np.testing.assert_array_equal(faces if sides == OPEN else faces[1:-1], value)


def test_maccormack_keeps_more_of_a_vortex(launcher, upload, sample_velocity):
    """A turning flow carried by itself changes its kinetic energy far less with the second-order scheme."""
    shape = (24, 24, 4)
    kept = {}
    for scheme in ADVECTION_SCHEMES:
        advection = ADVECTION_SCHEMES[scheme](launcher, shape, CLOSED)
        velocity = sample_velocity(
            lambda x, y, z: (
                np.sin(np.pi * (x + 0.5) / 12) * np.cos(np.pi * (y + 0.5) / 12),
                -np.cos(np.pi * (x + 0.5) / 12) * np.sin(np.pi * (y + 0.5) / 12),
                0 * z,
            ),
            shape,
        )
        start = sum(float((c.numpy().astype(float) ** 2).sum()) for c in velocity)
        advection.trace(velocity, 0.5)
        velocity = advection.advect_velocity(velocity)
        kept[scheme] = sum(float((c.numpy().astype(float) ** 2).sum()) for c in velocity) / start
    assert kept["semi_lagrangian"] < 1.0
    for scheme in ("semi_lagrangian_cubic", "maccormack", "bfecc"):
        assert abs(1.0 - kept[scheme]) < 0.1 * (1.0 - kept["semi_lagrangian"])


def test_limit_energy(launcher, upload):
    """Too much energy is scaled to what is allowed; enough is left alone, and nothing is launched for it."""
    velocity = tuple(upload(np.full((2, 3, 4), 2.0)) for _ in range(3))
    before = launcher.launches.total()
    limit_energy(launcher, velocity, 5.0, 5.0)
    assert launcher.launches.total() == before
    limit_energy(launcher, velocity, 8.0, 2.0)
    for component in velocity:
        np.testing.assert_array_equal(component.numpy(), 1.0)
