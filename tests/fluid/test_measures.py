"""Whole-field measures against NumPy in float64."""

import numpy as np
import pytest

from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.measures import Measures
from warp_smoke.launch import Launcher

SHAPES = [(5, 33, 7), (1, 1, 1), (2, 16, 3), (40, 70, 20)]


def _random_faces(shape, seed=1):
    rng = np.random.default_rng(seed)
    return [rng.standard_normal(face_shape(shape, axis)).astype(np.float32) for axis in range(3)]


@pytest.mark.parametrize("shape", SHAPES)
def test_motion(launcher, upload, shape):
    """Largest component and ½ Σ u² with faces on the sides counted half, for any size."""
    velocity = _random_faces(shape)
    speed, energy = Measures(launcher, shape).motion(tuple(map(upload, velocity)))
    expected = 0.0
    for axis, component in enumerate(velocity):
        square = np.moveaxis(component.astype(float) ** 2, axis, 0)
        expected += 0.5 * square.sum() - 0.25 * (square[0].sum() + square[-1].sum())
    assert speed == max(np.abs(component).max() for component in velocity)
    # Each cell's own six squares are summed in float32.
    assert energy == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_work(launcher, upload, shape):
    """Σ f · u and Σ f² over the cells."""
    rng = np.random.default_rng(2)
    velocity = _random_faces(shape)
    force = [rng.standard_normal(shape).astype(np.float32) for _ in range(3)]
    power, square = Measures(launcher, shape).work(tuple(map(upload, velocity)), tuple(map(upload, force)))
    expected = size = 0.0
    for axis, (component, f) in enumerate(zip(velocity, force, strict=True)):
        faces = np.moveaxis(component.astype(float), axis, 0)
        terms = np.moveaxis(f.astype(float), axis, 0) * 0.5 * (faces[1:] + faces[:-1])
        expected, size = expected + terms.sum(), size + np.abs(terms).sum()
    assert power == pytest.approx(expected, abs=1e-6 * size)
    assert square == pytest.approx(sum((f.astype(float) ** 2).sum() for f in force), rel=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_departure(launcher, upload, shape):
    """Largest distance from ambient, on either side of it."""
    values = np.random.default_rng(3).uniform(-1, 2, shape).astype(np.float32)
    measures = Measures(launcher, shape)
    for ambient in (0.0, 1.5):
        assert measures.departure(upload(values), ambient) == np.abs(values - np.float32(ambient)).max()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", [(0, 0, 0), (3, 17, 6), (4, 32, 0)])
def test_sees_what_is_not_finite(launcher, upload, bad, where):
    """One NaN or infinity anywhere shows in the energy and in the departure, whatever follows it."""
    shape = (5, 33, 7)
    velocity, scalar = _random_faces(shape), np.ones(shape)
    velocity[1][where] = scalar[where] = bad
    measures = Measures(launcher, shape)
    assert not np.isfinite(measures.motion(tuple(map(upload, velocity)))[1])
    assert not np.isfinite(measures.departure(upload(scalar), 0.0))


@pytest.mark.usefixtures("divided_launches")
def test_same_sums_for_any_number_of_threads():
    """1, 2 and 7 threads measure the same to the bit."""
    shape = (70, 64, 64)
    velocity, results = _random_faces(shape), set()
    for threads in (1, 2, 7):
        launcher = Launcher("cpu", threads)
        faces = tuple(launcher.array(component, "test") for component in velocity)
        measures = Measures(launcher, shape)
        cells = [launcher.array(component[:70, :64, :64].copy(), "test") for component in velocity]
        results.add((*measures.motion(faces), *measures.work(faces, cells), measures.departure(cells[0], 0.5)))
    assert len(results) == 1
