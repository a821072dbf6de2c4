"""Divergence and pressure gradient on the staggered grid (F. H. Harlow, J. E. Welch, 1965).

Both are undivided. Divergence means d = Σ (u₊ − u₋) [m/s] and pressure means q = dt p / h [m/s], so neither h nor dt
enters: the projection solves L q = d with L = divergence of gradient, then subtracts the gradient of q from velocity.
Velocity is (u, v, w) on faces, [nx+1, ny, nz], [nx, ny+1, nz], [nx, ny, nz+1] [m/s]; d and q sit in cells,
[nx, ny, nz]. An open side has p = 0 on its face, half a cell from the centre: weight 2 with q = 0 outside. A closed
side lets nothing through: weight 0. Beyond a periodic side is the cell at the other end: weight 1, as between cells;
the faces on it are stored twice, as the first and the last.
"""

from functools import cache

import warp as wp

from warp_smoke.fluid.grid import Block, beside, closed_ends, seam_faces
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


SIDE_WEIGHTS = {"open": 2.0, "closed": 0.0, "periodic": 1.0}


@cache
def side_weights(sides: tuple[str, ...]) -> tuple[wp.vec3, wp.vec3]:
    """Returns the weights of q in the gradient on the outermost faces: lower and upper sides, see `SIDE_WEIGHTS`."""
    weights = [SIDE_WEIGHTS[side] for side in sides]
    return wp.vec3(*weights[0::2]), wp.vec3(*weights[1::2])


@wp.func
def face_weight(n: int, last: int, lower: float, upper: float):
    """Returns the weight of the gradient on face n of 0 … last along an axis."""
    return wp.where(n == 0, lower, wp.where(n == last, upper, 1.0))


@wp.func
def _outflow(u: wp.array3d[float], v: wp.array3d[float], w: wp.array3d[float], i: int, j: int, k: int):
    """Returns Σ (u₊ − u₋) of a cell."""
    fu = dense(u)
    fv = dense(v)
    fw = dense(w)
    along_i = fu[i + 1, j, k] - fu[i, j, k]
    along_j = fv[i, j + 1, k] - fv[i, j, k]
    along_k = fw[i, j, k + 1] - fw[i, j, k]
    return along_i + along_j + along_k


@wp.func
def _step_across_i(pressure: wp.array3d[float], i: int, j: int, k: int, lower: float, upper: float):
    """Returns the weighted difference a (q_i − q_(i−1)) on face i, with q = 0 outside."""
    n = pressure.shape[0]
    q = dense(pressure)
    a = face_weight(i, n, lower, upper)
    return wp.where(i < n, a, 0.0) * q[wp.min(i, n - 1), j, k] - wp.where(i > 0, a, 0.0) * q[wp.max(i - 1, 0), j, k]


@wp.func
def _step_across_j(pressure: wp.array3d[float], i: int, j: int, k: int, lower: float, upper: float):
    """Returns the weighted difference a (q_j − q_(j−1)) on face j, with q = 0 outside."""
    n = pressure.shape[1]
    q = dense(pressure)
    a = face_weight(j, n, lower, upper)
    return wp.where(j < n, a, 0.0) * q[i, wp.min(j, n - 1), k] - wp.where(j > 0, a, 0.0) * q[i, wp.max(j - 1, 0), k]


@wp.func
def _whole(_share: wp.array3d[float], _i: int, _j: int, _k: int):
    """Returns 1, for lattices without solids."""
    return 1.0


@wp.func
def _open(share: wp.array3d[float], i: int, j: int, k: int):
    """Returns the open share of a face, or the fluid share of a cell."""
    shares = dense(share)
    return shares[i, j, k]


def _divergence_kernel(share: wp.Function) -> wp.Kernel:
    """Makes the kernel that weights cells by `_whole` (fluid is not read) or `_open` (it is)."""

    @wp.kernel(name=f"_measure_divergence{share.key}")
    def measure(
        rows: Rows,
        u: wp.array3d[float],
        v: wp.array3d[float],
        w: wp.array3d[float],
        fluid: wp.array3d[float],
        divergence_out: wp.array3d[float],
    ):
        """d_ijk = fluid_ijk (u_(i+1) − u_i + v_(j+1) − v_j + w_(k+1) − w_k)."""
        i, j, c = wp.tid()
        i += rows.first
        d = dense_store(divergence_out)
        k = wp.max(c * rows.run, 0)
        end = wp.min(k + rows.run, divergence_out.shape[2])
        while k < end:
            d[i, j, k] = bits(share(fluid, i, j, k) * _outflow(u, v, w, i, j, k))
            k += 1

    return measure


_measure_divergence, _measure_fluid_divergence = _divergence_kernel(_whole), _divergence_kernel(_open)


def _gradient_kernel(share: wp.Function) -> wp.Kernel:
    """Makes the kernel that weights faces by `_whole` (shares are not read) or `_open` (they are)."""

    @wp.kernel(name=f"_subtract_gradient{share.key}")
    def subtract(
        rows: Rows,
        pressure: wp.array3d[float],
        lower: wp.vec3,
        upper: wp.vec3,
        wx: wp.array3d[float],
        wy: wp.array3d[float],
        wz: wp.array3d[float],
        u_inout: wp.array3d[float],
        v_inout: wp.array3d[float],
        w_inout: wp.array3d[float],
    ):
        """u_i −= wx_i a (q_i − q_(i−1)), wx the open share of the face; v and w likewise.

        a = 1 inside, 2 (open) or 0 (closed) on a side, with q = 0 outside.
        """
        i, j, c = wp.tid()
        i += rows.first
        nx = pressure.shape[0]
        ny = pressure.shape[1]
        nz = pressure.shape[2]
        q = dense(pressure)
        u = dense(u_inout)
        v = dense(v_inout)
        w = dense(w_inout)
        start = wp.max(c * rows.run, 0)
        end = wp.min(start + rows.run, nz)

        if j < ny:
            k = start
            while k < end:
                step = _step_across_i(pressure, i, j, k, lower[0], upper[0])
                u[i, j, k] = u[i, j, k] - share(wx, i, j, k) * step
                k += 1

        if i < nx:
            k = start
            while k < end:
                step = _step_across_j(pressure, i, j, k, lower[1], upper[1])
                v[i, j, k] = v[i, j, k] - share(wy, i, j, k) * step
                k += 1

        if i < nx and j < ny:
            if start == 0:
                w[i, j, 0] = w[i, j, 0] - share(wz, i, j, 0) * lower[2] * q[i, j, 0]
            k = wp.max(start, 1)
            while k < end:
                w[i, j, k] = w[i, j, k] - share(wz, i, j, k) * (q[i, j, k] - q[i, j, k - 1])
                k += 1
            if start + rows.run > nz:
                w[i, j, nz] = w[i, j, nz] + share(wz, i, j, nz) * upper[2] * q[i, j, nz - 1]

    return subtract


_subtract_gradient, _subtract_weighted_gradient = _gradient_kernel(_whole), _gradient_kernel(_open)


def _seam_kernel(share: wp.Function) -> wp.Kernel:
    """Makes the kernel that weights faces by `_whole` (shares are not read) or `_open` (they are)."""

    @wp.kernel(name=f"_subtract_across_seam{share.key}")
    def subtract(
        rows: Rows, block: Block, pressure: wp.array3d[float], shares: wp.array3d[float], u_inout: wp.array3d[float]
    ):
        """Sets u −= w (q_after − q_before) for the two cells of a face, w its open share."""
        i, j, c = wp.tid()
        i += rows.first + block.first[0]
        j += block.first[1]
        before = beside(pressure, block.before)
        after = beside(pressure, block.after)
        u = dense(u_inout)
        k = wp.max(block.first[2] + c * rows.run, 0)
        end = wp.min(k + rows.run, block.stop)
        while k < end:
            u[i, j, k] = u[i, j, k] - share(shares, i, j, k) * (after[i, j, k] - before[i, j, k])
            k += 1

    return subtract


_subtract_across_seam, _subtract_weighted_across_seam = _seam_kernel(_whole), _seam_kernel(_open)


@wp.kernel
def _close_sides(
    rows: Rows,
    lower: wp.vec3,
    upper: wp.vec3,
    u_inout: wp.array3d[float],
    v_inout: wp.array3d[float],
    w_inout: wp.array3d[float],
):
    """Sets u = 0 on closed sides of x (weight 0 in `lower` and `upper`), v = 0 on those of y, w = 0 on those of z."""
    i, j, c = wp.tid()
    i += rows.first
    nx = v_inout.shape[0]
    ny = u_inout.shape[1]
    nz = u_inout.shape[2]
    u = dense(u_inout)
    v = dense(v_inout)
    w = dense(w_inout)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, nz)
    if j < ny and face_weight(i, nx, lower[0], upper[0]) == 0.0:
        k = start
        while k < end:
            u[i, j, k] = 0.0
            k += 1
    if i < nx and face_weight(j, ny, lower[1], upper[1]) == 0.0:
        k = start
        while k < end:
            v[i, j, k] = 0.0
            k += 1
    if i < nx and j < ny:
        if start == 0 and lower[2] == 0.0:
            w[i, j, 0] = 0.0
        if start + rows.run > nz and upper[2] == 0.0:
            w[i, j, nz] = 0.0


def corners(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Returns the shape of a launch that covers every face once: corner (i, j, k) has its cell's three lower faces."""
    return shape[0] + 1, shape[1] + 1, shape[2] + 1


def measure_divergence(launcher: Launcher, velocity: tuple[wp.array, wp.array, wp.array], divergence: wp.array) -> None:
    """Computes the divergence d = Σ (u₊ − u₋) of each cell.

    Args:
        launcher: where it runs.
        velocity: u, v, w on faces [m/s].
        divergence: [nx, ny, nz] [m/s], written.
    """
    launcher.launch(_measure_divergence, divergence.shape, *velocity, None, divergence)


def measure_fluid_divergence(
    launcher: Launcher, velocity: tuple[wp.array, wp.array, wp.array], solids, divergence: wp.array
) -> None:
    """Computes the divergence of fluid cells, 0 in solid cells; faces of solids must have their velocity.

    Args:
        launcher: where it runs.
        velocity: u, v, w on faces [m/s].
        solids: a `Solids`, whose `apply` has set the velocity of solid faces.
        divergence: [nx, ny, nz] [m/s], written.
    """
    launcher.launch(_measure_fluid_divergence, divergence.shape, *velocity, solids.fluid, divergence)


def subtract_gradient(
    launcher: Launcher, pressure: wp.array, sides: tuple[str, ...], velocity: tuple[wp.array, wp.array, wp.array]
) -> None:
    """Subtracts the gradient of q from the velocity; faces on closed sides keep theirs.

    Args:
        launcher: where it runs.
        pressure: q = dt p / h, [nx, ny, nz] [m/s].
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        velocity: u, v, w on faces [m/s], changed.
    """
    weights = side_weights(closed_ends(sides))
    launcher.launch(_subtract_gradient, corners(pressure.shape), pressure, *weights, None, None, None, *velocity)
    for axis, component in enumerate(velocity):
        for shape, block in seam_faces(pressure.shape, sides, axis):
            launcher.launch(_subtract_across_seam, shape, block, pressure, None, component)


def subtract_fluid_gradient(
    launcher: Launcher,
    pressure: wp.array,
    sides: tuple[str, ...],
    solids,
    velocity: tuple[wp.array, wp.array, wp.array],
) -> None:
    """Subtracts the gradient of q, weighted by open shares, from the velocity; faces of solids keep theirs.

    Args:
        launcher: where it runs.
        pressure: q = dt p / h, [nx, ny, nz] [m/s].
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        solids: a `Solids`.
        velocity: u, v, w on faces [m/s], changed.
    """
    shares, weights = (solids.wx, solids.wy, solids.wz), side_weights(closed_ends(sides))
    launcher.launch(_subtract_weighted_gradient, corners(pressure.shape), pressure, *weights, *shares, *velocity)
    for axis, (share, component) in enumerate(zip(shares, velocity, strict=True)):
        for shape, block in seam_faces(pressure.shape, sides, axis):
            launcher.launch(_subtract_weighted_across_seam, shape, block, pressure, share, component)


def close_sides(launcher: Launcher, sides: tuple[str, ...], velocity: tuple[wp.array, wp.array, wp.array]) -> None:
    """Sets the velocity through closed sides to 0.

    Args:
        launcher: where it runs.
        sides: open, closed or periodic for each of -x +x -y +y -z +z.
        velocity: u, v, w on faces [m/s], changed.
    """
    if "closed" in sides:
        u, v, w = velocity
        shape = u.shape[0], v.shape[1], w.shape[2]
        launcher.launch(_close_sides, shape, *side_weights(sides), u, v, w)
