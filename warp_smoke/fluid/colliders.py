"""Solid obstacles on the lattice: which cells are fluid, which faces are open, and how fast solid faces move."""

from collections.abc import Iterable, Sequence
from itertools import permutations

import warp as wp

from warp_smoke.fluid.array_walls import ArrayWalls
from warp_smoke.fluid.crossing import SOLID_FRACTION
from warp_smoke.fluid.friction import pull_along, rub
from warp_smoke.fluid.grid import Block, Box, beside, face_shape, faces_of, hull, make_patch, seam_faces
from warp_smoke.fluid.halo import copy_samples, last_faces
from warp_smoke.fluid.images import images
from warp_smoke.fluid.operators import close_sides, corners, face_weight, side_weights
from warp_smoke.fluid.walls import MeshWalls
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store
from warp_smoke.scene import ArrayCollider, Collider

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _mark_solid(rows: Rows, lower: wp.vec3i, fraction: wp.array3d[float], fluid_inout: wp.array3d[float]):
    """Sets fluid = 0 where half of the cell is inside."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fraction.shape[2])
    while k < end:
        if fraction[i, j, k] >= SOLID_FRACTION:
            fluid_inout[lower[0] + i, lower[1] + j, lower[2] + k] = 0.0
        k += 1


@wp.kernel
def _open_faces(
    rows: Rows,
    fluid: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    wx_out: wp.array3d[float],
    wy_out: wp.array3d[float],
    wz_out: wp.array3d[float],
):
    """wx_i = fluid_(i−1) fluid_i between cells, fluid on an open side, 0 on a closed one. wy, wz alike."""
    i, j, c = wp.tid()
    i += rows.first
    nx = fluid.shape[0]
    ny = fluid.shape[1]
    nz = fluid.shape[2]
    f = dense(fluid)
    before_i = wp.max(i - 1, 0)
    before_j = wp.max(j - 1, 0)
    here_i = wp.min(i, nx - 1)
    here_j = wp.min(j, ny - 1)
    open_i = wp.min(face_weight(i, nx, lower[0], upper[0]), 1.0)
    open_j = wp.min(face_weight(j, ny, lower[1], upper[1]), 1.0)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, nz + 1)
    while k < end:
        if j < ny and k < nz:
            wx_out[i, j, k] = open_i * f[before_i, j, k] * f[here_i, j, k]
        if i < nx and k < nz:
            wy_out[i, j, k] = open_j * f[i, before_j, k] * f[i, here_j, k]
        if i < nx and j < ny:
            open_k = wp.min(face_weight(k, nz, lower[2], upper[2]), 1.0)
            wz_out[i, j, k] = open_k * f[i, j, wp.max(k - 1, 0)] * f[i, j, wp.min(k, nz - 1)]
        k += 1


@wp.kernel
def _open_seam(rows: Rows, block: Block, fluid: wp.array3d[float], share_out: wp.array3d[float]):
    """Sets the share to fluid_before fluid_after, the cells beside the face."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    before = beside(fluid, block.before)
    after = beside(fluid, block.after)
    out = dense_store(share_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        out[i, j, k] = bits(before[i, j, k] * after[i, j, k])
        k += 1


@wp.func
def _other_copy(a: wp.array3d[float], block: Block, i: int, j: int, k: int):
    """The value of the other copy of a face on a periodic side."""
    return a[i - block.before[0], j - block.before[1], k - block.before[2]]


@wp.kernel
def _close_seam(rows: Rows, block: Block, share_inout: wp.array3d[float]):
    """Sets the share to the lesser one of the face's two copies."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        share_inout[i, j, k] = wp.min(share_inout[i, j, k], _other_copy(share_inout, block, i, j, k))
        k += 1


@wp.kernel
def _push_seam(rows: Rows, block: Block, u_inout: wp.array3d[float]):
    """Sets the velocity to the faster one of the face's two copies, for only one may have a solid beside it."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        here = u_inout[i, j, k]
        other = _other_copy(u_inout, block, i, j, k)
        u_inout[i, j, k] = wp.where(wp.abs(other) > wp.abs(here), other, here)
        k += 1


@wp.kernel
def _stop_closed(rows: Rows, block: Block, share: wp.array3d[float], u_inout: wp.array3d[float]):
    """Sets u = 0 on faces that are not open."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    s = dense(share)
    u = dense(u_inout)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        u[i, j, k] = wp.where(s[i, j, k] > 0.0, u[i, j, k], 0.0)
        k += 1


@wp.kernel
def _push_closed(
    rows: Rows, block: Block, share: wp.array3d[float], solid: wp.array3d[float], u_inout: wp.array3d[float]
):
    """Sets u to that of the solid on faces that are not open."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    s = dense(share)
    pushed = dense(solid)
    u = dense(u_inout)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        u[i, j, k] = wp.where(s[i, j, k] > 0.0, u[i, j, k], pushed[i, j, k])
        k += 1


@wp.kernel
def _empty(rows: Rows, fluid: wp.array3d[float], ambient: float, a_inout: wp.array3d[float]):
    """Emptying: a = ambient in solid cells."""
    i, j, c = wp.tid()
    i += rows.first
    f = dense(fluid)
    a = dense(a_inout)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fluid.shape[2])
    while k < end:
        a[i, j, k] = wp.where(f[i, j, k] > 0.0, a[i, j, k], ambient)
        k += 1


def open_faces(
    launcher: Launcher,
    fluid: wp.array,
    sides: tuple[str, ...],
    shares: tuple[wp.array, wp.array, wp.array],
) -> None:
    """Opens the faces between cells of fluid, across periodic sides too, and on open sides.

    Args:
        launcher: where it runs.
        fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz].
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        shares: wx, wy, wz, the open share of each face, written.
    """
    launcher.launch(_open_faces, corners(fluid.shape), fluid, *side_weights(sides), *shares)
    for axis, share in enumerate(shares):
        for shape, block in seam_faces(fluid.shape, sides, axis):
            launcher.launch(_open_seam, shape, block, fluid, share)


def empty_solids(launcher: Launcher, solids: "Solids", field: wp.array, ambient: float) -> None:
    """Makes a field of the cells ambient in solids."""
    launcher.launch(_empty, field.shape, solids.fluid, ambient, field)


class Solids:
    """All colliders of a domain.

    A cell is fluid or solid: solid where a mesh, grown by its thickness, fills half of it. A face is closed where a
    cell beside it is solid, and where a surface passes between the two cells' centres: so walls thinner than a cell
    close too. Where solids meet, those that move win, and among them the later.

    Attributes:
        fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz].
        held: 1 in cells of fluid that were so before the last update, and that no surface passed over in it: what is
            in them is still on the same side of every wall; [nx, ny, nz].
        wx, wy, wz: open share of each face, 0 or 1: 0 at and in solids and on closed sides of the domain;
            [nx+1, ny, nz], [nx, ny+1, nz], [nx, ny, nz+1].
        friction: of the closed faces across x, y and z, 0 on open ones; None if no collider has any.
        pull: friction times the velocity of the wall along axis a on faces across axis b, by (a, b) [m/s]; None if no
            collider with friction ever moves.
        velocity: u, v, w of the solids on faces that are not open [m/s]; None if no collider ever moves.
        box: cells around all that are solid, were so before the last update, or have a face that a surface crosses;
            None if there are none.
        changes: how often the arrays were filled.
    """

    def __init__(self, launcher: Launcher, lattice: Lattice, colliders: Sequence[Collider | ArrayCollider]):
        """Allocates; `update` fills the arrays.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            colliders: the meshes, whose thickness is in voxels, and arrays.
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
        """Largest speed of any point of the colliders between two time codes, or a little more [m/s]."""
        farthest = max((each.travel(start, end) for each in self._walls), default=0.0)
        return farthest * self._lattice.h / seconds if farthest else 0.0

    def update(self, start: float, end: float, seconds: float) -> None:
        """Moves the solids to where they stand at `end`; does nothing if they stand there already.

        Args:
            start: time code that their velocity is measured from.
            end: time code; solids are at rest if it equals `start`.
            seconds: of smoke between them [s].
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
            launcher.launch(_mark_solid, each.shape, wp.vec3i(*each.lower), each.fraction, self.fluid)
        open_faces(launcher, self.fluid, sides, shares)
        for each in walls:
            each.close(shares)
        self._join(_close_seam, enumerate(shares))
        if self.friction:
            rub(launcher, walls, self.friction)
            self._join(_push_seam, enumerate(self.friction))
        if self.pull:
            pull_along(walls, self.friction, self.pull)
            self._join(_push_seam, ((axis, faces) for (_, axis), faces in self.pull.items()))
        if self.velocity is not None:
            for component in self.velocity:
                component.zero_()
            for each in walls:
                if each.moves:
                    each.push(self.velocity)
            self._join(_push_seam, enumerate(self.velocity))
            close_sides(launcher, sides, self.velocity)
        return hull(Box(each.lower, tuple(map(sum, zip(each.lower, each.shape, strict=True)))) for each in walls)

    def _join(self, kernel: wp.Kernel, fields: Iterable[tuple[int, wp.array]]) -> None:
        """Makes one of the two copies of each face on periodic sides, for only one may be in the box of a wall.

        Args:
            kernel: makes the last copy from both.
            fields: axes, and what the faces across them have.
        """
        shape, sides = self._lattice.shape, self._lattice.sides
        for axis, field in fields:
            if sides[2 * axis] == "periodic":
                last = last_faces(shape, axis)
                self._launcher.launch(kernel, *last, field)
                first = make_patch((0, 0, 0), last.shape, *(2 * (-last.block.before,)))
                copy_samples(self._launcher, [first], field, field)

    def apply(self, velocity: tuple[wp.array, wp.array, wp.array]) -> None:
        """Gives faces that are not open the velocity of the solid there (0 on closed sides of the domain).

        Args:
            velocity: u, v, w on faces [m/s], changed.
        """
        close_sides(self._launcher, self._lattice.sides, velocity)
        if self.box is None:
            return
        shares = (self.wx, self.wy, self.wz)
        for axis, (share, faces) in enumerate(zip(shares, velocity, strict=True)):
            patch = faces_of(self.box, axis)
            if self.velocity is None:
                self._launcher.launch(_stop_closed, *patch, share, faces)
            else:
                self._launcher.launch(_push_closed, *patch, share, self.velocity[axis], faces)
