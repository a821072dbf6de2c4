"""Solid obstacles on the lattice: which cells are fluid, which faces are open, and how fast solid faces move."""

from collections.abc import Sequence

import warp as wp

from warp_smoke.fluid.operators import corners, face_weight, side_weights
from warp_smoke.fluid.voxelize import MeshVoxels
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows, dense
from warp_smoke.scene import Collider

wp.set_module_options({"enable_backward": False})

# Half a cell; a little less, so that a surface through the centres is solid whatever the round-off.
_SOLID_FRACTION = wp.constant(0.499)


@wp.kernel
def _mark_solid(rows: Rows, lower: wp.vec3i, fraction: wp.array3d[float], fluid_inout: wp.array3d[float]):
    """Sets fluid = 0 where half of the cell is inside."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fraction.shape[2])
    while k < end:
        if fraction[i, j, k] >= _SOLID_FRACTION:
            fluid_inout[lower[0] + i, lower[1] + j, lower[2] + k] = 0.0
        k += 1


@wp.kernel
def _mark_moving(
    rows: Rows,
    lower: wp.vec3i,
    fraction: wp.array3d[float],
    u: wp.array3d[float],
    v: wp.array3d[float],
    w: wp.array3d[float],
    fluid_inout: wp.array3d[float],
    u_inout: wp.array3d[float],
    v_inout: wp.array3d[float],
    w_inout: wp.array3d[float],
):
    """Sets fluid = 0 and cell velocity = the surface's (u, v, w) where half of the cell is inside."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fraction.shape[2])
    while k < end:
        if fraction[i, j, k] >= _SOLID_FRACTION:
            x = lower[0] + i
            y = lower[1] + j
            z = lower[2] + k
            fluid_inout[x, y, z] = 0.0
            u_inout[x, y, z] = u[i, j, k]
            v_inout[x, y, z] = v[i, j, k]
            w_inout[x, y, z] = w[i, j, k]
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


@wp.func
def _face_velocity(open_side: float, fluid_a: float, fluid_b: float, velocity_a: float, velocity_b: float):
    """Mean velocity of the solid cells on either side; 0 between cells of fluid and on closed sides."""
    return wp.min(open_side, 1.0) * (velocity_a + velocity_b) / wp.max(2.0 - fluid_a - fluid_b, 1.0)


@wp.kernel
def _move_faces(
    rows: Rows,
    fluid: wp.array3d[float],
    u: wp.array3d[float],
    v: wp.array3d[float],
    w: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    u_out: wp.array3d[float],
    v_out: wp.array3d[float],
    w_out: wp.array3d[float],
):
    """u_out_i = mean of u over the solid ones of cells i−1 and i (u = 0 in fluid); 0 on closed sides. v, w alike."""
    i, j, c = wp.tid()
    i += rows.first
    nx = fluid.shape[0]
    ny = fluid.shape[1]
    nz = fluid.shape[2]
    f = dense(fluid)
    a = wp.max(i - 1, 0)
    b = wp.min(i, nx - 1)
    d = wp.max(j - 1, 0)
    e = wp.min(j, ny - 1)
    open_i = face_weight(i, nx, lower[0], upper[0])
    open_j = face_weight(j, ny, lower[1], upper[1])
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, nz + 1)
    while k < end:
        if j < ny and k < nz:
            u_out[i, j, k] = _face_velocity(open_i, f[a, j, k], f[b, j, k], u[a, j, k], u[b, j, k])
        if i < nx and k < nz:
            v_out[i, j, k] = _face_velocity(open_j, f[i, d, k], f[i, e, k], v[i, d, k], v[i, e, k])
        if i < nx and j < ny:
            g = wp.max(k - 1, 0)
            h = wp.min(k, nz - 1)
            open_k = face_weight(k, nz, lower[2], upper[2])
            w_out[i, j, k] = _face_velocity(open_k, f[i, j, g], f[i, j, h], w[i, j, g], w[i, j, h])
        k += 1


@wp.kernel
def _stop_closed(rows: Rows, share: wp.array3d[float], u_inout: wp.array3d[float]):
    """Sets u = 0 on faces that are not open."""
    i, j, c = wp.tid()
    i += rows.first
    s = dense(share)
    u = dense(u_inout)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, u_inout.shape[2])
    while k < end:
        u[i, j, k] = wp.where(s[i, j, k] > 0.0, u[i, j, k], 0.0)
        k += 1


@wp.kernel
def _push_closed(rows: Rows, share: wp.array3d[float], solid: wp.array3d[float], u_inout: wp.array3d[float]):
    """Sets u to that of the solid on faces that are not open."""
    i, j, c = wp.tid()
    i += rows.first
    s = dense(share)
    pushed = dense(solid)
    u = dense(u_inout)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, u_inout.shape[2])
    while k < end:
        u[i, j, k] = wp.where(s[i, j, k] > 0.0, u[i, j, k], pushed[i, j, k])
        k += 1


def open_faces(
    launcher: Launcher,
    fluid: wp.array,
    sides: tuple[str, ...],
    shares: tuple[wp.array, wp.array, wp.array],
) -> None:
    """Opens the faces between cells of fluid and on open sides.

    Args:
        launcher: where it runs.
        fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz].
        sides: open or closed for each of -x +x -y +y -z +z.
        shares: wx, wy, wz, the open share of each face, written.
    """
    launcher.launch(_open_faces, corners(fluid.shape), fluid, *side_weights(sides), *shares)


class Solids:
    """All colliders of a domain.

    A cell is fluid or solid: solid where a mesh, grown by its thickness, fills half of it. Where
    solids overlap, those that move win, and among them the later.

    Attributes:
        fluid: 1 in fluid, 0 in solid cells, [nx, ny, nz].
        wx, wy, wz: open share of each face, 0 or 1: 0 between fluid and solid and on closed sides of the domain;
            [nx+1, ny, nz], [nx, ny+1, nz], [nx, ny, nz+1].
        velocity: u, v, w of the solids on faces that are not open [m/s]; None if no collider ever moves.
        changes: how often the arrays were filled.
    """

    def __init__(self, launcher: Launcher, lattice: Lattice, colliders: Sequence[Collider]):
        """Allocates; `update` fills the arrays.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            colliders: the meshes; their thickness is in voxels.
        """
        self._launcher, self._lattice = launcher, lattice
        voxels = [MeshVoxels(launcher, lattice, each, "colliders", each.thickness) for each in colliders]
        self._voxels = sorted(voxels, key=lambda each: each.moves)
        nx, ny, nz = lattice.shape
        faces = ((nx + 1, ny, nz), (nx, ny + 1, nz), (nx, ny, nz + 1))
        self.fluid = launcher.zeros(lattice.shape, "colliders")
        self.wx, self.wy, self.wz = (launcher.zeros(shape, "colliders") for shape in faces)
        self.velocity, self._cell_velocity = None, None
        if any(each.moves for each in voxels):
            self.velocity = tuple(launcher.zeros(shape, "colliders") for shape in faces)
            self._cell_velocity = tuple(launcher.zeros(lattice.shape, "colliders") for _ in range(3))
        self.changes = 0

    def update(self, start: float, end: float, seconds: float) -> None:
        """Moves the solids to where they stand at `end`; does nothing if they stand there already.

        Args:
            start: time code that their velocity is measured from.
            end: time code; solids are at rest if it equals `start`.
            seconds: of smoke between them [s].
        """
        moved = [each.update(start, end, seconds) for each in self._voxels]
        if self.changes and not any(moved):
            return
        self.changes += 1
        self.fluid.fill_(1.0)
        if self.velocity is not None:
            for array in self._cell_velocity:
                array.zero_()
        for each in self._voxels:
            if 0 in each.shape:
                continue
            lower = wp.vec3i(*each.lower)
            if each.moves:
                args = (lower, each.fraction, *each.velocity, self.fluid, *self._cell_velocity)
                self._launcher.launch(_mark_moving, each.shape, *args)
            else:
                self._launcher.launch(_mark_solid, each.shape, lower, each.fraction, self.fluid)
        sides = self._lattice.sides
        open_faces(self._launcher, self.fluid, sides, (self.wx, self.wy, self.wz))
        if self.velocity is not None:
            args = (self.fluid, *self._cell_velocity, *side_weights(sides), *self.velocity)
            self._launcher.launch(_move_faces, corners(self._lattice.shape), *args)

    def apply(self, velocity: tuple[wp.array, wp.array, wp.array]) -> None:
        """Gives faces that are not open the velocity of the solid there (0 on closed sides of the domain).

        Args:
            velocity: u, v, w on faces [m/s], changed.
        """
        shares = (self.wx, self.wy, self.wz)
        if self.velocity is None:
            for share, faces in zip(shares, velocity, strict=True):
                self._launcher.launch(_stop_closed, faces.shape, share, faces)
        else:
            for share, solid, faces in zip(shares, self.velocity, velocity, strict=True):
                self._launcher.launch(_push_closed, faces.shape, share, solid, faces)
