"""Densities and temperatures of a million, viscosity from nothing to 1e6 m²/s."""

from dataclasses import replace

import numpy as np
import pytest
from hard_cases import BALL, CLOSED, check_finite, simulate, small_plume, smoke_of

import warp_smoke as ws
from warp_smoke.fluid.measures import Measures
from warp_smoke.scene import ADVECTION_SCHEMES, DIFFUSION_SOLVERS
from warp_smoke.simulation import Simulation


@pytest.mark.parametrize("advection", ADVECTION_SCHEMES)
@pytest.mark.parametrize(("density", "temperature"), [(1e6, 1.0), (1.0, 1e6), (1e6, -1e6)])
def test_a_million(advection, density, temperature, record_property):
    """A density or a temperature of a million, with weight and heat: finite, and never more than that."""
    scene = small_plume(advection=advection, buoyancy_density=1.0, vorticity=0.5)
    source = replace(scene.emitters[0], density=density, temperature=temperature)
    _, frames = simulate(replace(scene, emitters=[source]))
    check_finite(frames)
    largest = max(float(smoke_of(frame).density.max()) for frame in frames) / density
    hottest = max(float(np.abs(smoke_of(frame).temperature).max()) for frame in frames) / abs(temperature)
    record_property("largest density, of the source's", largest)
    record_property("largest temperature, of the source's", hottest)
    assert max(largest, hottest) <= 1.0 + 1e-5


@pytest.mark.parametrize("advection", ADVECTION_SCHEMES)
def test_density_has_no_scale(advection):
    """2²⁰ times as much smoke, where it has no weight, is 2²⁰ times the same smoke, to 1e-18 of it."""
    scene = small_plume(advection=advection)
    _, frames = simulate(scene)
    _, dense = simulate(replace(scene, emitters=[replace(scene.emitters[0], density=2.0**20)]))
    for one, other in zip(frames, dense, strict=True):
        # Advection drops what is less than 1e-20, whatever the rest is.
        np.testing.assert_allclose(smoke_of(other).density, smoke_of(one).density * 2.0**20, rtol=0, atol=1e-12)


@pytest.mark.parametrize("viscosity", [0.0, 1e-30, 1e-6, 1.0, 1e6])
@pytest.mark.parametrize("diffusion", DIFFUSION_SOLVERS)
def test_viscosity(diffusion, viscosity, record_property):
    """Viscosity from nothing to 1e6 m²/s: finite, and a random flow that nothing drives loses energy in every frame."""
    fields = {"viscosity": viscosity, "density_diffusion": viscosity, "diffusion_solver": diffusion}
    scene = small_plume(boundary=CLOSED, buoyancy_temperature=0.0, **fields)
    pushes = ws.Samples([1.0, 2.0], [True, False])
    source = replace(scene.emitters[0], velocity=(3.0, 5.0, -2.0), enabled=pushes)
    scene = replace(scene, emitters=[source], colliders=[BALL] if diffusion == "jacobi" else [], end=8)
    simulation = Simulation(scene)
    frames = [simulation.step(), simulation.step()]
    solver, random = simulation.solver(), np.random.default_rng(2)
    for component in solver.state.velocity:
        component.assign(random.standard_normal(component.shape).astype(np.float32))
    measures, energies = Measures(simulation.launcher, solver.state.density.shape), []
    while simulation.frame < scene.end:
        frames.append(simulation.step())
        energies.append(measures.motion(solver.state.velocity)[1])
    check_finite(frames)
    growth = float(np.max(np.diff(energies))) / energies[0]
    record_property("growth of kinetic energy in a frame", max(0.0, growth))
    assert energies[0] > 0.0
    assert growth <= 1e-6
