"""The problem that diffusion solvers solve, and their interface."""

from dataclasses import dataclass
from typing import Protocol

import warp as wp

from warp_smoke.fluid.colliders import Solids

# A larger number makes no difference, and would overflow in float32.
_MOST = 1e30


def diffusion_number(coefficient: float, dt: float, h: float) -> float:
    """Returns the diffusion number r = κ dt / h², at most 1e30.

    Args:
        coefficient: κ [m²/s].
        dt: [s].
        h: side of a cell [m].
    """
    return min(coefficient * dt / (h * h), _MOST)


@dataclass(frozen=True)
class DiffusionProblem:
    """A diffusion problem.

    Attributes:
        shape: cells along each axis (nx, ny, nz).
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        no_slip: whether each side is a no-slip wall.
        fields: the fields that diffuse: 0, 1 or 2 for a velocity component, None for cell-centred fields.
        sweeps: most sweeps of an iterative solver.
        solids: the colliders on the lattice, or None.
    """

    shape: tuple[int, int, int]
    sides: tuple[str, ...]
    no_slip: tuple[bool, ...]
    fields: tuple[int | None, ...]
    sweeps: int
    solids: Solids | None = None


class DiffusionSolver(Protocol):
    """Diffuses the fields of one domain."""

    def diffuse(self, axis: int | None, field: wp.array, r: float) -> float:
        """Diffuses a field; r = 0 leaves it bit-identical.

        Args:
            axis: which of the problem's fields it is.
            field: at cell centres or on faces, changed.
            r: from `diffusion_number`.

        Returns:
            Bound on the error, as a share of the largest change; 0 from an exact solver.
        """
