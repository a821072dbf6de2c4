"""Accelerations of the velocity on faces, and buoyancy.

R. Fedkiw, J. Stam, H. W. Jensen, *Visual Simulation of Smoke*, 2001, eq. 8: f = (−α ρ + β (T − T_ambient)) up.
"""

import warp as wp

from warp_smoke.fluid.grid import Block, Patch, beside, inner_faces, seam_faces, side_faces
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _accelerate(
    rows: Rows, block: Block, a: wp.array3d[float], ambient: float, gain: float, u_inout: wp.array3d[float]
):
    """Addition: u += gain (½ (a₋ + a₊) − ambient), a₋ and a₊ in the face's two cells."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    before = beside(a, block.before)
    after = beside(a, block.after)
    u = dense(u_inout)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        mean = 0.5 * (before[i, j, k] + after[i, j, k])
        u[i, j, k] = u[i, j, k] + gain * (mean - ambient)
        k += 1


def accelerate(
    launcher: Launcher, patches: list[Patch], scalar: wp.array, ambient: float, gain: float, component: wp.array
) -> None:
    """Adds an acceleration given at cell centres to one velocity component.

    Args:
        launcher: where it runs.
        patches: faces that it acts on.
        scalar: [nx, ny, nz].
        ambient: value of the scalar at which there is no acceleration.
        gain: velocity per unit of the scalar [m/s].
        component: velocity on the faces across one axis [m/s], changed.
    """
    for shape, block in patches:
        launcher.launch(_accelerate, shape, block, scalar, ambient, gain, component)


class Buoyancy:
    """Lift of hot smoke and weight of dense smoke; components of `up` that are zero cost nothing.

    Faces on open sides take the value of their one cell, so that air of uniform temperature stays at rest below p = 0.
    """

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], sides: tuple[str, ...], up: tuple):
        """Prepares for a lattice: shape in cells, its sides, and the unit vector pointing up along its axes."""
        self._launcher = launcher
        self._axes = [
            (axis, x, [inner_faces(shape, axis), *side_faces(shape, sides, axis), *seam_faces(shape, sides, axis)])
            for axis, x in enumerate(up)
            if x
        ]

    def add(self, scalar: wp.array, ambient: float, strength: float, velocity: tuple) -> None:
        """Adds strength (a − ambient) up to the velocity.

        Args:
            scalar: a, density or temperature, [nx, ny, nz].
            ambient: its value in still air.
            strength: −α dt or β dt [m/s].
            velocity: u, v, w on faces [m/s], changed.
        """
        for axis, along, patches in self._axes:
            accelerate(self._launcher, patches, scalar, ambient, strength * along, velocity[axis])
