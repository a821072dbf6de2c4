"""What a report warns of: solvers that fell short."""

from warp_smoke.report import step_warnings


def _frame(converged=True, diffusion=0.0):
    status = {"converged": converged, "max_residual": 1e-4 if converged else 0.25}
    return {"frame": 2, "domains": {"/Smoke": {"pressure": [status], "diffusion": diffusion}}}


def test_solvers_that_fell_short_are_told():
    """Each domain has one line for all its pressures that missed, and one for the worst diffusion."""
    assert step_warnings([{"frame": 1, "domains": {}}, _frame(), _frame(diffusion=0.005)]) == []
    pressure, diffusion = step_warnings([_frame(), _frame(converged=False), _frame(diffusion=0.4), _frame()])
    assert pressure == "/Smoke: pressure missed its tolerance in 1 of 4 substeps, by a residual of up to 0.25"
    assert diffusion.startswith("/Smoke: diffusion may be off by up to 40% of the change it makes")
