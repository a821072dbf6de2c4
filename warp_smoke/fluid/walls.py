"""Surfaces of meshes between cells: which faces they cross, so that nothing flows through walls thinner than a cell.

A face is crossed where the segment between the centres on either side of it meets the surface. A path from cell to
cell through faces that are not crossed never meets the surface: so a closed surface keeps what is on its two sides
apart, however thin the body is (6-separating voxelisation: D. Cohen-Or, A. Kaufman, *Fundamentals of Surface
Voxelization*, 1995).
"""

from math import prod

import numpy as np
import warp as wp

from warp_smoke.fluid.grid import Box, face_shape
from warp_smoke.fluid.lattice_mesh import LatticeMesh
from warp_smoke.fluid.voxelize import ACCURACY, fill_fraction
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Collider

wp.set_module_options({"enable_backward": False})

# A surface this close to a centre counts as on either side of it [cells]: more than the round-off of places in cells.
_TOLERANCE = wp.constant(1e-3)


# Half a cell; a little less, so that a surface through the centres is solid whatever the round-off.
SOLID_FRACTION = wp.constant(0.499)


@wp.func
def along(axis: int, n: int, a: int, b: int):
    """Cell (i, j, k) that is number n along an axis, and a and b along the other two."""
    return wp.where(axis == 0, wp.vec3i(n, a, b), wp.where(axis == 1, wp.vec3i(a, n, b), wp.vec3i(a, b, n)))


@wp.func
def to_float(x: wp.vec3i):
    """The same vector as floats."""
    return wp.vec3(float(x[0]), float(x[1]), float(x[2]))


@wp.func
def is_solid(fraction: wp.array3d[float], x: wp.vec3i):
    """Whether a cell is half filled; not so outside of the box."""
    solid = wp.bool(False)
    if wp.min(x) >= 0 and x[0] < fraction.shape[0] and x[1] < fraction.shape[1] and x[2] < fraction.shape[2]:
        solid = fraction[x[0], x[1], x[2]] >= SOLID_FRACTION
    return solid


@wp.kernel
def _cross_faces(
    rows: Rows,
    mesh: wp.uint64,
    lower: wp.vec3i,
    axis: int,
    moves: int,
    crossed_out: wp.array3d[float],
    speed_out: wp.array3d[float],
):
    """Crossing: 1 where the segment between the centres beside a face meets the surface; speed = the surface's there.

    Runs go along the axis; a ray follows each.
    """
    a, b, c = wp.tid()
    a += rows.first
    n = wp.max(c * rows.run, 0)
    end = wp.min(n + rows.run, crossed_out.shape[axis])
    # Face n of the row lies between the centres n and n + 1, counted from here.
    direction = to_float(along(axis, 1, 0, 0))
    start = to_float(lower + along(axis, 0, a, b)) + wp.vec3(0.5, 0.5, 0.5) - direction
    while n < end:
        way = float(n) - _TOLERANCE
        query = wp.mesh_query_ray(mesh, start + way * direction, direction, float(end) + _TOLERANCE - way)
        first = end
        last = end
        velocity = wp.vec3(0.0, 0.0, 0.0)
        if query.result:
            # A surface through a centre lies between it and both of its neighbours.
            way += query.t
            first = wp.clamp(int(wp.floor(way - _TOLERANCE)), n, end)
            last = wp.clamp(int(wp.floor(way + _TOLERANCE)) + 1, n + 1, end)
            if moves != 0:
                velocity = wp.mesh_eval_velocity(mesh, query.face, query.u, query.v)
        while n < last:
            x = along(axis, n, a, b)
            crossed_out[x[0], x[1], x[2]] = wp.where(n < first, 0.0, 1.0)
            if moves != 0:
                speed_out[x[0], x[1], x[2]] = velocity[axis]
            n += 1


@wp.kernel
def _close_crossed(rows: Rows, lower: wp.vec3i, crossed: wp.array3d[float], w_inout: wp.array3d[float]):
    """Sets w = 0 on faces that a surface crosses."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, crossed.shape[2])
    while k < end:
        if crossed[i, j, k] > 0.0:
            w_inout[lower[0] + i, lower[1] + j, lower[2] + k] = 0.0
        k += 1


@wp.kernel
def _fill_inside(
    rows: Rows,
    mesh: wp.uint64,
    lower: wp.vec3i,
    far: float,
    below: int,
    crossed_x: wp.array3d[float],
    crossed_y: wp.array3d[float],
    crossed_z: wp.array3d[float],
    inside_out: wp.array3d[float],
):
    """Filling: inside = 1 where the centre of a cell is inside a closed mesh or on it.

    From cell to cell through a face that is not crossed, the sign stays. It is asked for at the start of a run, `far`
    away at most; but if the mesh does not reach below the box, rows start outside.
    """
    i, j, c = wp.tid()
    i += rows.first
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, inside_out.shape[2])
    inside = wp.float32(0.0)
    on_surface = wp.bool(False)
    k = start
    while k < end:
        reach = wp.where(k == start and (k > 0 or below != 0), far, 0.0)
        # Where the surface runs along the row through the centres, it crosses the faces on both sides.
        flanked_x = crossed_x[i, j, k] * crossed_x[i + 1, j, k]
        flanked_y = crossed_y[i, j, k] * crossed_y[i, j + 1, k]
        if crossed_z[i, j, k] + flanked_x + flanked_y > 0.0 or on_surface:
            reach = wp.float32(1.01)
        on_surface = wp.bool(False)
        if reach > 0.0:
            centre = to_float(lower + wp.vec3i(i, j, k)) + wp.vec3(0.5, 0.5, 0.5)
            query = wp.mesh_query_point_sign_winding_number(mesh, centre, reach, ACCURACY)
            inside = wp.where(query.result and query.sign < 0.0, 1.0, 0.0)
            if query.result:
                offset = centre - wp.mesh_eval_position(mesh, query.face, query.u, query.v)
                on_surface = wp.length(offset) < _TOLERANCE
        inside_out[i, j, k] = wp.where(on_surface, 1.0, inside)
        k += 1


@wp.kernel
def _mark_swept(
    rows: Rows,
    mesh: wp.uint64,
    lower: wp.vec3i,
    turn: wp.mat33,
    shift: wp.vec3,
    seconds: float,
    reach: float,
    held_inout: wp.array3d[float],
):
    """Sets held = 0 where the surface passed over the centre x of a cell: where it meets the segment from x to y.

    Seen from the mesh where it is now, the centre has moved from y = turn x + shift to x; near the surface of a mesh
    that deforms, from y = x + seconds · velocity of the closest point, `seconds` in [cells s/m].
    """
    i, j, c = wp.tid()
    i += rows.first + lower[0]
    j += lower[1]
    k = wp.max(lower[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, held_inout.shape[2])
    while k < end:
        if held_inout[i, j, k] > 0.0:
            x = wp.vec3(float(i) + 0.5, float(j) + 0.5, float(k) + 0.5)
            way = turn * x + shift - x
            if reach > 0.0:
                way = wp.vec3(0.0, 0.0, 0.0)
                query = wp.mesh_query_point_no_sign(mesh, x, reach)
                if query.result:
                    way = seconds * wp.mesh_eval_velocity(mesh, query.face, query.u, query.v)
            length = wp.length(way)
            if length > 0.0:
                direction = way / length
                ray = wp.mesh_query_ray(mesh, x - _TOLERANCE * direction, direction, length + 2.0 * _TOLERANCE)
                if ray.result:
                    held_inout[i, j, k] = 0.0
        k += 1


@wp.kernel
def _push_faces(
    rows: Rows,
    mesh: wp.uint64,
    lower: wp.vec3i,
    axis: int,
    reach: float,
    centre: wp.vec3,
    mean: wp.vec3,
    gradient: wp.mat33,
    crossed: wp.array3d[float],
    speed: wp.array3d[float],
    fraction: wp.array3d[float],
    u_inout: wp.array3d[float],
):
    """Sets u = speed on crossed faces, and the velocity along the axis beside other cells that are solid.

    That is the velocity of the closest point within `reach`, else mean + gradient (x − centre).
    """
    i, j, c = wp.tid()
    i += rows.first
    unit = along(axis, 1, 0, 0)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, crossed.shape[2])
    while k < end:
        face = wp.vec3i(i, j, k)
        place = lower + face
        if crossed[i, j, k] > 0.0:
            u_inout[place[0], place[1], place[2]] = speed[i, j, k]
        elif is_solid(fraction, face) or is_solid(fraction, face - unit):
            x = to_float(place) + 0.5 * to_float(wp.vec3i(1, 1, 1) - unit)
            velocity = mean + gradient * (x - centre)
            if reach > 0.0:
                query = wp.mesh_query_point_no_sign(mesh, x, reach)
                if query.result:
                    velocity = wp.mesh_eval_velocity(mesh, query.face, query.u, query.v)
            u_inout[place[0], place[1], place[2]] = velocity[axis]
        k += 1


class MeshWalls(LatticeMesh):
    """One collider in the cells of its own box: those it fills, and the faces that its surface crosses.

    Attributes:
        fraction: share of each cell of the box inside, [*shape], 0 to 1; of a closed mesh without margin only whether
            the centre is; says nothing where the box has no cells.
        crossed: 1 for each face of the box's cells across x, y and z between whose cells the surface passes, else 0,
            [ni+1, nj, nk], [ni, nj+1, nk], [ni, nj, nk+1].
        friction: of the surface, 0 to 1.
    """

    def __init__(self, launcher: Launcher, lattice: Lattice, collider: Collider):
        """Makes the mesh known; `update` fills the cells.

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
        """Finds cells and faces as the mesh stands at `end`; arguments and result as for `LatticeMesh.update`."""
        changed = super().update(start, end, seconds)
        if changed and 0 not in self.shape:
            self._allocate()
            self._cross()
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

    def _cross(self) -> None:
        for axis, (crossed, speed) in enumerate(zip(self.crossed, self._speed, strict=True)):
            a, b = (n for other, n in enumerate(self.shape) if other != axis)
            args = (*self._place(), axis, int(self.moves), crossed, speed)
            self._launcher.launch_queries(_cross_faces, (a, b, self.shape[axis] + 1), *args)

    def _fill(self) -> None:
        if not self._closed or self._margin > 0.0:
            fill_fraction(self._launcher, *self._place(), self._margin, self._far(), self._closed, self.fraction)
            return
        args = (*self._place(), self._far(), int(self.lower[2] == 0), *self.crossed, self.fraction)
        self._launcher.launch_queries(_fill_inside, self.shape, *args)

    def close(self, shares: tuple[wp.array, wp.array, wp.array]) -> None:
        """Closes the faces that the surface crosses.

        Args:
            shares: wx, wy, wz, the open share of each face of the lattice, set to 0 there.
        """
        for crossed, share in zip(self.crossed, shares, strict=True):
            self._launcher.launch(_close_crossed, crossed.shape, wp.vec3i(*self.lower), crossed, share)

    def push(self, velocity: tuple) -> None:
        """Gives the faces that the mesh closes its velocity.

        Args:
            velocity: u, v, w on the faces of the lattice [m/s], changed.
        """
        # The surface may be this far from a face beside the cells that it fills.
        reach = self._margin + 1.5 if self._prim.mesh.deforms else 0.0
        centre, mean, gradient = self._motion()
        motion = wp.vec3(*centre), wp.vec3(*mean), wp.mat33(*gradient.ravel())
        for axis, (crossed, speed, u) in enumerate(zip(self.crossed, self._speed, velocity, strict=True)):
            fields = crossed, speed, self.fraction, u
            self._launcher.launch_queries(_push_faces, crossed.shape, *self._place(), axis, reach, *motion, *fields)

    def sweep(self, seconds: float, held: wp.array) -> Box | None:
        """Marks the cells that the surface passed over in the last update.

        Args:
            seconds: that it took [s].
            held: [nx, ny, nz], set to 0 there.

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
        centre, mean, gradient = self._motion()
        turn = np.linalg.pinv(np.eye(3) - scale * gradient)
        shift = centre + turn @ (scale * mean - centre)
        reach = float(np.linalg.norm(displacement, axis=1).max()) + 1.0 if self._prim.mesh.deforms else 0.0
        place = self._mesh.id, wp.vec3i(*lower.tolist())
        args = (*place, wp.mat33(*turn.ravel()), wp.vec3(*shift), scale, reach, held)
        self._launcher.launch_queries(_mark_swept, tuple((upper - lower).tolist()), *args)
        return Box(tuple(lower.tolist()), tuple(upper.tolist()))
