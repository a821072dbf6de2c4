"""Divergence and gradient: known answers, L = divergence of gradient, adjointness, closed sides."""

from types import SimpleNamespace

import numpy as np
import pytest
from staggered import (
    ALL_SIDES,
    PERIODIC,
    PERIODIC_SIDES,
    face_shapes,
    join_seams,
    laplacian_matrix,
    no_velocity,
    random_velocity,
)

from warp_smoke.fluid.operators import (
    close_sides,
    measure_divergence,
    measure_fluid_divergence,
    subtract_fluid_gradient,
    subtract_gradient,
)
from warp_smoke.launch import Launcher

SHAPES = [(4, 5, 6), (1, 3, 2), (5, 1, 1), (1, 1, 1)]


def face_weights(shape, sides):
    """Share of a cell's length that belongs to each face: ½ on the sides, whose faces are at an end or stored twice."""
    weights = []
    for axis, faces in enumerate(face_shapes(shape)):
        weight = np.ones(faces)
        ends = np.moveaxis(weight, axis, 0)
        ends[0] = ends[-1] = 0.5
        weights.append(weight)
    return weights


def test_divergence_of_linear_field(launcher):
    """The field u = (2x, −3y, ½z) has divergence −½ in every cell, exactly: all numbers are small multiples of ½."""
    shape = (6, 7, 9)
    velocity = []
    for axis, (faces, slope) in enumerate(zip(face_shapes(shape), (2.0, -3.0, 0.5), strict=True)):
        velocity.append(launcher.array((slope * np.indices(faces)[axis]).astype(np.float32), "test"))
    divergence = launcher.zeros(shape, "test")
    measure_divergence(launcher, velocity, divergence)
    np.testing.assert_array_equal(divergence.numpy(), -0.5)


@pytest.mark.parametrize("shape", SHAPES)
def test_divergence_of_gradient_is_laplacian(launcher, shape):
    """−divergence of what `subtract_gradient` takes off a velocity of 0 is L q, for all 125 mixes of sides."""
    values = np.random.default_rng(1).standard_normal(shape).astype(np.float32)
    q, divergence = launcher.array(values, "test"), launcher.zeros(shape, "test")
    for sides in ALL_SIDES + PERIODIC_SIDES:
        velocity = no_velocity(launcher, shape)
        subtract_gradient(launcher, q, sides, velocity)
        measure_divergence(launcher, velocity, divergence)
        matrix = laplacian_matrix([np.ones(s) for s in face_shapes(shape)], sides)
        expected = (matrix @ values.ravel()).reshape(shape)
        # A few sums of numbers up to about 10: some ulps of that.
        np.testing.assert_allclose(-divergence.numpy(), expected, atol=1e-5, err_msg=str(sides))


@pytest.mark.parametrize("shape", SHAPES)
def test_gradient_is_adjoint_of_divergence(launcher, shape):
    """⟨divergence u, q⟩ = −⟨u, gradient q⟩, faces on the sides counted half, for all mixes of sides.

    Velocities through closed sides are 0.
    """
    values = np.random.default_rng(2).standard_normal(shape).astype(np.float32)
    q, divergence = launcher.array(values, "test"), launcher.zeros(shape, "test")
    for sides in ALL_SIDES + PERIODIC_SIDES:
        velocity = random_velocity(launcher, shape, sides=sides)
        close_sides(launcher, sides, velocity)
        before = [u.numpy().astype(np.float64) for u in velocity]
        measure_divergence(launcher, velocity, divergence)
        subtract_gradient(launcher, q, sides, velocity)
        left = np.sum(divergence.numpy().astype(np.float64) * values)
        right = 0.0
        for weight, u, after in zip(face_weights(shape, sides), before, velocity, strict=True):
            right += np.sum(weight * u * (u - after.numpy()))
        # Each side sums about 100 products with errors of 1e-7.
        assert left == pytest.approx(-right, abs=1e-5), sides


def test_weighted_gradient_is_adjoint_of_weighted_divergence(launcher):
    """⟨divergence (w u), q⟩ = −⟨u, gradient q⟩ with shares w of the faces open, for all mixes of sides."""
    shape = (4, 5, 6)
    rng = np.random.default_rng(3)
    values = rng.standard_normal(shape).astype(np.float32)
    shares = [rng.random(s).astype(np.float32) for s in face_shapes(shape)]
    join_seams(shares, PERIODIC)
    wx, wy, wz = (launcher.array(w, "test") for w in shares)
    fluid = launcher.array(np.ones(shape, np.float32), "test")
    solids = SimpleNamespace(fluid=fluid, wx=wx, wy=wy, wz=wz)
    q, divergence = launcher.array(values, "test"), launcher.zeros(shape, "test")
    for sides in ALL_SIDES + PERIODIC_SIDES:
        velocity = random_velocity(launcher, shape, sides=sides)
        close_sides(launcher, sides, velocity)
        before = [u.numpy().copy() for u in velocity]
        flow = tuple(launcher.array(w * u, "test") for w, u in zip(shares, before, strict=True))
        measure_fluid_divergence(launcher, flow, solids, divergence)
        subtract_fluid_gradient(launcher, q, sides, solids, velocity)
        left = np.sum(divergence.numpy().astype(np.float64) * values)
        right = 0.0
        for weight, u, after in zip(face_weights(shape, sides), before, velocity, strict=True):
            right += np.sum(weight * u.astype(np.float64) * (u - after.numpy().astype(np.float64)))
        assert left == pytest.approx(-right, abs=1e-5), sides


def test_open_shares_of_one_change_nothing(launcher):
    """With every face open the weighted gradient equals the plain one to the bit."""
    shape, sides = (5, 6, 7), ("open", "closed", "closed", "open", "open", "open")
    q = launcher.array(np.random.default_rng(4).standard_normal(shape).astype(np.float32), "test")
    wx, wy, wz = (launcher.array(np.ones(s, np.float32), "test") for s in face_shapes(shape))
    plain, weighted = random_velocity(launcher, shape), random_velocity(launcher, shape)
    subtract_gradient(launcher, q, sides, plain)
    subtract_fluid_gradient(launcher, q, sides, SimpleNamespace(wx=wx, wy=wy, wz=wz), weighted)
    for one, other in zip(plain, weighted, strict=True):
        np.testing.assert_array_equal(one.numpy(), other.numpy())


def test_fluid_divergence_is_zero_in_solids(launcher):
    """Divergence is measured in fluid and 0 in solid cells."""
    shape = (4, 5, 6)
    mask = (np.random.default_rng(5).random(shape) > 0.4).astype(np.float32)
    velocity = random_velocity(launcher, shape)
    plain, masked = launcher.zeros(shape, "test"), launcher.zeros(shape, "test")
    measure_divergence(launcher, velocity, plain)
    measure_fluid_divergence(launcher, velocity, SimpleNamespace(fluid=launcher.array(mask, "test")), masked)
    np.testing.assert_array_equal(masked.numpy(), mask * plain.numpy())


@pytest.mark.parametrize("shape", SHAPES)
def test_closed_sides_stop_the_flow_through_them_alone(launcher, shape):
    """`close_sides` sets the outermost faces of closed sides to 0 and leaves all others as they are."""
    for sides in ALL_SIDES:
        velocity = random_velocity(launcher, shape)
        expected = [u.numpy().copy() for u in velocity]
        for axis, faces in enumerate(expected):
            ends = np.moveaxis(faces, axis, 0)
            for end in (0, 1):
                if sides[2 * axis + end] == "closed":
                    ends[-end] = 0.0
        close_sides(launcher, sides, velocity)
        for u, wanted in zip(velocity, expected, strict=True):
            np.testing.assert_array_equal(u.numpy(), wanted, err_msg=str(sides))


def test_gradient_keeps_closed_sides(launcher):
    """Velocity through a closed side is not changed by pressure."""
    shape, sides = (4, 5, 6), ("closed",) * 6
    velocity = random_velocity(launcher, shape)
    before = [u.numpy().copy() for u in velocity]
    q = launcher.array(np.random.default_rng(6).standard_normal(shape).astype(np.float32), "test")
    subtract_gradient(launcher, q, sides, velocity)
    for axis, (u, old) in enumerate(zip(velocity, before, strict=True)):
        for end in (0, -1):
            np.testing.assert_array_equal(np.moveaxis(u.numpy(), axis, 0)[end], np.moveaxis(old, axis, 0)[end])


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads():
    """1, 2 and 7 threads give bit-equal divergences and velocities."""
    shape, sides = (67, 61, 35), ("open", "closed", "closed", "open", "open", "open")
    values = np.random.default_rng(7).standard_normal(shape).astype(np.float32)
    results = []
    for threads in (1, 2, 7):
        launcher = Launcher("cpu", threads)
        velocity, divergence = random_velocity(launcher, shape), launcher.zeros(shape, "test")
        close_sides(launcher, sides, velocity)
        subtract_gradient(launcher, launcher.array(values, "test"), sides, velocity)
        measure_divergence(launcher, velocity, divergence)
        results.append([array.numpy().copy() for array in (*velocity, divergence)])
    for result in results[1:]:
        for one, other in zip(results[0], result, strict=True):
            np.testing.assert_array_equal(one.view(np.int32), other.view(np.int32))
