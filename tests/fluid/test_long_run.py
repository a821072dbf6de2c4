"""Ten thousand steps in float32: what should stay does, and nothing grows."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import plume

import warp_smoke as ws

STEPS = 10_000


@pytest.mark.slow
def test_ten_thousand_steps_in_a_closed_box(record_property):
    """Mass drift, mean pressure and energy of a stirred, closed box at 32³ over 10 000 steps are bounded.

    The box is filled once and then stirred by turbulence without end. Advection by traces does not conserve mass
    exactly, but each step keeps it within the range of what was there, so that it can neither grow above the largest
    density times the volume nor fall below the least: bounds that hold for any number of steps. The pressure of a
    closed box has no mean: round-off alone, 2⁻²⁴ of the largest pressure for each of log₂ 32³ additions. Stirring puts
    energy in and the schemes take it out: after the first thousand steps there is a balance.
    """
    domain = replace(
        plume(resolution=32).domains[0],
        boundary=("closed",) * 6,
        turbulence=1.0,
        buoyancy_temperature=0.0,
        vorticity=0.3,
        active_box=False,
    )
    simulation = ws.Simulation(replace(plume(), domains=[domain], surfaces=(), lights=()))
    simulation.step()
    solver = simulation.solver()
    nodes = (np.arange(32) + 0.5) / 32
    filled = 1.0 + 0.5 * np.cos(np.pi * nodes)[:, None, None] * np.cos(np.pi * nodes)[:, None] * np.ones(32)
    solver._sources = []  # the smoke that is there is all there ever is
    simulation.density = filled.astype(np.float32)
    mass = float(simulation.density.numpy().sum(dtype=np.float64))
    masses, energies, pressures = [], [], []
    for step in range(STEPS):
        solver.step(step / 4, (step + 1) / 4, 1 / 96)
        if step % 100 == 99:
            state = solver.state
            masses.append(float(state.density.numpy().sum(dtype=np.float64)) / mass)
            energies.append(sum(float((u.numpy().astype(np.float64) ** 2).sum()) for u in state.velocity))
            pressure = state.pressure.numpy().astype(np.float64)
            pressures.append(abs(pressure.mean()) / np.abs(pressure).max())
            density = state.density.numpy()
            assert density.min() >= filled.min() - 1e-6
            assert density.max() <= filled.max() + 1e-6
    drift, late = max(abs(each - 1.0) for each in masses), energies[10:]
    record_property("mass drift", drift)
    record_property("mean pressure, of the largest", float(max(pressures)))
    record_property("largest energy, of the median", float(max(late) / np.median(late)))
    assert drift < 0.05  # ten times what is measured; the range of densities would allow 0.5
    assert max(pressures) < 15 * 2.0**-24
    assert max(late) < 4.0 * np.median(late)
    assert np.mean(energies[-20:]) < 1.5 * np.mean(late[:20])
