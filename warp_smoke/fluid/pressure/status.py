"""The input of a pressure solver, and its report."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import warp as wp

if TYPE_CHECKING:
    from warp_smoke.fluid.colliders import Solids


@dataclass(frozen=True, kw_only=True)
class PressureProblem:
    """The problem that a pressure solver is made for.

    Attributes:
        shape: cells along each axis (nx, ny, nz).
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        solids: the domain's solids, or None.
        tolerance: for iterative solvers: largest |r| and rms r, relative to those of zero pressure.
        max_iterations: for iterative solvers.
    """

    shape: tuple[int, int, int]
    sides: tuple[str, ...]
    solids: "Solids | None" = None
    tolerance: float = 1e-4
    max_iterations: int = 200


@dataclass(frozen=True, kw_only=True)
class PressureStatus:
    """How well a pressure was solved for.

    Attributes:
        iterations: number of iterations; 1 for a direct solver.
        max_residual, rms_residual: of r = d − L q over the fluid, relative to those of zero pressure.
        converged: whether both are within the tolerance, or as small as a pressure in float32 allows.
        imbalance: largest net divergence per cell that a closed box or pocket held, and that no pressure can remove;
            it is left out of the residual [m/s].
    """

    iterations: int
    max_residual: float
    rms_residual: float
    converged: bool
    imbalance: float = 0.0


class PressureSolver(Protocol):
    """The interface of all pressure solvers."""

    def solve(self, divergence: wp.array, pressure: wp.array) -> PressureStatus:
        """Solves Σ (q_neighbour − q) = d.

        Args:
            divergence: d, [nx, ny, nz] [m/s], 0 in solid cells.
            pressure: q = dt p / h, [nx, ny, nz] [m/s]: the first guess, replaced by the solution.
        """
