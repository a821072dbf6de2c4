"""Conservative reach tests: never a false "no" against rays, and a "no" where it is plain."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import at, shining

import warp_smoke as ws
from warp_smoke.lattice import place_lattice
from warp_smoke.plan import reach
from warp_smoke.plan.reach import in_box, in_range, may_shadow, swept_corners
from warp_smoke.record import Samples

FRAMES = range(1, 3)
# Of six decimals: where two points lie closer than round-off, the test of rays below may take either side.
COORDINATE = st.floats(-5, 5).map(lambda x: round(x, 6))
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE)


def segment_meets_box(start, end, lower, upper):
    """Slab test of a segment against a box."""
    direction = end - start
    near, far = 0.0, 1.0
    for axis in range(3):
        if abs(direction[axis]) < 1e-12:
            if not lower[axis] <= start[axis] <= upper[axis]:
                return False
            continue
        t = sorted(((lower - start)[axis] / direction[axis], (upper - start)[axis] / direction[axis]))
        near, far = max(near, t[0]), min(far, t[1])
    return near <= far


@pytest.mark.parametrize("flat", [False, True])
def test_few_and_many_points_agree(monkeypatch, flat):
    """Axes that may separate, for few points, decide as the linear program does, for many; flat hulls as well."""
    decided = []
    for most in (100, 0):
        monkeypatch.setattr(reach, "_MOST_FOR_AXES", most)
        rng = np.random.default_rng(4)
        for _ in range(100):
            points = rng.normal(size=(rng.integers(1, 16), 3)) * (1, not flat, 1) + rng.normal(size=3)
            half = rng.uniform(0.1, 1, 3)
            decided.append(reach._hull_meets_box(points, -half, half))
    assert decided[:100] == decided[100:]
    assert 10 < sum(decided[:100]) < 90


@settings(max_examples=200, deadline=None)
@given(POINT, st.lists(POINT, min_size=3, max_size=6), POINT, st.floats(0.1, 2))
def test_never_misses_a_ray(lamp, receiver, corner, size):
    """If any segment from the light to a point of the receiver crosses the box, the pair is kept."""
    light = ws.PointLight(path="/Lamp", transform=at(*lamp))
    receiver = np.array(receiver)
    lower = np.array(corner)
    blocker = np.stack([lower, lower + size])
    weights = np.random.default_rng(0).dirichlet(np.ones(len(receiver)), 100)
    crossed = any(segment_meets_box(np.array(lamp), p, lower, lower + size) for p in weights @ receiver)
    assert may_shadow(light, blocker, receiver, FRAMES) or not crossed


@pytest.mark.parametrize(
    ("light", "kept"),
    [
        (ws.PointLight(path="/L", transform=at(0, 5, 0)), True),
        (ws.PointLight(path="/L", transform=at(0, 0.5, 0)), False),
        (ws.PointLight(path="/L", transform=at(20, 5, 0)), False),
        (ws.DistantLight(path="/L", transform=shining((0, -1, 0))), True),
        (ws.DistantLight(path="/L", transform=shining((0, 1, 0))), False),
        (ws.DistantLight(path="/L", transform=shining((5, -1, 0))), False),
        (ws.SpotLight(path="/L", transform=shining((0, -1, 0)) @ at(0, 5, 0), cone_angle=5), True),
        (ws.SpotLight(path="/L", transform=shining((1, 0, 0)) @ at(0, 5, 0), cone_angle=5), False),
    ],
)
def test_plain_cases(light, kept):
    """A box two units over a patch is between it and a light above, not one below, beside or turned away."""
    patch = np.array([[x, 0, z] for x in (-1, 1) for z in (-1, 1)], float)
    box = np.array([[-0.5, 2, -0.5], [0.5, 3, 0.5]])
    assert may_shadow(light, box, patch, FRAMES) == kept


def test_moving_light_counts_at_every_frame():
    """A light that passes over the box for one frame keeps the pair."""
    patch = np.array([[x, 0, z] for x in (-1, 1) for z in (-1, 1)], float)
    box = np.array([[-0.5, 2, -0.5], [0.5, 3, 0.5]])
    passing = Samples([1, 2], [at(40, 5, 0), at(0, 5, 0)])
    assert may_shadow(ws.PointLight(path="/L", transform=passing), box, patch, FRAMES)


def test_lattice_tests():
    """Meshes touch the box that they overlap at any of the frames."""
    domain = ws.SmokeDomain(path="/Smoke", resolution=8)
    lattice = place_lattice(ws.Scene(domains=[domain]), domain)
    ball = ws.Emitter(
        path="/Ball", mesh=ws.Mesh.sphere(0.5, 16), transform=Samples([1, 2], [at(9, 0, 0), at(1.4, 0, 0)])
    )
    assert in_box(lattice, swept_corners(ball, FRAMES))
    assert not in_box(lattice, swept_corners(ball, range(1, 2)))  # samples outside the frames do not count


def test_range():
    """A falloff's end is measured to the nearest point of the bounds."""
    patch = np.array([[2, 0, 0], [3, 0, 1]], float)
    assert in_range(ws.PointLight(path="/L", falloff_end=2.1), patch, FRAMES)
    assert not in_range(ws.PointLight(path="/L", falloff_end=1.9), patch, FRAMES)
    assert in_range(ws.PointLight(path="/L"), patch, FRAMES)
