"""Pressure solvers: one per file, all with the signatures in `status.py`, chosen by name."""

from collections.abc import Callable

from warp_smoke.fluid.pressure.conjugate_gradient import ConjugateGradientPressure
from warp_smoke.fluid.pressure.preconditioner import Diagonal, EmptyBox
from warp_smoke.fluid.pressure.relaxation import JacobiPressure, RedBlackPressure
from warp_smoke.fluid.pressure.spectral import SpectralPressure
from warp_smoke.fluid.pressure.status import PressureProblem, PressureSolver, PressureStatus
from warp_smoke.fluid.pressure.v_cycle import VCycle
from warp_smoke.launch import Launcher


def _spectral(launcher: Launcher, problem: PressureProblem) -> SpectralPressure:
    if problem.solids is not None:
        others = ", ".join(name for name in PRESSURE_SOLVERS if name != "spectral")
        raise ValueError(f"pressure_solver is spectral in a domain with colliders; allowed: {others}")
    return SpectralPressure(launcher, problem.shape, problem.sides)


def _multigrid(launcher: Launcher, problem: PressureProblem) -> ConjugateGradientPressure:
    return ConjugateGradientPressure(launcher, problem, VCycle(launcher, problem.shape, problem.sides))


def _spectral_conjugate_gradient(launcher: Launcher, problem: PressureProblem) -> ConjugateGradientPressure:
    return ConjugateGradientPressure(launcher, problem, EmptyBox(launcher, problem.shape, problem.sides))


def _conjugate_gradient(launcher: Launcher, problem: PressureProblem) -> ConjugateGradientPressure:
    return ConjugateGradientPressure(launcher, problem, Diagonal(launcher, problem.shape))


PRESSURE_SOLVERS: dict[str, Callable[[Launcher, PressureProblem], PressureSolver]] = {
    "spectral": _spectral,
    "multigrid": _multigrid,
    "spectral_conjugate_gradient": _spectral_conjugate_gradient,
    "conjugate_gradient": _conjugate_gradient,
    "red_black": RedBlackPressure,
    "jacobi": JacobiPressure,
}

__all__ = ["PRESSURE_SOLVERS", "PressureProblem", "PressureSolver", "PressureStatus"]
