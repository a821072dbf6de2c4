"""Friction of colliders, on the faces that they close."""

from collections.abc import Sequence

import warp as wp

from warp_smoke.fluid.array_walls import ArrayWalls
from warp_smoke.fluid.walls import SOLID_FRACTION, MeshWalls
from warp_smoke.launch import Launcher, Rows

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _mark_friction(
    rows: Rows, lower: wp.vec3i, fraction: wp.array3d[float], friction: float, friction_inout: wp.array3d[float]
):
    """Sets the friction of cells of which half is inside."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fraction.shape[2])
    while k < end:
        if fraction[i, j, k] >= SOLID_FRACTION:
            friction_inout[lower[0] + i, lower[1] + j, lower[2] + k] = friction
        k += 1


@wp.kernel
def _rub_cells(
    rows: Rows, unit: wp.vec3i, cells: wp.array3d[float], share: wp.array3d[float], friction_out: wp.array3d[float]
):
    """Friction of a closed face: the greater one of the cells beside it; 0 of an open face."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, share.shape[2])
    while k < end:
        before = cells[wp.max(i - unit[0], 0), wp.max(j - unit[1], 0), wp.max(k - unit[2], 0)]
        after = cells[wp.min(i, cells.shape[0] - 1), wp.min(j, cells.shape[1] - 1), wp.min(k, cells.shape[2] - 1)]
        friction_out[i, j, k] = wp.where(share[i, j, k] > 0.0, 0.0, wp.max(before, after))
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
    shares: tuple[wp.array, wp.array, wp.array],
    cells: wp.array,
    frictions: tuple[wp.array, wp.array, wp.array],
) -> None:
    """Fills the friction of closed faces: the greatest of the walls that close them.

    Args:
        launcher: where it runs.
        walls: that are in the lattice.
        shares: wx, wy, wz, the open share of each face.
        cells: scratch, [nx, ny, nz].
        frictions: of the faces across x, y and z, written; 0 on open ones.
    """
    cells.zero_()
    for each in walls:
        args = (wp.vec3i(*each.lower), each.fraction, each.friction, cells)
        launcher.launch(_mark_friction, each.shape, *args)
    for axis, (share, friction) in enumerate(zip(shares, frictions, strict=True)):
        unit = wp.vec3i(*(int(a == axis) for a in range(3)))
        launcher.launch(_rub_cells, share.shape, unit, cells, share, friction)
        for each in walls:
            if each.friction:
                crossed = each.crossed[axis]
                launcher.launch(_rub_crossed, crossed.shape, wp.vec3i(*each.lower), crossed, each.friction, friction)
