"""Moving mesh walls: the faces that they push, their drag on air beside them, and the cells that they pass over."""

import warp as wp

from warp_smoke.fluid.crossing import TOLERANCE, along, is_solid, to_float
from warp_smoke.fluid.grid import Box
from warp_smoke.fluid.lattice_mesh import Motion, surface_velocity
from warp_smoke.launch import Launcher, Rows

# Friction times the wall's velocity along one axis, on closed faces across another, by (own, across) [m/s].
Pull = dict[tuple[int, int], wp.array]

wp.set_module_options({"enable_backward": False})


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

    Relative to the current mesh, the centre has moved from y = turn x + shift to x; near the surface of a deforming
    mesh from y = x + seconds · velocity of the closest point, `seconds` in [cells s/m].
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
                ray = wp.mesh_query_ray(mesh, x - TOLERANCE * direction, direction, length + 2.0 * TOLERANCE)
                if ray.result:
                    held_inout[i, j, k] = 0.0
        k += 1


@wp.kernel
def _push_faces(
    rows: Rows,
    mesh: wp.uint64,
    lower: wp.vec3i,
    axis: int,
    motion: Motion,
    crossed: wp.array3d[float],
    speed: wp.array3d[float],
    fraction: wp.array3d[float],
    u_inout: wp.array3d[float],
):
    """Sets u = speed on crossed faces, and u = the surface's velocity along the axis on other faces of solid cells."""
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
            u_inout[place[0], place[1], place[2]] = surface_velocity(mesh, motion, x)[axis]
        k += 1


@wp.kernel
def _pull_faces(
    rows: Rows,
    mesh: wp.uint64,
    lower: wp.vec3i,
    axis: int,
    own: int,
    motion: Motion,
    crossed: wp.array3d[float],
    fraction: wp.array3d[float],
    friction: float,
    greatest: wp.array3d[float],
    pull_inout: wp.array3d[float],
):
    """Sets pull = friction · surface velocity along `own` on faces that it closes, where no wall has more friction."""
    i, j, c = wp.tid()
    i += rows.first
    unit = along(axis, 1, 0, 0)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, crossed.shape[2])
    while k < end:
        face = wp.vec3i(i, j, k)
        place = lower + face
        closes = crossed[i, j, k] > 0.0 or is_solid(fraction, face) or is_solid(fraction, face - unit)
        if closes and friction >= greatest[place[0], place[1], place[2]]:
            x = to_float(place) + 0.5 * to_float(wp.vec3i(1, 1, 1) - unit)
            pull_inout[place[0], place[1], place[2]] = friction * surface_velocity(mesh, motion, x)[own]
        k += 1


def push_faces(
    launcher: Launcher,
    place: tuple[wp.uint64, wp.vec3i],
    motion: Motion,
    crossed: tuple,
    speed: tuple,
    fraction: wp.array,
    velocity: tuple,
) -> None:
    """Gives the faces that a mesh closes its velocity.

    Args:
        launcher: where it runs.
        place: the mesh, and the first cell of its box.
        motion: motion of the mesh.
        crossed: from `cross_faces`.
        speed: from `cross_faces`.
        fraction: share of each cell of the box inside.
        velocity: u, v, w on the faces of the lattice [m/s], changed.
    """
    for axis, component in enumerate(velocity):
        args = (*place, axis, motion, crossed[axis], speed[axis], fraction, component)
        launcher.launch_queries(_push_faces, crossed[axis].shape, *args)


def pull_faces(
    launcher: Launcher,
    place: tuple[wp.uint64, wp.vec3i],
    motion: Motion,
    crossed: tuple,
    fraction: wp.array,
    friction: float,
    greatest: tuple,
    pull: Pull,
) -> None:
    """Stores the drag of a mesh on the air moving along it, on faces that it closes.

    Args:
        launcher: where it runs.
        place: the mesh, and the first cell of its box.
        motion: motion of the mesh.
        crossed: from `cross_faces`.
        fraction: share of each cell of the box inside.
        friction: friction of the mesh.
        greatest: greatest friction of all walls on the faces across x, y and z.
        pull: friction times the velocity of the wall [m/s], changed where no wall has more friction.
    """
    for (own, axis), faces in pull.items():
        args = (*place, axis, own, motion, crossed[axis], fraction, friction, greatest[axis], faces)
        launcher.launch_queries(_pull_faces, crossed[axis].shape, *args)


def mark_swept(
    launcher: Launcher,
    mesh: wp.uint64,
    box: Box,
    turn: wp.mat33,
    shift: wp.vec3,
    seconds: float,
    reach: float,
    held: wp.array,
) -> None:
    """Marks cells that the surface of a mesh passed over; see `_mark_swept`.

    Args:
        launcher: where it runs.
        mesh: mesh in cell coordinates.
        box: cells to look at.
        turn: rotation that, with `shift`, takes a centre to its earlier position relative to the mesh as it is now.
        shift: [cells].
        seconds: duration of the motion over the cell size [cells s/m].
        reach: no point of a deforming mesh moved farther than this [cells]; 0 for a rigid mesh.
        held: [nx, ny, nz], set to 0 in these cells.
    """
    shape = tuple(high - low for low, high in zip(*box, strict=True))
    launcher.launch_queries(_mark_swept, shape, mesh, wp.vec3i(*box.lower), turn, shift, seconds, reach, held)
