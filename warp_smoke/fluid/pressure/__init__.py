"""Pressure projection: one solver a file, all with the signatures in `status.py`, chosen by name."""

from collections.abc import Callable

from warp_smoke.fluid.pressure.conjugate_gradient import ConjugateGradientPressure
from warp_smoke.fluid.pressure.spectral import SpectralPressure
from warp_smoke.fluid.pressure.status import PressureProblem, PressureSolver, PressureStatus
from warp_smoke.launch import Launcher


def _spectral(launcher: Launcher, problem: PressureProblem) -> SpectralPressure:
    if problem.solids is not None:
        raise ValueError("pressure_solver is spectral in a domain with colliders; allowed: conjugate_gradient")
    return SpectralPressure(launcher, problem.shape, problem.sides)


def _conjugate_gradient(launcher: Launcher, problem: PressureProblem) -> ConjugateGradientPressure:
    return ConjugateGradientPressure(
        launcher, problem.shape, problem.sides, problem.solids, problem.tolerance, problem.max_iterations
    )


PRESSURE_SOLVERS: dict[str, Callable[[Launcher, PressureProblem], PressureSolver]] = {
    "spectral": _spectral,
    "conjugate_gradient": _conjugate_gradient,
}

__all__ = ["PRESSURE_SOLVERS", "PressureProblem", "PressureSolver", "PressureStatus"]
