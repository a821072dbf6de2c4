"""What the diffusion solvers solve, and what they share."""

from dataclasses import dataclass
from typing import Protocol

import warp as wp

from warp_smoke.fluid.colliders import Solids

# More is no different, and overflows in float32.
_MOST = 1e30


def diffusion_number(coefficient: float, dt: float, h: float) -> float:
    """The number r = κ dt / h².

    Args:
        coefficient: κ [m²/s].
        dt: [s].
        h: side of a cell [m].
    """
    return min(coefficient * dt / (h * h), _MOST)


@dataclass(frozen=True)
class DiffusionProblem:
    """What diffuses where.

    Attributes:
        shape: cells along each axis (nx, ny, nz).
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        no_slip: which of them hold the velocity along them back.
        fields: what diffuses: 0, 1 or 2 for a velocity component, None for those of the cells.
        sweeps: the most that an iterative solver does.
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
        """Diffuses a field; r = 0 leaves every bit as it is.

        Args:
            axis: which of the problem's fields it is.
            field: at cell centres or on faces, changed.
            r: from `diffusion_number`.

        Returns:
            Bound on the error, as a share of the largest change; 0 from an exact solver.
        """
