"""Friction of colliders on the faces that they close, and their drag on the air moving along these faces."""

from collections.abc import Sequence

import warp as wp

from warp_smoke.fluid.array_walls import ArrayWalls
from warp_smoke.fluid.crossing import is_solid
from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.wall_motion import Pull
from warp_smoke.fluid.walls import MeshWalls
from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _rub_beside(
    rows: Rows,
    lower: wp.vec3i,
    unit: wp.vec3i,
    faces: wp.vec3i,
    fraction: wp.array3d[float],
    friction: float,
    friction_inout: wp.array3d[float],
):
    """Friction of a face of a cell that is half inside a wall: at least the wall's."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, faces[2])
    while k < end:
        face = wp.vec3i(i, j, k)
        if is_solid(fraction, face) or is_solid(fraction, face - unit):
            x = lower + face
            friction_inout[x[0], x[1], x[2]] = wp.max(friction_inout[x[0], x[1], x[2]], friction)
        k += 1


@wp.kernel
def _rub_crossed(
    rows: Rows, lower: wp.vec3i, crossed: wp.array3d[float], friction: float, friction_inout: wp.array3d[float]
):
    """Friction of a face that a surface crosses: at least the surface's."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, crossed.shape[2])
    while k < end:
        x = lower[0] + i
        y = lower[1] + j
        z = lower[2] + k
        friction_inout[x, y, z] = wp.max(friction_inout[x, y, z], friction * crossed[i, j, k])
        k += 1


def rub(
    launcher: Launcher,
    walls: Sequence[MeshWalls | ArrayWalls],
    frictions: tuple[wp.array, wp.array, wp.array],
) -> None:
    """Fills the friction of closed faces: the greatest of the walls that close them.

    Args:
        launcher: where it runs.
        walls: walls in the lattice.
        frictions: friction of the faces across x, y and z, written; 0 on open ones.
    """
    for axis, friction in enumerate(frictions):
        friction.zero_()
        unit = wp.vec3i(*(int(a == axis) for a in range(3)))
        for each in (wall for wall in walls if wall.friction):
            lower, faces = wp.vec3i(*each.lower), face_shape(each.shape, axis)
            args = (lower, unit, wp.vec3i(*faces), each.fraction, each.friction, friction)
            launcher.launch(_rub_beside, faces, *args)
            for crossed in each.crossed[axis : axis + 1]:
                launcher.launch(_rub_crossed, faces, lower, crossed, each.friction, friction)


def pull_along(
    walls: Sequence[MeshWalls | ArrayWalls], frictions: tuple[wp.array, wp.array, wp.array], pull: Pull
) -> None:
    """Fills the pull of walls: their friction times their velocity along each face that they close.

    Args:
        walls: walls in the lattice; if several close a face, the one with most friction counts, the last one in a tie.
        frictions: from `rub`.
        pull: written; 0 on walls at rest and on open faces.
    """
    for field in pull.values():
        field.zero_()
    for each in walls:
        if each.moves and each.friction:
            each.pull(frictions, pull)
