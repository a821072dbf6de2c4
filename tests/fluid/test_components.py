"""Bodies of fluid: walls of solid cells and of closed faces divide them, and open sides let them out."""

import numpy as np
import pytest
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from pressure_cases import closed_components, without_means
from staggered import CLOSED, MIXED, OPEN, open_shares

from warp_smoke.fluid.grid import Box
from warp_smoke.fluid.pressure.components import ClosedComponents, label_components
from warp_smoke.launch import Launcher


def bodies(fluid, shares):
    """The body of each cell, from a graph of all cells."""
    cells = np.arange(fluid.size).reshape(fluid.shape)
    a, b = [], []
    for axis, share in enumerate(shares):
        opened = np.moveaxis(share, axis, 0)[1:-1] > 0
        index = np.moveaxis(cells, axis, 0)
        a.append(index[:-1][opened])
        b.append(index[1:][opened])
    a, b = np.concatenate(a), np.concatenate(b)
    graph = scipy.sparse.coo_array((np.ones(len(a)), (a, b)), shape=(fluid.size, fluid.size))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1].reshape(fluid.shape)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 0.2, 0.6]), st.sampled_from([0.0, 0.1, 0.5, 0.8, 1.0]))
def test_labels_are_the_connected_components(seed, solid, walls):
    """Cells have one label if and only if a path through open faces connects them; solid cells have 0."""
    rng = np.random.default_rng(seed)
    fluid = (rng.random((5, 6, 4)) >= solid).astype(np.float32)
    shares = [share * (rng.random(share.shape) >= walls) for share in open_shares(fluid, OPEN)]
    labels, count = label_components(fluid, shares)
    assert not labels[fluid == 0].any()
    found, expected = labels[fluid > 0], bodies(fluid, shares)[fluid > 0]
    pairs = {tuple(pair) for pair in np.stack([found, expected], axis=1).tolist()}
    assert len(pairs) == len(set(found.tolist())) == len(set(expected.tolist())) == count
    assert 0 not in found


@pytest.mark.parametrize("solids", [Box((2, 2, 1), (5, 4, 4)), Box((0, 0, 0), (8, 7, 6))], ids=["near", "all"])
@pytest.mark.parametrize("sides", [CLOSED, OPEN, MIXED], ids=["closed", "open", "mixed"])
def test_pocket_behind_walls_of_no_thickness(launcher, sides, solids):
    """A box of closed faces in the fluid is a body of its own, whose mean alone is removed if the sides are open."""
    fluid = np.ones((8, 7, 6), np.float32)
    shares = open_shares(fluid, sides)
    pocket = (slice(2, 5), slice(2, 4), slice(1, 4))
    for axis, share in enumerate(shares):
        for end in (pocket[axis].start, pocket[axis].stop):
            faces = list(pocket)
            faces[axis] = end
            share[tuple(faces)] = 0.0
    components = ClosedComponents(launcher, sides, launcher.array(fluid, "test"))
    components.find([launcher.array(share, "test") for share in shares], solids)
    field = np.random.default_rng(0).standard_normal(fluid.shape).astype(np.float32)
    device = launcher.array(field, "test")
    components.remove_means(device)
    expected = field.copy()
    expected[pocket] -= field[pocket].mean()
    if sides == CLOSED:
        outside = np.ones(fluid.shape, bool)
        outside[pocket] = False
        expected[outside] -= field[outside].mean()
    np.testing.assert_allclose(device.numpy(), expected, atol=1e-6)


def test_open_side_behind_a_wall_does_not_count(launcher):
    """Where a wall closes the faces of the domain's only open side, all of the fluid is closed in."""
    fluid, sides = np.ones((4, 5, 6), np.float32), ("open", *CLOSED[1:])
    shares = open_shares(fluid, sides)
    for closed, mean in ((False, 1.0), (True, 0.0)):
        if closed:
            shares[0][0] = 0.0
        components = ClosedComponents(launcher, sides, launcher.array(fluid, "test"))
        components.find([launcher.array(share, "test") for share in shares], Box((0, 0, 0), fluid.shape))
        field = launcher.array(np.ones(fluid.shape, np.float32), "test")
        components.remove_means(field)
        assert field.numpy().mean() == pytest.approx(mean)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([CLOSED, OPEN, MIXED]), st.data())
def test_means_of_random_bodies(seed, sides, data):
    """Solids and walls in any box of cells, touching sides or not: the mean of each closed body is removed."""
    shape, launcher = (6, 5, 7), Launcher("cpu", 1)
    ends = [sorted(data.draw(st.tuples(st.integers(0, n), st.integers(0, n)))) for n in shape]
    box = Box(
        *zip(*[(low, max(high, min(low + 1, n))) for (low, high), n in zip(ends, shape, strict=True)], strict=True)
    )
    rng = np.random.default_rng(seed)
    inside = np.zeros(shape, bool)
    inside[tuple(slice(*each) for each in zip(*box, strict=True))] = True
    fluid = (~inside | (rng.random(shape) > 0.3)).astype(np.float32)
    shares = open_shares(fluid, sides)
    for axis, share in enumerate(shares):
        along = np.moveaxis(share, axis, 0)
        cells = np.moveaxis(inside, axis, 0)
        beside = np.concatenate([cells[:1], cells[1:] | cells[:-1], cells[-1:]])
        along[beside & (rng.random(beside.shape) > 0.5)] = 0.0
    components = ClosedComponents(launcher, sides, launcher.array(fluid, "test"))
    components.find([launcher.array(share, "test") for share in shares], box)
    field = rng.standard_normal(shape).astype(np.float32) * fluid
    device = launcher.array(field, "test")
    components.remove_means(device)
    expected = without_means(field, closed_components(fluid, sides, shares))
    np.testing.assert_allclose(device.numpy() * fluid, expected * fluid, atol=2e-6)
