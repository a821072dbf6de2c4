"""Advection near solids: traces end on them, and only smoke on the near side of a solid is sampled.

Traces end at the first closed face. Of the eight cells around a trace's end only those are used that open faces connect
with the cell of the end, so no wall leaks, however thin, not even a diagonal one.
"""

from math import ceil

import warp as wp

from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.grid import Block, Box, Patch, all_cells, faces_of, grown, patch_of
from warp_smoke.fluid.interpolation import clamped_place, greater, mixed, shifted, within
from warp_smoke.fluid.solid_cells import SHORT, SolidCells, sum_connected, way_to_solid
from warp_smoke.fluid.trace import Displacement
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.func
def _wall(share: wp.array3d[float], fluid: wp.array3d[float], i: int, j: int, k: int, di: int, dj: int, dk: int):
    """Returns 1 if the face on the lower side of cell (i, j, k) along an axis is closed between fluid cells, else 0."""
    inside = wp.where(wp.min(i - di, wp.min(j - dj, k - dk)) >= 0, 1.0, 0.0)
    before = fluid[wp.max(i - di, 0), wp.max(j - dj, 0), wp.max(k - dk, 0)]
    return inside * before * fluid[i, j, k] * wp.where(share[i, j, k] > 0.0, 0.0, 1.0)


@wp.kernel
def _mark_obstructed(rows: Rows, block: Block, solids: SolidCells, obstructed_out: wp.array3d[float]):
    """Mark: obstructed = 1 in cells that are solid or not held, or have a wall on one of their faces; else 0."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    fluid = dense(solids.fluid)
    held = dense(solids.held)
    wx = dense(solids.wx)
    wy = dense(solids.wy)
    wz = dense(solids.wz)
    obstructed = dense_store(obstructed_out)
    i1 = wp.min(i + 1, fluid.shape[0] - 1)
    j1 = wp.min(j + 1, fluid.shape[1] - 1)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        k1 = wp.min(k + 1, obstructed_out.shape[2] - 1)
        # On the upper sides of the domain the cell's own lower face counts twice instead.
        x = greater(_wall(wx, fluid, i, j, k, 1, 0, 0), _wall(wx, fluid, i1, j, k, 1, 0, 0))
        y = greater(_wall(wy, fluid, i, j, k, 0, 1, 0), _wall(wy, fluid, i, j1, k, 0, 1, 0))
        z = greater(_wall(wz, fluid, i, j, k, 0, 0, 1), _wall(wz, fluid, i, j, k1, 0, 0, 1))
        solid = 1.0 - fluid[i, j, k] * held[i, j, k]
        obstructed[i, j, k] = bits(greater(solid, greater(x, greater(y, z))))
        k += 1


@wp.kernel
def _spread(rows: Rows, block: Block, unit: wp.vec3i, a: wp.array3d[float], a_out: wp.array3d[float]):
    """Dilation: a_out(x) = max of a(x − unit), a(x), a(x + unit)."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    src = dense(a)
    out = dense_store(a_out)
    i0 = wp.max(i - unit[0], 0)
    j0 = wp.max(j - unit[1], 0)
    i1 = wp.min(i + unit[0], a.shape[0] - 1)
    j1 = wp.min(j + unit[1], a.shape[1] - 1)
    step = unit[2]
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        k0 = wp.max(k - step, 0)
        k1 = wp.min(k + step, a.shape[2] - 1)
        out[i, j, k] = bits(greater(src[i, j, k], greater(src[i0, j0, k0], src[i1, j1, k1])))
        k += 1


@wp.kernel
def _stop_at_solids(
    rows: Rows,
    block: Block,
    solids: SolidCells,
    d_inout: Displacement,
):
    """Shortening: d ends just before the first closed face."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x = d_inout.x[i, j, k]
        y = d_inout.y[i, j, k]
        z = d_inout.z[i, j, k]
        far = wp.max(wp.abs(x), wp.max(wp.abs(y), wp.abs(z)))
        # A short trace crosses only faces of the cell and its neighbours.
        if (far > 1.5 or (far > 0.5 and solids.crowded[i, j, k] > 0.0)) and solids.fluid[i, j, k] > 0.0:
            way = way_to_solid(solids, i, j, k, x, y, z)
            if way < 2.0:
                d_inout.x[i, j, k] = SHORT * way * x
                d_inout.y[i, j, k] = SHORT * way * y
                d_inout.z[i, j, k] = SHORT * way * z
        k += 1


@wp.func
def _crowded_at(crowded: wp.array3d[float], x: float, y: float, z: float):
    """Returns the value of `crowded` in the cell that contains (x, y, z), in cell indices, or in the nearest cell."""
    i = int(within(x + 0.5, 0.0, float(crowded.shape[0] - 1)))
    j = int(within(y + 0.5, 0.0, float(crowded.shape[1] - 1)))
    k = int(within(z + 0.5, 0.0, float(crowded.shape[2] - 1)))
    cells = shifted(crowded, 0, 0, 0)
    return cells[(i * crowded.shape[1] + j) * crowded.shape[2] + k]


@wp.kernel
def _mark_near(
    rows: Rows,
    block: Block,
    crowded: wp.array3d[float],
    d: Displacement,
    e: Displacement,
    near_out: wp.array3d[float],
):
    """Mark: near = 1 if x + d or x + e lies in a crowded cell, else 0."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    dx = dense(d.x)
    dy = dense(d.y)
    dz = dense(d.z)
    ex = dense(e.x)
    ey = dense(e.y)
    ez = dense(e.z)
    near = dense_store(near_out)
    x = float(i)
    y = float(j)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        z = float(k)
        back = _crowded_at(crowded, x + dx[i, j, k], y + dy[i, j, k], z + dz[i, j, k])
        ahead = _crowded_at(crowded, x + ex[i, j, k], y + ey[i, j, k], z + ez[i, j, k])
        near[i, j, k] = bits(greater(back, ahead))
        k += 1


@wp.kernel
def _sample_near_solids(
    rows: Rows,
    block: Block,
    solids: SolidCells,
    d: Displacement,
    a: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    ambient: float,
    a_out: wp.array3d[float],
    least_out: wp.array3d[float],
    most_out: wp.array3d[float],
):
    """Where near: a_out(x) = least = most = Σ w a / Σ w over the corners around x + d that are connected with it.

    Solid cells become ambient.
    """
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    fluid = solids.fluid
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        value = ambient
        if fluid[i, j, k] > 0.0 and solids.near[i, j, k] > 0.0:
            x = float(i) + d.x[i, j, k]
            y = float(j) + d.y[i, j, k]
            z = float(k) + d.z[i, j, k]
            cx, cy, cz, inside = clamped_place(a, x, y, z, lower, upper)
            total, weights = sum_connected(solids, a, cx, cy, cz)
            if weights > 0.0:
                value = mixed(ambient, total / weights, inside)
        if fluid[i, j, k] == 0.0 or solids.near[i, j, k] > 0.0:
            a_out[i, j, k] = value
            least_out[i, j, k] = value
            most_out[i, j, k] = value
        k += 1


@wp.func
def _open(u: wp.array3d[float], share: wp.array3d[float], i: int, j: int, k: int):
    """Returns the velocity and 1 on an open face, else 0 and 0."""
    count = wp.where(share[i, j, k] > 0.0, 1.0, 0.0)
    return count * u[i, j, k], count


@wp.kernel
def _extend(
    rows: Rows,
    block: Block,
    unit: wp.vec3i,
    fluid: wp.array3d[float],
    share: wp.array3d[float],
    u_inout: wp.array3d[float],
):
    """Free slip: on faces between two solid cells, u = mean over the open faces among the six neighbours."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
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


class SolidBoundary:
    """The colliders of a domain as a boundary for advection."""

    def __init__(self, launcher: Launcher, solids: Solids):
        """Allocates.

        Args:
            launcher: where it runs.
            solids: the colliders on the lattice.
        """
        self._launcher, self._solids = launcher, solids
        shape = solids.fluid.shape
        self._crowded, self._near, self._spare = (launcher.zeros(shape, "colliders") for _ in range(3))
        cells = self._cells = SolidCells()
        cells.fluid, cells.held, cells.crowded, cells.near = solids.fluid, solids.held, self._crowded, self._near
        cells.wx, cells.wy, cells.wz = solids.wx, solids.wy, solids.wz
        self._changes, self._settled = 0, False
        self._concerned = all_cells(shape)  # cells whose traces may meet solids

    def move(self, start: float, end: float, seconds: float) -> None:
        """Moves the solids to their positions at `end`; arguments as for `Solids.update`."""
        solids = self._solids
        solids.update(start, end, seconds)
        changed = solids.changes != self._changes
        # Again in the step after a move: cells that were solid or passed over in it now hold smoke.
        if changed or not self._settled:
            self._mark_crowded()
        self._changes, self._settled = solids.changes, not changed

    def follow(self, courant: float) -> None:
        """Limits the work to cells whose traces may come near solids, until this is called again.

        Args:
            courant: most cells that air moves in a step.
        """
        # A forward trace is the backward one plus twice the air's displacement; crowded cells are within two of solids.
        self._concerned = self._cells_near(ceil(min(3.0 * courant, max(self._near.shape))) + 3)

    def _cells_near(self, distance: int) -> Patch:
        """Returns the cells within a distance of the solids' box."""
        shape, box = self._near.shape, self._solids.box
        nothing = Box((0, 0, 0), (0, 0, 0))
        return patch_of(nothing if box is None else grown(box, distance, shape), all_cells(shape))

    def _mark_crowded(self) -> None:
        self._spare.zero_()
        self._crowded.zero_()
        patch, (x, y, z) = self._cells_near(2), (wp.vec3i(1, 0, 0), wp.vec3i(0, 1, 0), wp.vec3i(0, 0, 1))
        self._launcher.launch(_mark_obstructed, *patch, self._cells, self._spare)
        self._launcher.launch(_spread, *patch, x, self._spare, self._crowded)
        self._launcher.launch(_spread, *patch, y, self._crowded, self._spare)
        self._launcher.launch(_spread, *patch, z, self._spare, self._crowded)

    def extend(self, velocity: tuple) -> None:
        """Extends the flow along solids one face into them, so that it slips freely.

        Args:
            velocity: u, v, w on faces [m/s], changed inside solids.
        """
        solids = self._solids
        if solids.box is None:
            return
        for axis, share in enumerate((solids.wx, solids.wy, solids.wz)):
            unit = wp.vec3i(*(int(a == axis) for a in range(3)))
            self._launcher.launch(_extend, *faces_of(solids.box, axis), unit, solids.fluid, share, velocity[axis])

    def stop(self, back: Displacement, ahead: Displacement) -> None:
        """Ends backward traces at solids, and marks the cells that `sample` has to resample.

        Args:
            back: displacements to where smoke was, shortened.
            ahead: displacements to where it will be.
        """
        self._launcher.launch(_stop_at_solids, *self._concerned, self._cells, back)
        self._launcher.launch(_mark_near, *self._concerned, self._crowded, back, ahead, self._near)

    def sample(self, back: Displacement, field: wp.array, limits: tuple, ambient: float, results: tuple) -> None:
        """Resamples a cell-centred field near solids, and sets it to ambient in solids.

        Args:
            back: displacements to where smoke was.
            field: [nx, ny, nz].
            limits: first and last positions where a trace may end, in cell indices.
            ambient: value of the field outside.
            results: three arrays [nx, ny, nz] that all receive the value near solids; may be the same.
        """
        args = (self._cells, back, field, *limits, ambient, *results)
        self._launcher.launch(_sample_near_solids, *self._concerned, *args)
