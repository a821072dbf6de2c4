"""Advection beside solids: traces end on them, and only smoke on the near side of a solid is sampled.

Traces follow the cells that their straight line crosses (J. Amanatides, A. Woo, *A Fast Voxel Traversal Algorithm for
Ray Tracing*, 1987). Where one of the eight cells around a trace's end is solid, the others count if they share faces
with the cell of the end, directly or through one another: so walls one cell thick do not leak, diagonal ones included.
"""

import warp as wp

from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.interpolation import base, greater, shifted, within
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.struct
class NearSolids:
    """Cells beside solids, as kernels see them: fluid and held are 1 in cells of fluid now and in the last step."""

    fluid: wp.array3d[float]
    held: wp.array3d[float]
    near: wp.array3d[float]


# Traces end a little before a solid's face, so that round-off does not put them behind it.
_SHORT = wp.constant(0.999)


@wp.kernel
def _mark_crowded(rows: Rows, fluid: wp.array3d[float], held: wp.array3d[float], crowded_out: wp.array3d[float]):
    """Dilation: crowded = 1 where any of the 27 cells around is solid, or was so in the last step, else 0."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fluid.shape[2])
    while k < end:
        solid = wp.float32(0.0)
        for n in range(27):
            x = i + n // 9 - 1
            y = j + (n // 3) % 3 - 1
            z = k + n % 3 - 1
            if x >= 0 and y >= 0 and z >= 0 and x < fluid.shape[0] and y < fluid.shape[1] and z < fluid.shape[2]:
                solid = wp.max(solid, 1.0 - fluid[x, y, z] * held[x, y, z])
        crowded_out[i, j, k] = solid
        k += 1


@wp.func
def _way_to_solid(fluid: wp.array3d[float], i: int, j: int, k: int, x: float, y: float, z: float):
    """Share of the way from the centre of a cell along (x, y, z) to the first solid cell; 1 if there is none."""
    step_x = 1.0 / wp.abs(x)  # infinite along axes that are not crossed
    step_y = 1.0 / wp.abs(y)
    step_z = 1.0 / wp.abs(z)
    next_x = 0.5 * step_x
    next_y = 0.5 * step_y
    next_z = 0.5 * step_z
    way = wp.min(next_x, wp.min(next_y, next_z))
    result = wp.float32(1.0)
    while way < 1.0:
        if next_x == way:
            i += wp.where(x > 0.0, 1, -1)
            next_x += step_x
        elif next_y == way:
            j += wp.where(y > 0.0, 1, -1)
            next_y += step_y
        else:
            k += wp.where(z > 0.0, 1, -1)
            next_z += step_z
        if i < 0 or j < 0 or k < 0 or i >= fluid.shape[0] or j >= fluid.shape[1] or k >= fluid.shape[2]:
            break
        if fluid[i, j, k] == 0.0:
            result = way
            break
        way = wp.min(next_x, wp.min(next_y, next_z))
    return result


@wp.kernel
def _stop_at_solids(
    rows: Rows,
    fluid: wp.array3d[float],
    crowded: wp.array3d[float],
    dx_inout: wp.array3d[float],
    dy_inout: wp.array3d[float],
    dz_inout: wp.array3d[float],
):
    """Shortening: d ends where it first meets a solid."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fluid.shape[2])
    while k < end:
        x = dx_inout[i, j, k]
        y = dy_inout[i, j, k]
        z = dz_inout[i, j, k]
        far = wp.max(wp.abs(x), wp.max(wp.abs(y), wp.abs(z)))
        # A short way crosses none but the cell's neighbours.
        if (far > 1.5 or (far > 0.5 and crowded[i, j, k] > 0.0)) and fluid[i, j, k] > 0.0:
            way = _way_to_solid(fluid, i, j, k, x, y, z)
            if way < 1.0:
                dx_inout[i, j, k] = _SHORT * way * x
                dy_inout[i, j, k] = _SHORT * way * y
                dz_inout[i, j, k] = _SHORT * way * z
        k += 1


@wp.func
def _crowded_at(crowded: wp.array3d[float], x: float, y: float, z: float):
    """The value of `crowded` in the cell that holds (x, y, z), in cell indices, or in the cell nearest to it."""
    i = int(within(x + 0.5, 0.0, float(crowded.shape[0] - 1)))
    j = int(within(y + 0.5, 0.0, float(crowded.shape[1] - 1)))
    k = int(within(z + 0.5, 0.0, float(crowded.shape[2] - 1)))
    cells = shifted(crowded, 0, 0, 0)
    return cells[(i * crowded.shape[1] + j) * crowded.shape[2] + k]


@wp.kernel
def _mark_near(
    rows: Rows,
    crowded: wp.array3d[float],
    dx: wp.array3d[float],
    dy: wp.array3d[float],
    dz: wp.array3d[float],
    ex: wp.array3d[float],
    ey: wp.array3d[float],
    ez: wp.array3d[float],
    near_out: wp.array3d[float],
):
    """Nearness: near = 1 if x + d or x + e lies in a crowded cell, else 0."""
    i, j, c = wp.tid()
    i += rows.first
    bx = dense(dx)
    by = dense(dy)
    bz = dense(dz)
    ax = dense(ex)
    ay = dense(ey)
    az = dense(ez)
    near = dense_store(near_out)
    x = float(i)
    y = float(j)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, near_out.shape[2])
    while k < end:
        z = float(k)
        back = _crowded_at(crowded, x + bx[i, j, k], y + by[i, j, k], z + bz[i, j, k])
        ahead = _crowded_at(crowded, x + ax[i, j, k], y + ay[i, j, k], z + az[i, j, k])
        near[i, j, k] = bits(greater(back, ahead))
        k += 1


@wp.func
def _corner(a: wp.array3d[float], i: int, j: int, k: int, n: int):
    """Sample n of the eight from (i, j, k) on, numbered in binary; the last one stands for those outside."""
    x = wp.min(i + n // 4, a.shape[0] - 1)
    y = wp.min(j + (n // 2) % 2, a.shape[1] - 1)
    z = wp.min(k + n % 2, a.shape[2] - 1)
    return a[x, y, z]


@wp.func
def _connected(open: int, start: int):
    """Which of eight corners can be reached from some of them across faces, through open ones; a bit for each."""
    reached = open & start
    for _ in range(3):
        along_z = ((reached & 0x55) << 1) | ((reached & 0xAA) >> 1)
        along_y = ((reached & 0x33) << 2) | ((reached & 0xCC) >> 2)
        along_x = ((reached & 0x0F) << 4) | ((reached & 0xF0) >> 4)
        reached = reached | (open & (along_x | along_y | along_z))
    return reached


@wp.kernel
def _sample_near_solids(
    rows: Rows,
    solids: NearSolids,
    dx: wp.array3d[float],
    dy: wp.array3d[float],
    dz: wp.array3d[float],
    a: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    ambient: float,
    a_out: wp.array3d[float],
    least_out: wp.array3d[float],
    most_out: wp.array3d[float],
):
    """Where near: a_out(x) = least = most = Σ w a / Σ w, over the corners around x + d that are connected with it.

    Cells that were solid in the last step have no value yet; solid cells become ambient.
    """
    i, j, c = wp.tid()
    i += rows.first
    fluid = solids.fluid
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, a.shape[2])
    while k < end:
        value = ambient
        if fluid[i, j, k] > 0.0 and solids.near[i, j, k] > 0.0:
            x = within(float(i) + dx[i, j, k], lower[0], upper[0])
            y = within(float(j) + dy[i, j, k], lower[1], upper[1])
            z = within(float(k) + dz[i, j, k], lower[2], upper[2])
            cx = within(x, 0.0, float(a.shape[0] - 1))
            cy = within(y, 0.0, float(a.shape[1] - 1))
            cz = within(z, 0.0, float(a.shape[2] - 1))
            ci = base(cx, a.shape[0])
            cj = base(cy, a.shape[1])
            ck = base(cz, a.shape[2])
            fx = cx - float(ci)
            fy = cy - float(cj)
            fz = cz - float(ck)
            open = wp.int32(0)
            for corner in range(8):
                if _corner(fluid, ci, cj, ck, corner) > 0.0:
                    open = open | (1 << corner)
            nearest = 4 * int(fx + 0.5) + 2 * int(fy + 0.5) + int(fz + 0.5)
            reached = _connected(open, 1 << nearest)
            total = wp.float32(0.0)
            weights = wp.float32(0.0)
            for corner in range(8):
                if ((reached >> corner) & 1) == 1:
                    weight = _corner(solids.held, ci, cj, ck, corner)
                    weight *= wp.where(corner // 4 == 1, fx, 1.0 - fx)
                    weight *= wp.where((corner // 2) % 2 == 1, fy, 1.0 - fy)
                    weight *= wp.where(corner % 2 == 1, fz, 1.0 - fz)
                    total += weight * _corner(a, ci, cj, ck, corner)
                    weights += weight
            if weights > 0.0:
                inside = (1.0 - wp.abs(x - cx)) * (1.0 - wp.abs(y - cy)) * (1.0 - wp.abs(z - cz))
                value = ambient + inside * (total / weights - ambient)
        if fluid[i, j, k] == 0.0 or solids.near[i, j, k] > 0.0:
            a_out[i, j, k] = value
            least_out[i, j, k] = value
            most_out[i, j, k] = value
        k += 1


@wp.func
def _open(u: wp.array3d[float], share: wp.array3d[float], i: int, j: int, k: int):
    """The velocity and 1 on an open face, else 0 and 0."""
    count = wp.where(share[i, j, k] > 0.0, 1.0, 0.0)
    return count * u[i, j, k], count


@wp.kernel
def _extend(rows: Rows, unit: wp.vec3i, fluid: wp.array3d[float], share: wp.array3d[float], u_inout: wp.array3d[float]):
    """Free slip: u = mean of the open ones among the six faces around, on faces between two solid cells."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, u_inout.shape[2])
    while k < end:
        if share[i, j, k] == 0.0:
            before = fluid[wp.max(i - unit[0], 0), wp.max(j - unit[1], 0), wp.max(k - unit[2], 0)]
            after = fluid[wp.min(i, fluid.shape[0] - 1), wp.min(j, fluid.shape[1] - 1), wp.min(k, fluid.shape[2] - 1)]
            if before + after == 0.0:
                # On the domain's sides the missing neighbour is the face itself, which is not open.
                x0, nx0 = _open(u_inout, share, wp.max(i - 1, 0), j, k)
                x1, nx1 = _open(u_inout, share, wp.min(i + 1, u_inout.shape[0] - 1), j, k)
                y0, ny0 = _open(u_inout, share, i, wp.max(j - 1, 0), k)
                y1, ny1 = _open(u_inout, share, i, wp.min(j + 1, u_inout.shape[1] - 1), k)
                z0, nz0 = _open(u_inout, share, i, j, wp.max(k - 1, 0))
                z1, nz1 = _open(u_inout, share, i, j, wp.min(k + 1, u_inout.shape[2] - 1))
                count = nx0 + nx1 + ny0 + ny1 + nz0 + nz1
                if count > 0.0:
                    u_inout[i, j, k] = ((x0 + x1) + (y0 + y1) + (z0 + z1)) / count
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


class SolidBoundary:
    """The colliders of a domain as advection sees them."""

    def __init__(self, launcher: Launcher, solids: Solids):
        """Allocates.

        Args:
            launcher: where it runs.
            solids: the colliders on the lattice.
        """
        self._launcher, self._solids = launcher, solids
        shape = solids.fluid.shape
        self._crowded = launcher.zeros(shape, "colliders")
        self._near = NearSolids()
        self._near.fluid, self._near.near = solids.fluid, launcher.zeros(shape, "colliders")
        self._moves = solids.velocity is not None
        self._near.held = launcher.zeros(shape, "colliders") if self._moves else solids.fluid
        self._changes, self._settled = 0, False

    def move(self, start: float, end: float, seconds: float) -> None:
        """Moves the solids to where they stand at `end`; arguments as for `Solids.update`."""
        solids, held = self._solids, self._near.held
        if self._moves:
            wp.copy(held, solids.fluid)
        solids.update(start, end, seconds)
        changed, first = solids.changes != self._changes, self._changes == 0
        if first and self._moves:
            wp.copy(held, solids.fluid)
        # Once more in the step after a move: what was solid before it has smoke by then.
        if changed or not self._settled:
            self._launcher.launch(_mark_crowded, solids.fluid.shape, solids.fluid, held, self._crowded)
        self._changes, self._settled = solids.changes, not changed

    def empty(self, field: wp.array, ambient: float) -> None:
        """Makes a field of the cells ambient in solids."""
        self._launcher.launch(_empty, field.shape, self._solids.fluid, ambient, field)

    def extend(self, velocity: tuple) -> None:
        """Continues the flow along solids one face into them, so that it slips.

        Args:
            velocity: u, v, w on faces [m/s], changed inside solids.
        """
        solids = self._solids
        for axis, share in enumerate((solids.wx, solids.wy, solids.wz)):
            unit = wp.vec3i(*(int(a == axis) for a in range(3)))
            self._launcher.launch(_extend, share.shape, unit, solids.fluid, share, velocity[axis])

    def stop(self, back: list, ahead: list) -> None:
        """Ends traces at solids, and notes which cells `sample` has to do.

        Args:
            back: displacement backwards along x, y, z, each [nx, ny, nz] [cells], shortened.
            ahead: displacement forwards, likewise [cells].
        """
        fluid, crowded, near = self._solids.fluid, self._crowded, self._near.near
        self._launcher.launch(_stop_at_solids, fluid.shape, fluid, crowded, *back)
        self._launcher.launch(_mark_near, fluid.shape, crowded, *back, *ahead, near)

    def sample(self, back: list, field: wp.array, limits: tuple, ambient: float, results: tuple) -> None:
        """Samples a field of the cells again where solids are near, and makes it ambient in solids.

        Args:
            back: displacement backwards along x, y, z, each [nx, ny, nz] [cells].
            field: [nx, ny, nz].
            limits: first and last place that a trace may end, in cell indices.
            ambient: value of the field outside.
            results: three arrays [nx, ny, nz] that all take the value where solids are near; may be the same.
        """
        args = (self._near, *back, field, *limits, ambient, *results)
        self._launcher.launch(_sample_near_solids, field.shape, *args)
