"""Courant numbers of a hundred and ten thousand, frames of a minute."""

from dataclasses import replace

import numpy as np
import pytest
from hard_cases import BALL, check_finite, simulate, small_plume, smoke_of

from warp_smoke.scene import ADVECTION_SCHEMES, PRESSURE_SOLVERS

ROUND_OFF = 1e-5
SCHEMES = [
    *[(scheme, None, solid) for scheme in ADVECTION_SCHEMES for solid in (False, True)],
    *[(None, solver, solver != "spectral") for solver in PRESSURE_SOLVERS],
]


@pytest.mark.parametrize("courant", [100.0, 10_000.0])
@pytest.mark.parametrize(("advection", "pressure", "solid"), SCHEMES)
def test_large_steps(advection, pressure, solid, courant, record_property):
    """Frames of a minute in steps of Courant number 100 and 10 000: finite, within the range of air and sources."""
    fields = {"max_courant": courant, "vorticity": 0.5, "viscosity": 1e-3, "ambient_temperature": -1.0}
    scene = small_plume(advection=advection, pressure_solver=pressure, **fields)
    scene = replace(scene, time_codes_per_second=1 / 60, colliders=[BALL] if solid else [])
    _, frames = simulate(scene)
    check_finite(frames)
    reached = max(report.courant for frame in frames for report in frame.steps.values())
    density = max(float(smoke_of(frame).density.max()) for frame in frames)
    heat = [smoke_of(frame).temperature for frame in frames]
    record_property("largest Courant number", reached)
    record_property("density beyond its range", max(0.0, density - 1.0))
    record_property("temperature beyond its range", max(0.0, float(np.max(heat)) - 1.0, -1.0 - float(np.min(heat))))
    assert reached > 0.1 * min(courant, 1000.0)
    assert density <= 1.0 + ROUND_OFF
    assert -1.0 - ROUND_OFF <= np.min(heat) <= np.max(heat) <= 1.0 + ROUND_OFF


@pytest.mark.parametrize("advection", ADVECTION_SCHEMES)
def test_nothing_passes_through_solids_in_large_steps(advection, record_property):
    """In steps of Courant number 100 no smoke comes to stand in a solid, or behind a sheet across the domain."""
    sheet = replace(BALL, mesh=BALL.mesh.box((2.2, 0.05, 2.2)))
    scene = small_plume(advection=advection, max_courant=100.0, buoyancy_temperature=100.0)
    simulation, frames = simulate(replace(scene, time_codes_per_second=1.0, colliders=[sheet]))
    solid = simulation.solver().solids.fluid.numpy() == 0.0
    density = [smoke_of(frame).density for frame in frames]
    inside = max((float(each[solid].max(initial=0.0)) for each in density), default=0.0)
    above = max(float(each[:, 7:].max()) for each in density)
    record_property("largest density in solids", inside)
    record_property("largest density behind the sheet", above)
    assert inside == 0.0
    assert above == 0.0
