"""Advection: each field carried along the traces of a step.

J. Stam, *Stable Fluids*, 1999 (semi-Lagrangian); A. Selle, R. Fedkiw, B. Kim, Y. Liu, J. Rossignac, *An
Unconditionally Stable MacCormack Method*, 2008 (eqs. 10–12 and the clamp of section 3).

Density and temperature that come in through an open side have ambient values: beyond it lies one layer of ambient
cells. Velocity there goes on as on the side. Through a closed side nothing comes: traces end on it, and between it and
the first cell centre a field is constant.
"""

from math import prod

import warp as wp

from warp_smoke.fluid.grid import Block, Patch, beside, cell_patches, face_patches, face_shape
from warp_smoke.fluid.interpolation import blend, corners, fraction, greater, lesser, sample, within
from warp_smoke.fluid.trace import trace_ahead, trace_back, trace_limits
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _sample_back(
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
    """Semi-Lagrangian: a_out(x) = a(x + d), d the mean of the cells beside x, x + d kept within [lower, upper].

    One sample outside of a there is ambient.
    """
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
    last_x = float(a.shape[0] - 1)
    last_y = float(a.shape[1] - 1)
    last_z = float(a.shape[2] - 1)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x = within(float(i) + 0.5 * (x0[i, j, k] + x1[i, j, k]), lower[0], upper[0])
        y = within(float(j) + 0.5 * (y0[i, j, k] + y1[i, j, k]), lower[1], upper[1])
        z = within(float(k) + 0.5 * (z0[i, j, k] + z1[i, j, k]), lower[2], upper[2])
        cx = within(x, 0.0, last_x)
        cy = within(y, 0.0, last_y)
        cz = within(z, 0.0, last_z)
        inside = (1.0 - wp.abs(x - cx)) * (1.0 - wp.abs(y - cy)) * (1.0 - wp.abs(z - cz))
        value = sample(a, cx, cy, cz)
        out[i, j, k] = bits(ambient + inside * (value - ambient))
        k += 1


@wp.kernel
def _predict(
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
    """Like `_sample_back`, with the range of the eight samples around x + d, or of a_out alone if that is outside."""
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
    last_x = float(a.shape[0] - 1)
    last_y = float(a.shape[1] - 1)
    last_z = float(a.shape[2] - 1)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x = within(float(i) + 0.5 * (x0[i, j, k] + x1[i, j, k]), lower[0], upper[0])
        y = within(float(j) + 0.5 * (y0[i, j, k] + y1[i, j, k]), lower[1], upper[1])
        z = within(float(k) + 0.5 * (z0[i, j, k] + z1[i, j, k]), lower[2], upper[2])
        cx = within(x, 0.0, last_x)
        cy = within(y, 0.0, last_y)
        cz = within(z, 0.0, last_z)
        inside = (1.0 - wp.abs(x - cx)) * (1.0 - wp.abs(y - cy)) * (1.0 - wp.abs(z - cz))
        a000, a001, a010, a011, a100, a101, a110, a111 = corners(a, cx, cy, cz)
        fx = fraction(cx, a.shape[0])
        fy = fraction(cy, a.shape[1])
        fz = fraction(cz, a.shape[2])
        value = blend(a000, a001, a010, a011, a100, a101, a110, a111, fx, fy, fz)
        value = ambient + inside * (value - ambient)
        low = lesser(lesser(lesser(a000, a001), lesser(a010, a011)), lesser(lesser(a100, a101), lesser(a110, a111)))
        high = greater(greater(a000, a001), greater(a010, a011))
        high = greater(high, greater(greater(a100, a101), greater(a110, a111)))
        out[i, j, k] = bits(value)
        least[i, j, k] = bits(wp.where(inside < 1.0, value, low))
        most[i, j, k] = bits(wp.where(inside < 1.0, value, high))
        k += 1


@wp.kernel
def _correct(
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
    last_x = float(guess.shape[0] - 1)
    last_y = float(guess.shape[1] - 1)
    last_z = float(guess.shape[2] - 1)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x = within(float(i) + 0.5 * (x0[i, j, k] + x1[i, j, k]), lower[0], upper[0])
        y = within(float(j) + 0.5 * (y0[i, j, k] + y1[i, j, k]), lower[1], upper[1])
        z = within(float(k) + 0.5 * (z0[i, j, k] + z1[i, j, k]), lower[2], upper[2])
        cx = within(x, 0.0, last_x)
        cy = within(y, 0.0, last_y)
        cz = within(z, 0.0, last_z)
        inside = (1.0 - wp.abs(x - cx)) * (1.0 - wp.abs(y - cy)) * (1.0 - wp.abs(z - cz))
        value = new[i, j, k] + 0.5 * inside * (old[i, j, k] - sample(guess, cx, cy, cz))
        out[i, j, k] = bits(within(value, low[i, j, k], high[i, j, k]))
        k += 1


class _Samples:
    """Where a field is sampled.

    Attributes:
        shape: of the field.
        patches: blocks of samples that are carried; faces of closed sides are not.
        clamped: first and last sample along each axis, lower and upper.
        limits: the same, but one sample farther out on open sides.
    """

    def __init__(self, shape: tuple[int, int, int], sides: tuple[str, ...], patches: list[Patch]):
        self.shape, self.patches = shape, patches
        last = [n - 1 for n in shape]
        out = [int(side == "open") for side in sides]
        self.clamped = wp.vec3(0.0, 0.0, 0.0), wp.vec3(*last)
        self.limits = wp.vec3(*(-n for n in out[0::2])), wp.vec3(*(n + m for n, m in zip(last, out[1::2], strict=True)))


class SemiLagrangian:
    """Order 1: each sample takes the value interpolated where its trace began."""

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], sides: tuple[str, ...]):
        """Allocates.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz).
            sides: open or closed for each of -x +x -y +y -z +z.
        """
        self._launcher = launcher
        self._trace_limits = trace_limits(shape, sides)
        self._back = self._zeros([shape] * 3)
        # u, v, w, and the cells.
        faces = ((face_shape(shape, axis), face_patches(shape, sides, axis)) for axis in range(3))
        self._samples = [_Samples(each, sides, patches) for each, patches in (*faces, (shape, cell_patches(shape)))]
        self._spare = self._zeros([samples.shape for samples in self._samples])

    def _zeros(self, shapes: list) -> list:
        return [self._launcher.zeros(shape, "advection") for shape in shapes]

    def trace(self, velocity: tuple, step: float) -> None:
        """Traces through one step; what is advected next follows these traces.

        Args:
            velocity: u, v, w on faces [m/s].
            step: dt / h [s/m].
        """
        trace_back(self._launcher, velocity, step, self._trace_limits, self._back)

    def advect_velocity(self, velocity: tuple) -> tuple:
        """Carries u, v, w; returns them in other arrays, and keeps the given ones for the next time."""
        return tuple(self._advect(n, each, self._samples[n].clamped, 0.0) for n, each in enumerate(velocity))

    def advect_scalar(self, scalar: wp.array, ambient: float) -> wp.array:
        """Carries a field of the cells; returns it in another array, and keeps the given one for the next time.

        Args:
            scalar: [nx, ny, nz].
            ambient: its value outside of open sides.
        """
        return self._advect(3, scalar, self._samples[3].limits, ambient)

    def _advect(self, n: int, field: wp.array, limits: tuple, ambient: float) -> wp.array:
        # Faces on closed sides are never written: they are 0 in the field and in the spare array.
        new = self._spare[n]
        for shape, block in self._samples[n].patches:
            self._launcher.launch(_sample_back, shape, block, *self._back, field, *limits, ambient, new)
        self._spare[n] = field
        return new


class MacCormack(SemiLagrangian):
    """Order 2: a semi-Lagrangian guess, less half of its error, which shows when the guess is carried back again.

    The result stays within the range of the samples around the place where the trace began.
    """

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], sides: tuple[str, ...]):
        """Allocates; arguments as for `SemiLagrangian`."""
        super().__init__(launcher, shape, sides)
        shapes = [samples.shape for samples in self._samples]
        self._ahead = self._zeros([shape] * 3)
        self._guess = self._zeros(shapes)
        bounds = self._zeros([max(map(prod, shapes))] * 2)
        self._bounds = [[each[: prod(shape)].reshape(shape) for each in bounds] for shape in shapes]

    def trace(self, velocity: tuple, step: float) -> None:
        """Traces through one step both ways."""
        super().trace(velocity, step)
        trace_ahead(self._launcher, velocity, step, self._trace_limits, self._back, self._ahead)

    def _advect(self, n: int, field: wp.array, limits: tuple, ambient: float) -> wp.array:
        samples, new, guess, bounds = self._samples[n], self._spare[n], self._guess[n], self._bounds[n]
        for shape, block in samples.patches:
            self._launcher.launch(_predict, shape, block, *self._back, field, *limits, ambient, guess, *bounds)
        for shape, block in samples.patches:
            args = (*self._ahead, field, guess, *bounds, *samples.limits, new)
            self._launcher.launch(_correct, shape, block, *args)
        self._spare[n] = field
        return new


# All fields of a domain are carried by the same scheme.
ADVECTION_SCHEMES = {"semi_lagrangian": SemiLagrangian, "maccormack": MacCormack}
