"""A pressure solver that runs out of iterations: the best that it has, a status, and a warning in the report."""

from functools import partial

import pytest
from hard_cases import BALL, check_finite, small_plume, smoke_of

import warp_smoke as ws
from warp_smoke.fluid import projection
from warp_smoke.scene import PRESSURE_SOLVERS


@pytest.mark.parametrize("solver", [name for name in PRESSURE_SOLVERS if name != "spectral"])
def test_two_iterations(solver, monkeypatch, tmp_path, record_property):
    """Allowed two iterations around a ball: finite, with less divergence than before, and the report says so."""
    monkeypatch.setattr(projection, "PressureProblem", partial(projection.PressureProblem, max_iterations=2))
    scene = ws.Scene(
        domains=small_plume(pressure_solver=solver, pressure_tolerance=1e-6).domains,
        emitters=small_plume().emitters,
        colliders=[BALL],
        end=3,
    )
    frames = []
    report = ws.run(scene, tmp_path, on_frame=frames.append).report
    check_finite(frames)
    assert smoke_of(frames[-1]).density.max() > 0.5
    steps = [step for frame in report["frames"] for step in frame["domains"].values()]
    statuses = [status for step in steps for status in step["pressure"]]
    residual = max(status["max_residual"] for status in statuses)
    record_property("largest residual", residual)
    missed = [status for status in statuses if not status["converged"]]
    assert missed
    assert 1e-6 < residual < 1.0  # of the largest divergence that there was
    (said,) = [warning for warning in report["warnings"] if "pressure" in warning]
    share = f"pressure missed its tolerance in {len(missed)} of {len(statuses)} substeps, with a residual of up to "
    assert said == f"/World/Smoke: {share}{max(status['max_residual'] for status in missed):.2g}"
