"""Closed boxes, pockets, and walls that press on them, with every pressure solver."""

from dataclasses import replace

import numpy as np
import pytest
from hard_cases import BALL, CLOSED, check_finite, simulate, small_plume
from scenes import at
from shapes import shell

import warp_smoke as ws
from warp_smoke.scene import PRESSURE_SOLVERS

# Relaxation needs more iterations than it may have; it says so.
SLOW = ("jacobi", "red_black")


@pytest.mark.parametrize("solver", PRESSURE_SOLVERS)
@pytest.mark.parametrize("boundary", [CLOSED, ("closed",) * 5 + ("open",)], ids=["closed", "one side open"])
def test_closed_box(solver, boundary, record_property):
    """A plume in a closed box, or one with a single open side: solved within the tolerance, or said not to be."""
    scene = small_plume(pressure_solver=solver, boundary=boundary, pressure_tolerance=1e-4)
    _, frames = simulate(scene)
    check_finite(frames)
    statuses = [status for frame in frames for step in frame.steps.values() for status in step.pressure]
    residual = max(status.max_residual for status in statuses)
    record_property("largest residual", residual)
    missed = [status for status in statuses if not status.converged]
    assert all(max(status.max_residual, status.rms_residual) > 1e-4 for status in missed)
    assert not missed or solver in SLOW


@pytest.mark.parametrize("solver", [name for name in PRESSURE_SOLVERS if name != "spectral"])
def test_pockets(solver, record_property):
    """Hot smoke inside a hollow ball in a closed box, two bodies of air: solved, and none gets out."""
    scene = small_plume(pressure_solver=solver, boundary=CLOSED, resolution=16)
    pocket = ws.Collider(path="/World/Pocket", mesh=shell(0.7, 0.2), transform=at(0, 1, 0))
    source = replace(scene.emitters[0], transform=at(0, 1, 0))
    _, frames = simulate(replace(scene, colliders=[pocket], emitters=[source]))
    check_finite(frames)
    x = (np.indices((16, 16, 16)) + 0.5) / 8 - 1
    outside = np.linalg.norm(x, axis=0) > 0.75
    leaked = max(float(frame.smoke["/World/Smoke"].density[outside].max()) for frame in frames)
    residual = max(s.max_residual for frame in frames for step in frame.steps.values() for s in step.pressure)
    record_property("density outside the pocket", leaked)
    record_property("largest residual", residual)
    assert leaked == 0.0


@pytest.mark.parametrize("solver", [name for name in PRESSURE_SOLVERS if name != "spectral"])
def test_piston(solver, record_property):
    """A ball that swells in a closed box presses on air that cannot leave: finite, and the net flux is reported."""
    grow = ws.Samples(
        [1.0, 3.0], np.array([np.diag([0.5, 0.5, 0.5, 1.0]), np.diag([2.0, 2.0, 2.0, 1.0])]) @ at(0, 1.2, 0)
    )
    scene = small_plume(pressure_solver=solver, boundary=CLOSED)
    _, frames = simulate(replace(scene, colliders=[replace(BALL, transform=grow)]))
    check_finite(frames)
    imbalance = [s.imbalance for frame in frames for step in frame.steps.values() for s in step.pressure]
    speed = max(float(np.abs(frame.smoke["/World/Smoke"].velocity).max()) for frame in frames)
    record_property("largest speed, of the ball's surface", speed / (0.3 * 1.5 * 12))
    assert max(imbalance) > 0.0
