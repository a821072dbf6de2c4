"""Domains of one cell, one cell thick, long and thin, and of sizes that no block divides."""

from dataclasses import replace
from itertools import zip_longest

import numpy as np
import pytest
from hard_cases import BALL, CLOSED, check_finite, simulate, small_plume, smoke_of
from scenes import at

from warp_smoke.scene import ADVECTION_SCHEMES, PRESSURE_SOLVERS

# Sides of the box, and cells along the longest.
SHAPES = {
    "one cell": ((1, 1, 1), 1),
    "a row": ((1, 1, 12), 12),
    "a column": ((1, 12, 1), 12),
    "a sheet": ((12, 12, 1), 12),
    "1 : 1000": ((0.002, 2, 0.002), 1000),
    "1000 : 1": ((2, 0.002, 0.002), 1000),
    "primes": ((7, 11, 13), 13),
    "9 × 17 × 5": ((9, 17, 5), 17),
}
# Every scheme once.
SCHEMES = list(zip_longest(ADVECTION_SCHEMES, PRESSURE_SOLVERS, fillvalue="maccormack"))


@pytest.mark.parametrize(("advection", "pressure"), SCHEMES)
@pytest.mark.parametrize(
    ("shape", "boundary"),
    [
        pytest.param(shape, CLOSED if n % 2 else None, id=shape, marks=[pytest.mark.slow] * (shape == "1 : 1000"))
        for n, shape in enumerate(SHAPES)
    ],
)
def test_shapes(shape, boundary, advection, pressure, record_property):
    """Every scheme in every shape, lit and baked too: the cells that were asked for, all of it finite and in range."""
    size, resolution = SHAPES[shape]
    half = np.array(size) / max(size) * (1.0 if max(size) > 1 else 0.5)
    fields = {"vorticity": 0.3, "grids": ("density", "velocity", "light"), "advection": advection}
    fields |= {"lower": tuple(-half), "upper": tuple(half), "resolution": resolution, "pressure_solver": pressure}
    scene = small_plume(8, boundary=boundary, **fields)
    source = replace(scene.emitters[0], transform=at(0, 1, 0))
    scene = replace(scene, end=2, emitters=[source], colliders=[BALL] if pressure != "spectral" else [])
    simulation, frames = simulate(scene)
    check_finite(frames)
    cells = np.maximum(1, np.round(resolution * half / half.max())).astype(int)
    assert simulation.density.shape == tuple(cells)
    largest = max(float(smoke_of(frame).density.max()) for frame in frames)
    record_property("largest density, of the source's", largest)
    assert largest <= 1.0 + 1e-6
