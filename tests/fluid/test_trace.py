"""Traces: exact in uniform flow, order 2 in a turning one, and an end at the domain's sides."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp

from warp_smoke.fluid.grid import all_cells
from warp_smoke.fluid.runge_kutta import TRACES, trace_back, trace_both_ways
from warp_smoke.fluid.trace import make_displacement, trace_limits

SHAPE = (16, 17, 18)
OPEN, CLOSED = ("open",) * 6, ("closed",) * 6
AXIS = np.array([1.0, 2.0, 2.0]) / 3.0
CENTER = np.array([7.0, 8.5, 9.0])


def _turning(x, y, z):
    """Solid-body rotation with one radian a second about AXIS through CENTER."""
    return np.cross(AXIS, np.stack([x, y, z], axis=-1) - CENTER).transpose(3, 0, 1, 2)


def _turned(points: np.ndarray, angle: float) -> np.ndarray:
    """Points [n, 3] turned about AXIS through CENTER (Rodrigues)."""
    r = points - CENTER
    along = (r @ AXIS)[:, None] * AXIS
    return CENTER + along + np.cos(angle) * (r - along) + np.sin(angle) * np.cross(AXIS, r)


def _points(d) -> np.ndarray:
    """A displacement of every cell, [n, 3]."""
    return np.stack([along.numpy().ravel() for along in (d.x, d.y, d.z)], axis=1)


def _traces(launcher, velocity, step, limits, scheme="rk2"):
    """Displacements backwards and forwards of every cell, each [n, 3]; the trace back alone is the same."""
    back, ahead, alone = (make_displacement(launcher, SHAPE) for _ in range(3))
    trace_both_ways(launcher, scheme, all_cells(SHAPE), velocity, step, limits, back, ahead)
    trace_back(launcher, scheme, all_cells(SHAPE), velocity, step, limits, alone)
    np.testing.assert_array_equal(_points(alone), _points(back))
    return _points(back), _points(ahead)


FAR = wp.vec3(-100.0, -100.0, -100.0), wp.vec3(100.0, 100.0, 100.0)


def test_uniform_flow(launcher, sample_velocity):
    """In uniform flow the displacement is ∓ u dt / h to the bit, both ways."""
    velocity = sample_velocity(lambda x, y, z: (1.0, -0.5, 0.25), SHAPE)
    back, ahead = _traces(launcher, velocity, 2.0, FAR)
    np.testing.assert_array_equal(back, np.broadcast_to([-2.0, 1.0, -0.5], back.shape))
    np.testing.assert_array_equal(ahead, -back)


def test_order_in_solid_rotation(launcher, sample_velocity):
    """One step of the midpoint rule misses the turned point by O(dt³), and so does the forward trace made from it.

    The plain negation of the backward trace would miss it by O(dt²).
    """
    velocity = sample_velocity(_turning, SHAPE)
    points = np.stack(np.indices(SHAPE).reshape(3, -1), axis=1).astype(float)
    middle = np.linalg.norm(points - CENTER, axis=1) < 5  # none of their traces leaves the samples
    errors = []
    for angle in (0.4, 0.2, 0.1):
        back, ahead = _traces(launcher, velocity, angle, FAR)
        exact = [_turned(points, sign * angle) - points for sign in (-1, 1)]
        errors.append(
            [np.abs((d - e)[middle]).max() for d, e in zip((back, ahead, -back), (*exact, exact[1]), strict=True)]
        )
    rates = [np.log2(np.array(a) / b) for a, b in pairwise(errors)]
    np.testing.assert_allclose(rates, np.broadcast_to([3.0, 3.0, 2.0], (2, 3)), atol=0.1)


@pytest.mark.parametrize(("scheme", "order"), [("euler", 1), ("rk2", 2), ("rk3", 3)])
def test_order_of_the_traces(launcher, sample_velocity, scheme, order):
    """One step of each method misses the turned point by O(dt^(order + 1)), as fitted over three steps."""
    velocity = sample_velocity(_turning, SHAPE)
    points = np.stack(np.indices(SHAPE).reshape(3, -1), axis=1).astype(float)
    middle = np.linalg.norm(points - CENTER, axis=1) < 4.5  # none of their traces leaves the samples
    angles, errors = (0.8, 0.4, 0.2), []
    for angle in angles:
        back, _ = _traces(launcher, velocity, angle, FAR, scheme)
        errors.append(np.abs((back - (_turned(points, -angle) - points))[middle]).max())
    assert np.polyfit(np.log(angles), np.log(errors), 1)[0] == pytest.approx(order + 1, abs=0.1)
    assert len(TRACES) == 3


@pytest.mark.parametrize("sides", [OPEN, CLOSED, ("open", "closed", "closed", "open", "open", "closed")])
def test_traces_end_at_the_sides(launcher, upload, sides):
    """However fast the flow: on closed sides, and a cell's centre beyond open ones, both ways."""
    rng = np.random.default_rng(1)
    shapes = [tuple(n + (a == axis) for a, n in enumerate(SHAPE)) for axis in range(3)]
    velocity = tuple(upload(1e4 * rng.standard_normal(shape)) for shape in shapes)
    points = np.stack(np.indices(SHAPE).reshape(3, -1), axis=1)
    for displacement in _traces(launcher, velocity, 1.0, trace_limits(SHAPE, sides)):
        ends = points + displacement
        for axis in range(3):
            low = -0.5 if sides[2 * axis] == "closed" else -1.0
            high = SHAPE[axis] - (0.5 if sides[2 * axis + 1] == "closed" else 0.0)
            assert (ends[:, axis].min(), ends[:, axis].max()) == (low, high)
