"""Implicit diffusion, stable for any coefficient: (I − r ∇²) a₁ = a₀, r = κ dt / h² (J. Stam, *Stable Fluids*, 1999).

∇² is the seven-point Laplacian in units of cells. A cell-centred field has no flux through closed sides and is ambient
on open ones. A velocity component is 0 on closed sides across its own axis; on closed sides along its other axes it
slips freely, or is 0 if they are no-slip. On open sides velocity has zero slope. Colliders slow the air moving along
them by their friction, as a share of the effect of a no-slip wall. Across periodic sides fields continue at the other
end.
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
