"""Diffusion by Jacobi sweeps, also near colliders.

A sweep takes a weighted mean of the initial field and its current neighbours, so values never leave the range of the
field and of its values on the sides, however few the sweeps. The flux between two samples passes through the open share
of the face between them; for a velocity component that is the mean over two cell faces.
"""

from math import ceil, log, prod

import warp as wp

from warp_smoke.fluid.diffusion.problem import DiffusionProblem
from warp_smoke.fluid.grid import face_shape
from warp_smoke.fluid.halo import Halo
from warp_smoke.fluid.solid_faces import open_faces
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})

# Sweeps end once at most this share of the initial error, the resolution of float32, can be left.
_ENOUGH = 1e-6


@wp.kernel
def _sweep_cells(
    rows: Rows,
    before: wp.array3d[float],
    a: wp.array3d[float],
    wx: wp.array3d[float],
    wy: wp.array3d[float],
    wz: wp.array3d[float],
    r: float,
    a_out: wp.array3d[float],
):
    """a_out = (before + r Σ w a_nb) / (1 + r Σ w), w the open share of each face.

    On an open side w is 2 and a_nb is 0: the side is half a cell away.
    """
    i, j, c = wp.tid()
    i += rows.first
    old = dense(before)
    src = dense(a)
    x = dense(wx)
    y = dense(wy)
    z = dense(wz)
    out = dense_store(a_out)
    nx = a.shape[0]
    ny = a.shape[1]
    nz = a.shape[2]
    i0 = wp.max(i - 1, 0)
    i1 = wp.min(i + 1, nx - 1)
    j0 = wp.max(j - 1, 0)
    j1 = wp.min(j + 1, ny - 1)
    # 1 for a neighbour inside the domain, else 0.
    inside_x0 = float(i - i0)
    inside_x1 = float(i1 - i)
    inside_y0 = float(j - j0)
    inside_y1 = float(j1 - j)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, nz)
    while k < end:
        k0 = wp.max(k - 1, 0)
        k1 = wp.min(k + 1, nz - 1)
        inside_z0 = float(k - k0)
        inside_z1 = float(k1 - k)
        x0 = x[i, j, k]
        x1 = x[i + 1, j, k]
        y0 = y[i, j, k]
        y1 = y[i, j + 1, k]
        z0 = z[i, j, k]
        z1 = z[i, j, k + 1]
        total = inside_x0 * x0 * src[i0, j, k] + inside_x1 * x1 * src[i1, j, k]
        total += inside_y0 * y0 * src[i, j0, k] + inside_y1 * y1 * src[i, j1, k]
        total += inside_z0 * z0 * src[i, j, k0] + inside_z1 * z1 * src[i, j, k1]
        weight = (2.0 - inside_x0) * x0 + (2.0 - inside_x1) * x1
        weight += (2.0 - inside_y0) * y0 + (2.0 - inside_y1) * y1
        weight += (2.0 - inside_z0) * z0 + (2.0 - inside_z1) * z1
        out[i, j, k] = bits((old[i, j, k] + r * total) / (1.0 + r * weight))
        k += 1


@wp.func
def _exchange(
    u: wp.array3d[float],
    share: wp.array3d[float],
    along: wp.vec3i,
    across: wp.vec3i,
    lower: float,
    upper: float,
    i: int,
    j: int,
    k: int,
):
    """Returns Σ w u_nb and Σ w over the two neighbours of face (i, j, k) `across` the axis of u, which is `along`.

    w is the mean open share of the two faces from the face's cells towards the neighbour; on a side of the domain it is
    the weight of the side, `lower` or `upper`, where u is 0.
    """
    ci = wp.max(i - along[0], 0)
    cj = wp.max(j - along[1], 0)
    ck = wp.max(k - along[2], 0)
    di = wp.min(i, u.shape[0] - 1 - along[0])
    dj = wp.min(j, u.shape[1] - 1 - along[1])
    dk = wp.min(k, u.shape[2] - 1 - along[2])
    i0 = wp.max(i - across[0], 0)
    j0 = wp.max(j - across[1], 0)
    k0 = wp.max(k - across[2], 0)
    i1 = wp.min(i + across[0], u.shape[0] - 1)
    j1 = wp.min(j + across[1], u.shape[1] - 1)
    k1 = wp.min(k + across[2], u.shape[2] - 1)
    inside0 = float((i - i0) + (j - j0) + (k - k0))
    inside1 = float((i1 - i) + (j1 - j) + (k1 - k))
    w0 = 0.5 * inside0 * (share[ci, cj, ck] + share[di, dj, dk])
    w1 = share[ci + across[0], cj + across[1], ck + across[2]] + share[di + across[0], dj + across[1], dk + across[2]]
    w1 = 0.5 * inside1 * w1
    total = w0 * u[i0, j0, k0] + w1 * u[i1, j1, k1]
    return total, w0 + w1 + (1.0 - inside0) * lower + (1.0 - inside1) * upper


@wp.struct
class Component:
    """Axes of a velocity component, and weights of the domain's sides: 2 for no-slip sides, else 0."""

    own: wp.vec3i
    first: wp.vec3i
    second: wp.vec3i
    first_lower: float
    first_upper: float
    second_lower: float
    second_upper: float


@wp.func
def _beside(walls: wp.array3d[float], along: wp.vec3i, across: wp.vec3i, i: int, j: int, k: int):
    """Returns the sum of `walls` over the four faces `across` the two cells of face (i, j, k), two on each side."""
    ci = wp.max(i - along[0], 0)
    cj = wp.max(j - along[1], 0)
    ck = wp.max(k - along[2], 0)
    di = wp.min(i, walls.shape[0] - across[0] - 1)
    dj = wp.min(j, walls.shape[1] - across[1] - 1)
    dk = wp.min(k, walls.shape[2] - across[2] - 1)
    lower = walls[ci, cj, ck] + walls[di, dj, dk]
    upper = walls[ci + across[0], cj + across[1], ck + across[2]]
    return lower + (upper + walls[di + across[0], dj + across[1], dk + across[2]])


@wp.kernel
def _measure_grip(
    rows: Rows,
    component: Component,
    first_friction: wp.array3d[float],
    second_friction: wp.array3d[float],
    grip_out: wp.array3d[float],
):
    """Grip: Σ w over the walls on both sides of a face, each half a cell away, w = 2 · mean friction."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, grip_out.shape[2])
    while k < end:
        first = _beside(first_friction, component.own, component.first, i, j, k)
        grip_out[i, j, k] = first + _beside(second_friction, component.own, component.second, i, j, k)
        k += 1


@wp.kernel
def _drag_faces(
    rows: Rows,
    component: Component,
    u: wp.array3d[float],
    first_pull: wp.array3d[float],
    second_pull: wp.array3d[float],
    r: float,
    u_out: wp.array3d[float],
):
    """u_out = u + r Σ w u_wall over the walls beside each face, w as in `_measure_grip`."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, u.shape[2])
    while k < end:
        first = _beside(first_pull, component.own, component.first, i, j, k)
        second = _beside(second_pull, component.own, component.second, i, j, k)
        u_out[i, j, k] = u[i, j, k] + r * (first + second)
        k += 1


@wp.kernel
def _sweep_faces(
    rows: Rows,
    component: Component,
    before: wp.array3d[float],
    u: wp.array3d[float],
    open_share: wp.array3d[float],
    first_share: wp.array3d[float],
    second_share: wp.array3d[float],
    grip: wp.array3d[float],
    r: float,
    u_out: wp.array3d[float],
):
    """u_out = (before + r Σ w u_nb) / (1 + r (Σ w + grip)) on open faces, u elsewhere.

    w = 1 along the component's own axis, where u is mirrored beyond open sides; else see `_exchange`.
    """
    i, j, c = wp.tid()
    i += rows.first
    a = component.own
    old = dense(before)
    src = dense(u)
    own = dense(open_share)
    share1 = dense(first_share)
    share2 = dense(second_share)
    walls = dense(grip)
    out = dense_store(u_out)
    last_i = u.shape[0] - 1
    last_j = u.shape[1] - 1
    last_k = u.shape[2] - 1
    i0 = wp.abs(i - a[0])
    j0 = wp.abs(j - a[1])
    i1 = last_i - wp.abs(last_i - i - a[0])
    j1 = last_j - wp.abs(last_j - j - a[1])
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, u.shape[2])
    while k < end:
        k0 = wp.abs(k - a[2])
        k1 = last_k - wp.abs(last_k - k - a[2])
        total1, weight1 = _exchange(
            src, share1, a, component.first, component.first_lower, component.first_upper, i, j, k
        )
        total2, weight2 = _exchange(
            src, share2, a, component.second, component.second_lower, component.second_upper, i, j, k
        )
        total = src[i0, j0, k0] + src[i1, j1, k1] + total1 + total2
        value = (old[i, j, k] + r * total) / (1.0 + r * (2.0 + weight1 + weight2 + walls[i, j, k]))
        out[i, j, k] = bits(wp.where(own[i, j, k] > 0.0, value, src[i, j, k]))
        k += 1


class JacobiDiffusion:
    """Approximate diffusion: as many sweeps as needed, but no more than the problem allows."""

    def __init__(self, launcher: Launcher, problem: DiffusionProblem):
        """Allocates.

        Args:
            launcher: where it runs.
            problem: the problem to solve.
        """
        self._launcher, self._problem, solids = launcher, problem, problem.solids
        halo = self._halo = Halo(launcher, problem.shape, problem.sides, 1) if "periodic" in problem.sides else None
        self._friction, self._pull = (solids.friction, solids.pull) if solids else (None, None)
        self._shares = self._own_shares = (solids.wx, solids.wy, solids.wz) if solids else self._open_shares()
        self._own_friction, self._own_pull, self._changes = self._friction, self._pull, None
        if halo:
            self._shares = tuple(halo.zeros("diffusion", axis) for axis in range(3))
            self._friction = self._friction and tuple(halo.zeros("diffusion", axis) for axis in range(3))
            self._pull = self._pull and {axes: halo.zeros("diffusion", axes[1]) for axes in self._pull}
        cells = halo.shape if halo else problem.shape
        shapes = {each: cells if each is None else face_shape(cells, each) for each in problem.fields}
        # Two arrays to sweep between, the grip of walls, the field with ghosts, and the field with the drag of walls.
        size, count = max(map(prod, shapes.values())), 3 + bool(halo) + bool(self._pull)
        rooms = [launcher.zeros(size, "diffusion") for _ in range(count)]
        self._rooms = {field: [each[: prod(shape)].reshape(shape) for each in rooms] for field, shape in shapes.items()}
        self._components = [_make_component(axis, problem.no_slip) for axis in range(3)]

    def _open_shares(self) -> tuple:
        problem = self._problem
        shares = tuple(self._launcher.zeros(face_shape(problem.shape, axis), "diffusion") for axis in range(3))
        fluid = self._launcher.zeros(problem.shape, "diffusion")
        fluid.fill_(1.0)
        open_faces(self._launcher, fluid, problem.sides, shares)
        return shares

    def _take_in_solids(self) -> None:
        """Copies the solids' face arrays to those with ghosts, if they have changed."""
        changes = self._problem.solids.changes if self._problem.solids else 0
        if self._halo and changes != self._changes:
            pairs = [(self._own_shares, self._shares)]
            if self._friction:
                pairs.append((self._own_friction, self._friction))
            for own, padded in pairs:
                for axis in range(3):
                    self._halo.pad(own[axis], padded[axis], axis)
            for (own, axis), padded in (self._pull or {}).items():
                self._halo.pad(self._own_pull[own, axis], padded, axis)
            self._changes = changes

    def diffuse(self, axis: int | None, field: wp.array, r: float) -> float:
        """Diffuses a field; see `DiffusionSolver.diffuse`."""
        if r == 0.0:
            return 0.0
        self._take_in_solids()
        shrinks = 6.0 * r / (1.0 + 6.0 * r)  # factor on the error in each sweep, or less
        most = self._problem.sweeps
        sweeps = most if shrinks == 1.0 else min(most, ceil(log(_ENOUGH) / log(shrinks)))
        target, other, grip, *rest = self._rooms[axis]
        source = before = self._halo.pad(field, rest[0], axis) if self._halo else field
        across = [a for a in range(3) if a != axis]
        if axis is not None and self._friction:
            walls = (self._friction[a] for a in across)
            self._launcher.launch(_measure_grip, source.shape, self._components[axis], *walls, grip)
        if axis is not None and self._pull:
            before, walls = rest[-1], (self._pull[axis, a] for a in across)
            self._launcher.launch(_drag_faces, source.shape, self._components[axis], source, *walls, r, before)
        for _ in range(sweeps):
            self._sweep(axis, before, source, grip, r, target)
            if self._halo:
                self._halo.fill(target, axis)
            source, target, other = target, other, target
        if self._halo:
            self._halo.crop(source, field)
        else:
            wp.copy(field, source)
        return shrinks**sweeps

    def _sweep(self, axis: int | None, before: wp.array, source: wp.array, grip: wp.array, r: float, target) -> None:
        if axis is None:
            self._launcher.launch(_sweep_cells, before.shape, before, source, *self._shares, r, target)
        else:
            across = (self._shares[a] for a in range(3) if a != axis)
            args = (self._components[axis], before, source, self._shares[axis], *across, grip, r, target)
            self._launcher.launch(_sweep_faces, before.shape, *args)


def _make_component(axis: int, no_slip: tuple[bool, ...]) -> Component:
    component = Component()
    first, second = (other for other in range(3) if other != axis)
    units = [wp.vec3i(*(int(a == b) for b in range(3))) for a in range(3)]
    component.own, component.first, component.second = units[axis], units[first], units[second]
    weights = [2.0 if sticks else 0.0 for sticks in no_slip]
    component.first_lower, component.first_upper = weights[2 * first : 2 * first + 2]
    component.second_lower, component.second_upper = weights[2 * second : 2 * second + 2]
    return component
