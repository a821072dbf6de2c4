"""What a report warns of: solvers that fell short."""

import pytest

from warp_smoke.report import step_warnings, summary


def _frame(converged=True, diffusion=0.0):
    status = {"converged": converged, "max_residual": 1e-4 if converged else 0.25}
    return {"frame": 2, "domains": {"/Smoke": {"pressure": [status], "diffusion": diffusion}}}


def test_solvers_that_fell_short_are_told():
    """Each domain has one line for all its pressures that missed, and one for the worst diffusion."""
    assert step_warnings([{"frame": 1, "domains": {}}, _frame(), _frame(diffusion=0.005)]) == []
    pressure, diffusion = step_warnings([_frame(), _frame(converged=False), _frame(diffusion=0.4), _frame()])
    assert pressure == "/Smoke: pressure missed its tolerance in 1 of 4 substeps, with a residual of up to 0.25"
    assert diffusion.startswith("/Smoke: diffusion may be off by up to 40% of the change it makes")


@pytest.mark.parametrize(
    ("substeps", "words"),
    [((1, 1), "1 substep a frame"), ((3, 3), "3 substeps a frame"), ((1, 4), "1 to 4 substeps a frame")],
)
def test_summary_says_how_many_substeps(substeps, words):
    """One number where all frames have as many substeps, else the least and the most."""
    frames = [{"domains": {"/Smoke": {"substeps": count}}} for count in substeps]
    line, _ = summary({"frames": frames, "seconds": {"set_up": 1.0, "frames": 2.0, "passes": {}}}).renderables
    assert line == f"2 frames: 1.0 s to set up, 2.0 s to make, {words}"
