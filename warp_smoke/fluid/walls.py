"""Walls from meshes: the cells that they fill and the faces that their surfaces cross, which block all flow."""

from math import prod

import numpy as np
import warp as wp

from warp_smoke.fluid.crossing import close_crossed, cross_faces, fill_inside
from warp_smoke.fluid.grid import Box, face_shape
from warp_smoke.fluid.lattice_mesh import LatticeMesh
from warp_smoke.fluid.voxelize import fill_fraction
from warp_smoke.fluid.wall_motion import Pull, mark_swept, pull_faces, push_faces
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher
from warp_smoke.scene import Collider

# The surface may be this far from a face of the cells that the mesh fills [cells].
_REACH = 1.5


class MeshWalls(LatticeMesh):
    """One collider in the cells of its own box: those it fills, and the faces that its surface crosses.

    Attributes:
        fraction: share of each cell of the box inside, [*shape], 0 to 1; for a closed mesh without margin, 1 if the
            cell's centre is inside, else 0; meaningless if the box has no cells.
        crossed: 1 for faces across x, y and z between whose cells' centres the surface passes, else 0,
            [ni+1, nj, nk], [ni, nj+1, nk], [ni, nj, nk+1].
        friction: friction of the surface, 0 to 1.
    """

    def __init__(self, launcher: Launcher, lattice: Lattice, collider: Collider):
        """Prepares the mesh; `update` fills the cells.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            collider: the mesh; its thickness is in voxels.
        """
        super().__init__(launcher, lattice, collider, "colliders", collider.thickness)
        self.friction = collider.friction
        self.fraction, self.crossed, self._speed = None, (), ()
        self._storage = ()  # room for all of these, as large as the largest box so far

    def update(self, start: float, end: float, seconds: float) -> bool:
        """Finds cells and faces for the mesh at `end`; arguments and result as for `LatticeMesh.update`."""
        changed = super().update(start, end, seconds)
        if changed and 0 not in self.shape:
            self._allocate()
            cross_faces(self._launcher, *self._place(), self.moves, self.crossed, self._speed)
            self._fill()
        return changed

    def _allocate(self) -> None:
        shapes = [self.shape, *(face_shape(self.shape, axis) for axis in range(3))]
        shapes += shapes[1:] if self.moves else []
        count = prod(n + 1 for n in self.shape)
        if not self._storage or count > self._storage[0].size:
            self._storage = tuple(self._launcher.zeros(count, self._label) for _ in shapes)
        views = [room[: prod(shape)].reshape(shape) for shape, room in zip(shapes, self._storage, strict=True)]
        self.fraction, self.crossed, self._speed = views[0], tuple(views[1:4]), tuple(views[-3:])

    def _place(self) -> tuple[wp.uint64, wp.vec3i]:
        return self._mesh.id, wp.vec3i(*self.lower)

    def _fill(self) -> None:
        if self._closed and self._margin == 0.0:
            fill_inside(self._launcher, *self._place(), self._far(), self.crossed, self.fraction)
        else:
            fill_fraction(self._launcher, *self._place(), self._margin, self._far(), self._closed, self.fraction)

    def close(self, shares: tuple[wp.array, wp.array, wp.array]) -> None:
        """Closes the faces that the surface crosses.

        Args:
            shares: wx, wy, wz, the open share of each face of the lattice, set to 0 on crossed faces.
        """
        close_crossed(self._launcher, wp.vec3i(*self.lower), self.crossed, shares)

    def push(self, velocity: tuple[wp.array, wp.array, wp.array]) -> None:
        """Gives the faces that the mesh closes its velocity.

        Args:
            velocity: u, v, w on the faces of the lattice [m/s], changed.
        """
        motion = self._motion(self._margin + _REACH)
        push_faces(self._launcher, self._place(), motion, self.crossed, self._speed, self.fraction, velocity)

    def pull(self, greatest: tuple[wp.array, wp.array, wp.array], pull: Pull) -> None:
        """Stores how the mesh drags air along.

        Args:
            greatest: greatest friction of all walls on the faces across x, y and z of the lattice.
            pull: friction times the velocity of the wall [m/s], changed on faces where no other wall has more friction.
        """
        motion = self._motion(self._margin + _REACH)
        args = (self._place(), motion, self.crossed, self.fraction, self.friction, greatest, pull)
        pull_faces(self._launcher, *args)

    def sweep(self, seconds: float, held: wp.array) -> Box | None:
        """Marks the cells that the surface passed over in the last update.

        Args:
            seconds: duration of that motion [s].
            held: [nx, ny, nz], set to 0 in these cells.

        Returns:
            A box around those cells; None if nothing moved.
        """
        if not self._point_velocity[self._used].any():
            return None
        scale = seconds / self._lattice.h
        now, displacement = self._points[self._used], scale * self._point_velocity[self._used]
        ends = np.concatenate([now, now - displacement])
        limit = self._lattice.shape
        lower, upper = (np.clip(end, 0, limit).astype(int) for end in (np.floor(ends.min(0)), np.ceil(ends.max(0))))
        box = Box(tuple(lower.tolist()), tuple(upper.tolist()))
        centre, mean, gradient = self._mean_motion()
        turn = np.linalg.pinv(np.eye(3) - scale * gradient)
        shift = centre + turn @ (scale * mean - centre)
        reach = float(np.linalg.norm(displacement, axis=1).max()) + 1.0 if self._prim.mesh.deforms else 0.0
        args = (wp.mat33(*turn.ravel()), wp.vec3(*shift), scale, reach, held)
        mark_swept(self._launcher, self._mesh.id, box, *args)
        return box
