"""Vorticity confinement of any strength."""

import numpy as np
import pytest
from hard_cases import CLOSED, check_finite, field_difference, simulate, small_plume

from warp_smoke.fluid.measures import Measures
from warp_smoke.scene import ADVECTION_SCHEMES
from warp_smoke.simulation import Simulation


@pytest.mark.parametrize("strength", [1.0, 1e3, 1e9])
@pytest.mark.parametrize("advection", ADVECTION_SCHEMES)
def test_energy_is_capped(advection, strength, record_property):
    """From a random flow in a closed box, with confinement of 1 to 1e9: kinetic energy does not grow."""
    scene = small_plume(advection=advection, vorticity=strength, boundary=CLOSED, buoyancy_temperature=1e-9)
    simulation = Simulation(scene)
    simulation.step()
    solver, random = simulation.solver(), np.random.default_rng(5)
    for component in solver.state.velocity:
        component.assign(random.standard_normal(component.shape).astype(np.float32))
    measures, energies, frames = Measures(simulation.launcher, solver.state.density.shape), [], []
    for _ in range(6):
        frames.append(simulation.step())
        energies.append(measures.motion(solver.state.velocity)[1])
    check_finite(frames)
    growth = float(np.max(np.diff(energies))) / energies[0]
    record_property("growth of kinetic energy in a frame", max(0.0, growth))
    # The cap sums the work of confinement before pressure takes its share, which is not exact.
    assert growth <= 1e-3


def test_a_trace_of_it_is_nothing(record_property):
    """Confinement of 1e-9 is no confinement, to round-off: it does not switch anything else."""
    difference = field_difference(simulate(small_plume())[1], simulate(small_plume(vorticity=1e-9))[1])
    record_property("difference of density", difference)
    assert difference < 2e-5
