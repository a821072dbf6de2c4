"""Solid obstacles on the lattice: which cells are fluid, which faces are open, and how fast solid faces move."""

from collections.abc import Sequence
from itertools import permutations

import warp as wp

from warp_smoke.fluid.array_walls import ArrayWalls
from warp_smoke.fluid.friction import pull_along, rub
from warp_smoke.fluid.grid import Box, face_shape, faces_of, hull
from warp_smoke.fluid.images import images
from warp_smoke.fluid.operators import close_sides
from warp_smoke.fluid.solid_faces import close_seams, hold_closed, mark_solid, open_faces, push_seams
from warp_smoke.fluid.walls import MeshWalls
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher
from warp_smoke.scene import ArrayCollider, Collider


class Solids:
    """All colliders of a domain.

    A cell is solid where a mesh, expanded by its thickness, fills half of it, else fluid. A face is closed if one of
    its two cells is solid, or if a surface passes between their centres, so that walls thinner than a cell also
    close. Where solids meet, moving ones win, and among them the last one.

    Attributes:
        fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz].
        held: 1 in fluid cells that were fluid before the last update and that no surface passed over in it: their
            content is still on the same side of every wall; [nx, ny, nz].
        wx, wy, wz: open share of each face, 0 or 1: 0 at and in solids and on closed sides of the domain;
            [nx+1, ny, nz], [nx, ny+1, nz], [nx, ny, nz+1].
        friction: friction of closed faces across x, y and z, 0 on open ones; None if no collider has any.
        pull: friction times the velocity of the wall along axis a on faces across axis b, by (a, b) [m/s]; None if no
            collider with friction ever moves.
        velocity: u, v, w of the solids on faces that are not open [m/s]; None if no collider ever moves.
        box: box around all cells that are solid, were solid before the last update, or have a face that a surface
            crosses; None if there are none.
        changes: how often the arrays were filled.
    """

    def __init__(self, launcher: Launcher, lattice: Lattice, colliders: Sequence[Collider | ArrayCollider]):
        """Allocates; `update` fills the arrays.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            colliders: meshes, with their thickness in voxels, and arrays.
        """
        self._launcher, self._lattice = launcher, lattice
        walls = []
        for each in colliders:
            if isinstance(each, ArrayCollider):
                walls.append(ArrayWalls(launcher, lattice, each))
            else:
                walls += [MeshWalls(launcher, image, each) for image in images(lattice, each)]
        self._walls = sorted(walls, key=lambda each: each.moves)
        faces = [face_shape(lattice.shape, axis) for axis in range(3)]
        self.fluid = self.held = launcher.zeros(lattice.shape, "colliders")
        self.wx, self.wy, self.wz = (launcher.zeros(shape, "colliders") for shape in faces)
        self.velocity = None
        if any(each.moves for each in walls):
            self.held = launcher.zeros(lattice.shape, "colliders")
            self.velocity = tuple(launcher.zeros(shape, "colliders") for shape in faces)
        self.friction = self.pull = None
        if any(each.friction for each in walls):
            self.friction = tuple(launcher.zeros(shape, "colliders") for shape in faces)
        if any(each.friction and each.moves for each in walls):
            self.pull = {
                (own, axis): launcher.zeros(faces[axis], "colliders") for own, axis in permutations(range(3), 2)
            }
        self.changes = 0
        self.box = self._filled = None

    def max_speed(self, start: float, end: float, seconds: float) -> float:
        """Returns an upper bound of the speed of any point of the colliders between two time codes [m/s]."""
        farthest = max((each.travel(start, end) for each in self._walls), default=0.0)
        return farthest * self._lattice.h / seconds if farthest else 0.0

    def update(self, start: float, end: float, seconds: float) -> None:
        """Moves the solids to their positions at `end`; does nothing if they are there already.

        Args:
            start: time code from which their velocity is measured.
            end: time code; solids are at rest if it equals `start`.
            seconds: simulated time between them [s].
        """
        if self.velocity is not None:
            wp.copy(self.held, self.fluid)
        moved = [each.update(start, end, seconds) for each in self._walls]
        if self.changes and not any(moved):
            return
        before, self._filled, swept = self._filled, self._fill(), []
        if self.velocity is not None:
            if self.changes == 0:
                wp.copy(self.held, self.fluid)
            swept = [each.sweep(seconds, self.held) for each in self._walls]
        self.box = hull((before, self._filled, *swept))
        self.changes += 1

    def _fill(self) -> Box | None:
        """Fills the arrays from the walls; returns the box around them."""
        launcher, sides, shares = self._launcher, self._lattice.sides, (self.wx, self.wy, self.wz)
        walls = [each for each in self._walls if 0 not in each.shape]
        self.fluid.fill_(1.0)
        for each in walls:
            mark_solid(launcher, each.lower, each.fraction, self.fluid)
        open_faces(launcher, self.fluid, sides, shares)
        for each in walls:
            each.close(shares)
        close_seams(launcher, sides, shares)
        if self.friction:
            rub(launcher, walls, self.friction)
            push_seams(launcher, sides, enumerate(self.friction))
        if self.pull:
            pull_along(walls, self.friction, self.pull)
            push_seams(launcher, sides, ((axis, faces) for (_, axis), faces in self.pull.items()))
        if self.velocity is not None:
            for component in self.velocity:
                component.zero_()
            for each in walls:
                if each.moves:
                    each.push(self.velocity)
            push_seams(launcher, sides, enumerate(self.velocity))
            close_sides(launcher, sides, self.velocity)
        return hull(Box(each.lower, tuple(map(sum, zip(each.lower, each.shape, strict=True)))) for each in walls)

    def apply(self, velocity: tuple[wp.array, wp.array, wp.array]) -> None:
        """Gives faces that are not open the velocity of the solid there (0 on closed sides of the domain).

        Args:
            velocity: u, v, w on faces [m/s], changed.
        """
        close_sides(self._launcher, self._lattice.sides, velocity)
        if self.box is None:
            return
        shares, moving = (self.wx, self.wy, self.wz), self.velocity or (None, None, None)
        for axis, (share, solid, faces) in enumerate(zip(shares, moving, velocity, strict=True)):
            hold_closed(self._launcher, faces_of(self.box, axis), share, solid, faces)
