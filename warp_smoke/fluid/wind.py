"""Wind: the velocity of air at the beginning, and of air that enters through open sides.

Beyond open sides all air moves with the wind, so traces that begin there carry it in; faces on these sides take its
velocity wherever the flow through them is inward. The projection then diverts it around obstacles.
"""

import warp as wp

from warp_smoke.fluid.grid import side_faces
from warp_smoke.fluid.operators import close_sides
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _let_in(rows: Rows, first: wp.vec3i, inwards: float, wind: float, u_inout: wp.array3d[float]):
    """Inflow: u = wind where inwards · u > 0; inwards is 1 on lower and −1 on upper sides."""
    i, j, c = wp.tid()
    i += rows.first + first[0]
    j += first[1]
    u = dense(u_inout)
    k = wp.max(first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, u_inout.shape[2])
    while k < end:
        u[i, j, k] = wp.where(inwards * u[i, j, k] > 0.0, wind, u[i, j, k])
        k += 1


class Wind:
    """The wind in one domain.

    Attributes:
        velocity: velocity of the wind along the lattice's axes [m/s].
    """

    def __init__(self, launcher: Launcher, lattice: Lattice, velocity: tuple[float, float, float]):
        """Prepares.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            velocity: velocity of the wind along the stage's axes [m/s].
        """
        self._launcher, self._lattice = launcher, lattice
        self.velocity = tuple((lattice.axes @ velocity).tolist())
        self._sides = []
        for axis in range(3):
            for patch in side_faces(lattice.shape, lattice.sides, axis):
                inwards = -1.0 if patch.block.first[axis] else 1.0
                self._sides.append((axis, patch, inwards))

    def fill(self, velocity: tuple) -> None:
        """Gives all air the wind's velocity, except through closed sides.

        Args:
            velocity: u, v, w on faces [m/s], written.
        """
        for component, speed in zip(velocity, self.velocity, strict=True):
            component.fill_(speed)
        close_sides(self._launcher, self._lattice.sides, velocity)

    def let_in(self, velocity: tuple) -> None:
        """Gives air that enters through open sides the wind's velocity.

        Args:
            velocity: u, v, w on faces [m/s], changed on those sides.
        """
        for axis, patch, inwards in self._sides:
            first = patch.block.first
            self._launcher.launch(_let_in, patch.shape, first, inwards, self.velocity[axis], velocity[axis])

    def energy_let_in(self, courant: float) -> float:
        """Returns the most kinetic energy that can have entered, ½ u² over the faces [m²/s²].

        Args:
            courant: largest distance that air moved [cells].
        """
        faces = sum(patch.shape[0] * patch.shape[1] * patch.shape[2] for _, patch, _ in self._sides)
        return 0.5 * sum(speed * speed for speed in self.velocity) * faces * courant
