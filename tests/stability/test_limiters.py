"""Advection of a step: no scheme leaves the range of what it carries."""

import numpy as np
import pytest
from hard_cases import CLOSED, small_plume, smoke_of

from warp_smoke.scene import ADVECTION_SCHEMES
from warp_smoke.simulation import Simulation


@pytest.mark.parametrize("boundary", [None, CLOSED], ids=["open", "closed"])
@pytest.mark.parametrize("advection", ADVECTION_SCHEMES)
def test_step_profile(advection, boundary, record_property):
    """Blocks of density 1 carried by a plume's flow: from 0 to 1 in every frame, never less than nothing."""
    scene = small_plume(advection=advection, boundary=boundary, max_courant=2.0)
    simulation = Simulation(scene)
    simulation.step()
    blocks = np.zeros(simulation.density.shape, np.float32)
    blocks[2:7, 2:7, 2:7] = blocks[8:, 8:, :] = 1.0
    simulation.density = blocks
    lowest, highest = 0.0, 1.0
    for _ in range(6):
        density = smoke_of(simulation.step()).density
        lowest, highest = min(lowest, float(density.min())), max(highest, float(density.max()))
    record_property("density below 0", abs(lowest))
    record_property("density above 1", highest - 1.0)
    assert lowest == 0.0
    assert highest <= 1.0 + 1e-6


@pytest.mark.parametrize("advection", ADVECTION_SCHEMES)
def test_even_smoke_stays_even(advection, record_property):
    """A closed box full of density 1 stays full of it, whatever the flow."""
    scene = small_plume(advection=advection, boundary=CLOSED, active_box=False)
    simulation = Simulation(scene)
    simulation.step()
    simulation.density = np.ones(simulation.density.shape, np.float32)
    frames = [simulation.step() for _ in range(4)]
    difference = max(float(np.abs(smoke_of(frame).density - 1.0).max()) for frame in frames)
    record_property("departure from 1", difference)
    assert difference == 0.0
