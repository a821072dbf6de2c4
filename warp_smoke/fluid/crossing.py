"""The faces that the surface of a mesh crosses, and the cells inside it.

A face is crossed if the segment between the cell centres on either side of it meets the surface. A path from cell to
cell through uncrossed faces never meets the surface, so a closed surface separates its two sides however thin the body
is (6-separating voxelisation: D. Cohen-Or, A. Kaufman, *Fundamentals of Surface Voxelization*, 1995).
"""

import warp as wp

from warp_smoke.fluid.voxelize import ACCURACY
from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})

# A surface this close to a centre counts as being on both sides of it [cells]: more than the round-off of coordinates.
TOLERANCE = wp.constant(1e-3)
# Half a cell; a little less, so that a surface through the centres is solid whatever the round-off.
SOLID_FRACTION = wp.constant(0.499)


@wp.func
def along(axis: int, n: int, a: int, b: int):
    """Returns the cell (i, j, k) with index n along an axis, and a and b along the other two."""
    return wp.where(axis == 0, wp.vec3i(n, a, b), wp.where(axis == 1, wp.vec3i(a, n, b), wp.vec3i(a, b, n)))


@wp.func
def to_float(x: wp.vec3i):
    """Returns the same vector as floats."""
    return wp.vec3(float(x[0]), float(x[1]), float(x[2]))


@wp.func
def is_solid(fraction: wp.array3d[float], x: wp.vec3i):
    """Returns whether a cell is at least half filled; false outside the box."""
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
    """Crossing: 1 where the segment between the two centres at a face meets the surface; speed = the surface's there.

    Runs go along the axis; a ray is traced along each.
    """
    a, b, c = wp.tid()
    a += rows.first
    n = wp.max(c * rows.run, 0)
    end = wp.min(n + rows.run, crossed_out.shape[axis])
    # Face n of the row lies between the centres n and n + 1, counted from here.
    direction = to_float(along(axis, 1, 0, 0))
    start = to_float(lower + along(axis, 0, a, b)) + wp.vec3(0.5, 0.5, 0.5) - direction
    while n < end:
        way = float(n) - TOLERANCE
        query = wp.mesh_query_ray(mesh, start + way * direction, direction, float(end) + TOLERANCE - way)
        first = end
        last = end
        velocity = wp.vec3(0.0, 0.0, 0.0)
        if query.result:
            # A surface through a centre counts as between it and both of its neighbours.
            way += query.t
            first = wp.clamp(int(wp.floor(way - TOLERANCE)), n, end)
            last = wp.clamp(int(wp.floor(way + TOLERANCE)) + 1, n + 1, end)
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

    The sign stays the same from cell to cell through an uncrossed face. It is queried at the start of a run, within the
    distance `far`, unless the mesh cannot reach below the box: then rows start outside.
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
                on_surface = wp.length(offset) < TOLERANCE
        inside_out[i, j, k] = wp.where(on_surface, 1.0, inside)
        k += 1


def cross_faces(
    launcher: Launcher, mesh: wp.uint64, lower: wp.vec3i, moves: bool, crossed: tuple, speed: tuple
) -> None:
    """Finds the faces of a box of cells that a mesh crosses.

    Args:
        launcher: where it runs.
        mesh: mesh in cell coordinates.
        lower: first cell of the box.
        moves: whether to find the surface's velocity.
        crossed: 1 on crossed faces across x, y and z, else 0, [ni+1, nj, nk], [ni, nj+1, nk], [ni, nj, nk+1], written.
        speed: velocity of the surface through each crossed face [m/s], same shapes, written if `moves`.
    """
    for axis in range(3):
        a, b = (n for other, n in enumerate(crossed[axis].shape) if other != axis)
        args = (mesh, lower, axis, int(moves), crossed[axis], speed[axis])
        launcher.launch_queries(_cross_faces, (a, b, crossed[axis].shape[axis]), *args)


def close_crossed(launcher: Launcher, lower: wp.vec3i, crossed: tuple, shares: tuple) -> None:
    """Closes the faces of the lattice that a mesh crosses.

    Args:
        launcher: where it runs.
        lower: first cell of the mesh's box.
        crossed: from `cross_faces`.
        shares: wx, wy, wz, the open share of each face of the lattice, set to 0 on crossed faces.
    """
    for each, share in zip(crossed, shares, strict=True):
        launcher.launch(_close_crossed, each.shape, lower, each, share)


def fill_inside(
    launcher: Launcher, mesh: wp.uint64, lower: wp.vec3i, far: float, crossed: tuple, inside: wp.array
) -> None:
    """Finds the cells of a box whose centres are inside a closed mesh or on it.

    Args:
        launcher: where it runs.
        mesh: mesh in cell coordinates, built with winding numbers.
        lower: first cell of the box.
        far: no cell of the box is farther from the mesh than this [cells].
        crossed: from `cross_faces`.
        inside: 1 inside, else 0, over the box, written.
    """
    args = (far, int(lower[2] == 0), *crossed, inside)
    launcher.launch_queries(_fill_inside, inside.shape, mesh, lower, *args)
