"""Implicit diffusion, stable for any coefficient: (I − r ∇²) a₁ = a₀, r = κ dt / h² (J. Stam, *Stable Fluids*, 1999).

∇² is the seven-point Laplacian in cells. A field of the cells has no flux through closed sides and is ambient on open
ones. A velocity component is 0 on closed sides across its own axis; along its other axes it slips, without friction, or
is 0 on sides that ask for no slip. On open sides velocity has no slope. Colliders hold back the air that moves along
them by their friction, as a share of what a wall without slip does. Across periodic sides all goes on at the other end.
"""

from collections.abc import Callable

from warp_smoke.fluid.diffusion.jacobi import JacobiDiffusion
from warp_smoke.fluid.diffusion.problem import DiffusionProblem, DiffusionSolver, diffusion_number
from warp_smoke.fluid.diffusion.scalar import diffuse_scalar
from warp_smoke.fluid.diffusion.spectral import SpectralDiffusion
from warp_smoke.launch import Launcher

DIFFUSION_SOLVERS: dict[str, Callable[[Launcher, DiffusionProblem], DiffusionSolver]] = {
    "spectral": SpectralDiffusion,
    "jacobi": JacobiDiffusion,
}

__all__ = ["DIFFUSION_SOLVERS", "DiffusionProblem", "DiffusionSolver", "diffuse_scalar", "diffusion_number"]
