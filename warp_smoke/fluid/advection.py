"""Advection: each field carried along the traces of a step.

J. Stam, *Stable Fluids*, 1999 (semi-Lagrangian); A. Selle, R. Fedkiw, B. Kim, Y. Liu, J. Rossignac, *An
Unconditionally Stable MacCormack Method*, 2008 (with its two ways to keep the result within range).

Density and temperature that come in through an open side have ambient values: beyond it lies one layer of ambient
cells. Velocity there is that of the wind or, without wind, goes on as on the side. Through a closed side nothing comes:
traces end on it, and between it and the first cell centre a field is constant. A periodic side has no end: ghost cells
go on as the other end of the domain (`periodic_advection.py`).
"""

from math import inf, prod, sqrt

import warp as wp

from warp_smoke.fluid.grid import (
    Block,
    Box,
    Patch,
    all_cells,
    around,
    beside,
    box_of,
    common,
    face_shape,
    ghost_samples,
    inner_faces,
    patch_of,
    side_faces_from_within,
)
from warp_smoke.fluid.halo import copy_samples
from warp_smoke.fluid.interpolation import blend, corners, fraction, greater, lesser, sample, settle, within
from warp_smoke.fluid.runge_kutta import trace_back
from warp_smoke.fluid.solid_boundary import SolidBoundary
from warp_smoke.fluid.trace import trace_ahead, trace_limits
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.func
def end_of_trace(
    x0: wp.array3d[float],
    y0: wp.array3d[float],
    z0: wp.array3d[float],
    x1: wp.array3d[float],
    y1: wp.array3d[float],
    z1: wp.array3d[float],
    i: int,
    j: int,
    k: int,
    a: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
):
    """Where the trace of sample (i, j, k) ends among the samples of a, and how much of that lies inside of them.

    The displacement is the mean of those in the cells beside the sample; the end is kept within [lower, upper].
    """
    x = within(float(i) + 0.5 * (x0[i, j, k] + x1[i, j, k]), lower[0], upper[0])
    y = within(float(j) + 0.5 * (y0[i, j, k] + y1[i, j, k]), lower[1], upper[1])
    z = within(float(k) + 0.5 * (z0[i, j, k] + z1[i, j, k]), lower[2], upper[2])
    cx = within(x, 0.0, float(a.shape[0] - 1))
    cy = within(y, 0.0, float(a.shape[1] - 1))
    cz = within(z, 0.0, float(a.shape[2] - 1))
    return cx, cy, cz, (1.0 - wp.abs(x - cx)) * (1.0 - wp.abs(y - cy)) * (1.0 - wp.abs(z - cz))


@wp.kernel
def sample_back(
    rows: Rows,
    block: Block,
    dx: wp.array3d[float],
    dy: wp.array3d[float],
    dz: wp.array3d[float],
    a: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    ambient: float,
    a_out: wp.array3d[float],
):
    """Semi-Lagrangian: a_out(x) = a(x + d); one sample outside of a there is ambient."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    x0 = beside(dx, block.before)
    y0 = beside(dy, block.before)
    z0 = beside(dz, block.before)
    x1 = beside(dx, block.after)
    y1 = beside(dy, block.after)
    z1 = beside(dz, block.after)
    out = dense_store(a_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x, y, z, inside = end_of_trace(x0, y0, z0, x1, y1, z1, i, j, k, a, lower, upper)
        value = sample(a, x, y, z)
        out[i, j, k] = bits(settle(ambient + inside * (value - ambient)))
        k += 1


@wp.kernel
def _guess(
    rows: Rows,
    block: Block,
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
    """Like `sample_back`, with the range of the eight samples around x + d, or of a_out alone if that is outside."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    x0 = beside(dx, block.before)
    y0 = beside(dy, block.before)
    z0 = beside(dz, block.before)
    x1 = beside(dx, block.after)
    y1 = beside(dy, block.after)
    z1 = beside(dz, block.after)
    out = dense_store(a_out)
    least = dense_store(least_out)
    most = dense_store(most_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x, y, z, inside = end_of_trace(x0, y0, z0, x1, y1, z1, i, j, k, a, lower, upper)
        a000, a001, a010, a011, a100, a101, a110, a111 = corners(a, x, y, z)
        fx = fraction(x, a.shape[0])
        fy = fraction(y, a.shape[1])
        fz = fraction(z, a.shape[2])
        value = blend(a000, a001, a010, a011, a100, a101, a110, a111, fx, fy, fz)
        value = settle(ambient + inside * (value - ambient))
        low = lesser(lesser(lesser(a000, a001), lesser(a010, a011)), lesser(lesser(a100, a101), lesser(a110, a111)))
        high = greater(greater(a000, a001), greater(a010, a011))
        high = greater(high, greater(greater(a100, a101), greater(a110, a111)))
        out[i, j, k] = bits(value)
        least[i, j, k] = bits(wp.where(inside < 1.0, value, low))
        most[i, j, k] = bits(wp.where(inside < 1.0, value, high))
        k += 1


@wp.kernel
def _correct_within(
    rows: Rows,
    block: Block,
    ex: wp.array3d[float],
    ey: wp.array3d[float],
    ez: wp.array3d[float],
    a: wp.array3d[float],
    guess: wp.array3d[float],
    least: wp.array3d[float],
    most: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    a_out: wp.array3d[float],
):
    """MacCormack: a_out(x) = guess(x) + ½ (a(x) − guess(x + e)), kept within [least, most].

    The correction fades out as x + e leaves the samples.
    """
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    x0 = beside(ex, block.before)
    y0 = beside(ey, block.before)
    z0 = beside(ez, block.before)
    x1 = beside(ex, block.after)
    y1 = beside(ey, block.after)
    z1 = beside(ez, block.after)
    old = dense(a)
    new = dense(guess)
    low = dense(least)
    high = dense(most)
    out = dense_store(a_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x, y, z, inside = end_of_trace(x0, y0, z0, x1, y1, z1, i, j, k, guess, lower, upper)
        value = new[i, j, k] + 0.5 * inside * (old[i, j, k] - sample(guess, x, y, z))
        out[i, j, k] = bits(settle(within(value, low[i, j, k], high[i, j, k])))
        k += 1


@wp.kernel
def _correct_or_not(
    rows: Rows,
    block: Block,
    ex: wp.array3d[float],
    ey: wp.array3d[float],
    ez: wp.array3d[float],
    a: wp.array3d[float],
    guess: wp.array3d[float],
    least: wp.array3d[float],
    most: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    a_out: wp.array3d[float],
):
    """Like `_correct_within`, but a_out = guess where the correction would leave [least, most]."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    x0 = beside(ex, block.before)
    y0 = beside(ey, block.before)
    z0 = beside(ez, block.before)
    x1 = beside(ex, block.after)
    y1 = beside(ey, block.after)
    z1 = beside(ez, block.after)
    old = dense(a)
    new = dense(guess)
    low = dense(least)
    high = dense(most)
    out = dense_store(a_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x, y, z, inside = end_of_trace(x0, y0, z0, x1, y1, z1, i, j, k, guess, lower, upper)
        value = new[i, j, k] + 0.5 * inside * (old[i, j, k] - sample(guess, x, y, z))
        limited = within(value, low[i, j, k], high[i, j, k])
        out[i, j, k] = bits(settle(wp.where(limited == value, value, new[i, j, k])))
        k += 1


@wp.kernel
def _scale(rows: Rows, factor: float, u_inout: wp.array3d[float]):
    """Scaling: u = factor u."""
    i, j, c = wp.tid()
    i += rows.first
    u = dense(u_inout)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, u_inout.shape[2])
    while k < end:
        u[i, j, k] = factor * u[i, j, k]
        k += 1


class _Samples:
    """Where a field is sampled.

    Attributes:
        shape: of the field.
        carried: the samples that are carried: those between cells that are active; faces on the domain's sides are not.
        kept: the others within the domain, which stay as they are.
        few: whether fewer are carried than kept.
        continued: faces on open sides, which go on as the next face inside; then ghosts.
        thin: whether there is no face inside, in a domain one cell thick.
        clamped: first and last sample along each axis, lower and upper.
        limits: the same, but one sample farther out on open sides.
    """

    def __init__(self, cells: tuple, sides: tuple[str, ...], layers: tuple[int, int, int], axis: int | None):
        self.shape = cells if axis is None else face_shape(cells, axis)
        self.continued = [] if axis is None else side_faces_from_within(cells, sides, axis)
        self.continued += ghost_samples(cells, layers, axis)
        every = all_cells(cells) if axis is None else inner_faces(cells, axis)
        # Of the faces on a periodic side the first are carried, and the last are ghosts.
        own = Box(layers, tuple(n - g if g else m for n, g, m in zip(cells, layers, self.shape, strict=True)))
        self._inside = patch_of(common(box_of(every), own), every)
        self.carried, self.kept, self.few, self.thin = self._inside, [], False, 0 in self._inside.shape
        last = [n - 1 for n in self.shape]
        out = [int(side == "open") for side in sides]
        self.clamped = wp.vec3(0.0, 0.0, 0.0), wp.vec3(*last)
        self.limits = wp.vec3(*(-n for n in out[0::2])), wp.vec3(*(n + m for n, m in zip(last, out[1::2], strict=True)))

    def activate(self, cells: Box) -> None:
        """Carries those samples alone that lie in a box of cells, or between two of them."""
        inside, before = box_of(self._inside), tuple(self._inside.block.before)
        lower = tuple(max(a, b + step) for a, b, step in zip(inside.lower, cells.lower, before, strict=True))
        upper = (max(a, min(b, c)) for a, b, c in zip(lower, inside.upper, cells.upper, strict=True))
        active = Box(lower, tuple(upper))
        self.carried = patch_of(active, self._inside)
        self.kept = [patch_of(box, all_cells(self.shape)) for box in around(active, inside)]
        self.few = 2 * prod(self.carried.shape) < prod(self._inside.shape)

    @property
    def alone(self) -> Patch:
        """The carried samples, without the cells beside them."""
        return patch_of(box_of(self.carried), all_cells(self.shape))


class SemiLagrangian:
    """Order 1: each sample takes the value interpolated where its trace began."""

    _kernel = sample_back

    def __init__(
        self,
        launcher: Launcher,
        shape: tuple[int, int, int],
        sides: tuple[str, ...],
        boundary: SolidBoundary | None = None,
        trace: str = "rk2",
        layers: tuple[int, int, int] = (0, 0, 0),
    ):
        """Allocates.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz), ghosts among them.
            sides: open or closed for each of -x +x -y +y -z +z.
            boundary: of the colliders, or None.
            trace: one of `TRACES`.
            layers: of ghost cells at both ends of each axis.
        """
        self._launcher, self._boundary, self._scheme = launcher, boundary, trace
        self._trace_limits = trace_limits(shape, sides)
        self._traced = all_cells(shape)
        self._air = box_of(self._traced)
        self._cells = _Samples(shape, sides, layers, None)
        self._faces = tuple(_Samples(shape, sides, layers, axis) for axis in range(3))
        self._back = self._zeros([shape] * 3)
        self._spare = {samples: launcher.zeros(samples.shape, "advection") for samples in (self._cells, *self._faces)}

    def _zeros(self, shapes: list) -> list:
        return [self._launcher.zeros(shape, "advection") for shape in shapes]

    def activate(self, air: Box, smoke: Box) -> None:
        """Carries velocity in one box and scalars in another inside of it; elsewhere they stay as they are.

        Args:
            air: cells in which velocity is carried.
            smoke: cells in which scalars are.
        """
        self._cells.activate(smoke)
        if air != self._air:
            self._air, self._traced = air, patch_of(air, self._traced)
            for faces in self._faces:
                faces.activate(air)
            for displacement in self._displacements():
                displacement.zero_()

    def _displacements(self) -> list:
        """Of the traces, 0 where velocity is not carried."""
        return self._back

    def trace(self, velocity: tuple, step: float, courant: float = inf) -> None:
        """Traces through one step; what is advected next follows these traces.

        Args:
            velocity: u, v, w on faces [m/s], changed inside of solids.
            step: dt / h [s/m].
            courant: cells that air moves in the step, at most.
        """
        self._trace_back(velocity, step, courant)
        if self._boundary:
            self._boundary.stop(self._back, self._back)

    def _trace_back(self, velocity: tuple, step: float, courant: float) -> None:
        if self._boundary:
            self._boundary.follow(courant)
            self._boundary.extend(velocity)
        trace_back(self._launcher, self._scheme, self._traced, velocity, step, self._trace_limits, self._back)

    def advect_velocity(self, velocity: tuple, wind: tuple[float, float, float] | None = None) -> tuple:
        """Carries u, v, w; returns them, in other arrays or the given ones, and keeps the others for the next time.

        Args:
            velocity: u, v, w on faces [m/s].
            wind: velocity beyond open sides, along the lattice's axes [m/s]; None = it goes on as on the side.
        """
        if wind is None:
            return tuple(
                self._advect(faces, component, faces.clamped, 0.0)
                for faces, component in zip(self._faces, velocity, strict=True)
            )
        return tuple(
            self._advect(faces, component, faces.limits, speed)
            for faces, component, speed in zip(self._faces, velocity, wind, strict=True)
        )

    def advect_scalar(self, scalar: wp.array, ambient: float) -> wp.array:
        """Carries a field of the cells; returns it, in another array or the given one, and keeps the other.

        Args:
            scalar: [nx, ny, nz].
            ambient: its value outside of open sides.
        """
        return self._advect(self._cells, scalar, self._cells.limits, ambient)

    def _advect(self, samples: _Samples, field: wp.array, limits: tuple, ambient: float) -> wp.array:
        # Faces on closed sides are never written: they are 0 in the field and in the spare array.
        new = self._spare[samples]
        if samples.few:  # then it is less to copy them back than to copy the others
            self._carry(samples, field, limits, ambient, new)
            copy_samples(self._launcher, [samples.alone], new, field)
            self._continue(samples, field, field)
            return field
        self._keep(samples, field, new)
        self._carry(samples, field, limits, ambient, new)
        self._continue(samples, field, new)
        self._spare[samples] = field
        return new

    def _carry(self, samples: _Samples, field: wp.array, limits: tuple, ambient: float, new: wp.array) -> None:
        shape, block = samples.carried
        self._launcher.launch(self._kernel, shape, block, *self._back, field, *limits, ambient, new)
        if self._boundary and samples is self._cells:
            self._boundary.sample(self._back, field, limits, ambient, (new, new, new))

    def _keep(self, samples: _Samples, field: wp.array, new: wp.array) -> None:
        copy_samples(self._launcher, samples.kept, field, new)

    def _continue(self, samples: _Samples, field: wp.array, new: wp.array) -> None:
        # In a domain one cell thick there is no next face inside; those on its sides keep their velocity.
        copy_samples(self._launcher, samples.continued, field if samples.thin else new, new)


class MacCormack(SemiLagrangian):
    """Order 2: a semi-Lagrangian guess, less half of its error, which shows when the guess is carried back again.

    The result stays within the range of the samples around the place where the trace began: a scalar is clamped to it,
    which keeps it sharp; velocity falls back to its guess, for where it is clamped, noise feeds on the flow.
    """

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], *args, **options):
        """Allocates; arguments as for `SemiLagrangian`."""
        super().__init__(launcher, shape, *args, **options)
        self._ahead = self._zeros([shape] * 3)
        self._guess = {samples: launcher.zeros(samples.shape, "advection") for samples in self._spare}
        bounds = self._zeros([max(prod(samples.shape) for samples in self._spare)] * 2)
        self._bounds = {
            samples: [each[: prod(samples.shape)].reshape(samples.shape) for each in bounds] for samples in self._spare
        }

    def _displacements(self) -> list:
        return [*self._back, *self._ahead]

    def trace(self, velocity: tuple, step: float, courant: float = inf) -> None:
        """Traces through one step both ways."""
        self._trace_back(velocity, step, courant)
        trace_ahead(self._launcher, self._traced, velocity, step, self._trace_limits, self._back, self._ahead)
        if self._boundary:
            self._boundary.stop(self._back, self._ahead)

    def _carry(self, samples: _Samples, field: wp.array, limits: tuple, ambient: float, new: wp.array) -> None:
        self._keep(samples, field, self._guess[samples])
        self._make_guess(samples, field, limits, ambient)
        self._continue(samples, field, self._guess[samples])
        self._correct(samples, field, limits, new)

    def _make_guess(self, samples: _Samples, field: wp.array, limits: tuple, ambient: float) -> None:
        """The first-order guess, and the bounds of the result."""
        (shape, block), guess, bounds = samples.carried, self._guess[samples], self._bounds[samples]
        self._launcher.launch(_guess, shape, block, *self._back, field, *limits, ambient, guess, *bounds)
        if self._boundary and samples is self._cells:
            self._boundary.sample(self._back, field, limits, ambient, (guess, *bounds))

    def _correct(self, samples: _Samples, field: wp.array, limits: tuple, new: wp.array) -> None:
        """Makes the new field of the guess, within the bounds.

        Args:
            samples: where the field is sampled.
            field: the old one.
            limits: where traces back may end, for fields that go beyond open sides.
            new: written.
        """
        (shape, block), guess, bounds = samples.carried, self._guess[samples], self._bounds[samples]
        correct = _correct_within if samples is self._cells else _correct_or_not
        args = (*self._ahead, field, guess, *bounds, *samples.limits, new)
        self._launcher.launch(correct, shape, block, *args)


def limit_energy(launcher: Launcher, velocity: tuple, energy: float, most: float) -> None:
    """Slows the whole flow down if it has more kinetic energy than it may have: advection does no work.

    Args:
        launcher: where it runs.
        velocity: u, v, w on faces [m/s], changed.
        energy: kinetic energy of the velocity [m²/s²].
        most: that it may have [m²/s²].
    """
    if energy > most:
        for component in velocity:
            launcher.launch(_scale, component.shape, sqrt(most / energy), component)
