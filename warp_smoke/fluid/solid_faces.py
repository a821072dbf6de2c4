"""Which cells are fluid, which faces are open, and how fast closed faces move."""

from collections.abc import Iterable

import warp as wp

from warp_smoke.fluid.crossing import SOLID_FRACTION
from warp_smoke.fluid.grid import Block, Patch, beside, make_patch, seam_faces
from warp_smoke.fluid.halo import copy_samples, last_faces
from warp_smoke.fluid.operators import corners, face_weight, side_weights
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _mark_solid(rows: Rows, lower: wp.vec3i, fraction: wp.array3d[float], fluid_inout: wp.array3d[float]):
    """Sets fluid = 0 where at least half of the cell is inside."""
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
    """wx_i = fluid_(i−1) fluid_i between cells, fluid on an open side, 0 on a closed one; wy, wz likewise."""
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
    """Sets the share to fluid_before fluid_after of the face's two cells."""
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
    """Returns the value of the other copy of a face on a periodic side."""
    return a[i - block.before[0], j - block.before[1], k - block.before[2]]


@wp.kernel
def _close_seam(rows: Rows, block: Block, share_inout: wp.array3d[float]):
    """Sets the share to the lesser of the face's two copies."""
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
    """Sets the velocity to the faster of the face's two copies, as only one may be adjacent to a solid."""
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
    """Sets u to the velocity of the solid on faces that are not open."""
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
    """Opens the faces between fluid cells, also across periodic sides, and on open sides.

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


def mark_solid(launcher: Launcher, lower: tuple[int, int, int], fraction: wp.array, fluid: wp.array) -> None:
    """Makes cells solid that are at least half filled.

    Args:
        launcher: where it runs.
        lower: first cell of a box.
        fraction: share of each cell of the box inside a wall.
        fluid: [nx, ny, nz], set to 0 in solid cells.
    """
    launcher.launch(_mark_solid, fraction.shape, wp.vec3i(*lower), fraction, fluid)


def close_seams(launcher: Launcher, sides: tuple[str, ...], shares: tuple[wp.array, wp.array, wp.array]) -> None:
    """Closes faces on periodic sides if either copy is closed, as only one may be in the box of a wall.

    Args:
        launcher: where it runs.
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        shares: wx, wy, wz, the open share of each face, changed.
    """
    _join_copies(launcher, _close_seam, sides, enumerate(shares))


def push_seams(launcher: Launcher, sides: tuple[str, ...], fields: Iterable[tuple[int, wp.array]]) -> None:
    """Gives both copies of each face on periodic sides the value of the copy with the greater magnitude.

    Args:
        launcher: where it runs.
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        fields: axes, and values on the faces across them, changed.
    """
    _join_copies(launcher, _push_seam, sides, fields)


def _join_copies(
    launcher: Launcher, kernel: wp.Kernel, sides: tuple[str, ...], fields: Iterable[tuple[int, wp.array]]
) -> None:
    """Computes the last copy of each face on periodic sides from both, then copies it to the first."""
    for axis, field in fields:
        if sides[2 * axis] == "periodic":
            cells = tuple(n - (a == axis) for a, n in enumerate(field.shape))
            last = last_faces(cells, axis)
            launcher.launch(kernel, *last, field)
            first = make_patch((0, 0, 0), last.shape, *(2 * (-last.block.before,)))
            copy_samples(launcher, [first], field, field)


def hold_closed(launcher: Launcher, patch: Patch, share: wp.array, solid: wp.array | None, faces: wp.array) -> None:
    """Gives closed faces the velocity of the solid.

    Args:
        launcher: where it runs.
        patch: faces across an axis.
        share: open share of each face.
        solid: velocity of the solids on these faces [m/s]; None = all solids are at rest.
        faces: velocity across that axis [m/s], changed.
    """
    if solid is None:
        launcher.launch(_stop_closed, *patch, share, faces)
    else:
        launcher.launch(_push_closed, *patch, share, solid, faces)


def empty_solids(launcher: Launcher, fluid: wp.array, field: wp.array, ambient: float) -> None:
    """Sets a cell-centred field to ambient in solids.

    Args:
        launcher: where it runs.
        fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz].
        field: [nx, ny, nz], changed.
        ambient: value to set.
    """
    launcher.launch(_empty, field.shape, fluid, ambient, field)
