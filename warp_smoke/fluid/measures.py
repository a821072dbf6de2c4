"""Largest speed, kinetic energy, work of a force, largest departure from ambient: one number for an entire field.

Each launch item covers a block of rows and reduces it to one line along k, which LLVM vectorises; the host reduces the
lines. Sums are in float64 and in a fixed order, so they are the same for any number of threads.
"""

import numpy as np
import warp as wp

from warp_smoke.fluid.grid import Box
from warp_smoke.fluid.interpolation import greater
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})

# Departures from ambient below this share of a typical one are negligible.
_FAINT = 1e-4
_ROWS = wp.constant(8)


@wp.func
def _dense_double(a: wp.array3d[wp.float64]):
    """Like `dense`, for float64."""
    return wp.array(ptr=a.ptr, shape=(a.shape[0], a.shape[1], a.shape[2]), dtype=wp.float64)


@wp.kernel
def _measure_motion(
    rows: Rows,
    u: wp.array3d[float],
    v: wp.array3d[float],
    w: wp.array3d[float],
    speed_out: wp.array3d[float],
    energy_out: wp.array3d[wp.float64],
):
    """Motion: speed = max |u|, |v|, |w| and energy = ¼ Σ u² over the six faces of each cell, in a block of rows.

    Thus faces between cells count ½ u² and faces on the sides, half of whose volume is outside, ¼ u².
    """
    i, b, c = wp.tid()
    i += rows.first
    fu = dense(u)
    fv = dense(v)
    fw = dense(w)
    speed = dense(speed_out)
    energy = _dense_double(energy_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, speed_out.shape[2])
    k = start
    while k < end:
        speed[i, b, k] = 0.0
        energy[i, b, k] = wp.float64(0.0)
        k += 1
    j = b * _ROWS
    last = wp.min(j + _ROWS, v.shape[1] - 1)
    while j < last:
        k = start
        while k < end:
            u0 = fu[i, j, k]
            u1 = fu[i + 1, j, k]
            v0 = fv[i, j, k]
            v1 = fv[i, j + 1, k]
            w0 = fw[i, j, k]
            w1 = fw[i, j, k + 1]
            square = u0 * u0 + u1 * u1 + v0 * v0 + v1 * v1 + w0 * w0 + w1 * w1
            energy[i, b, k] = energy[i, b, k] + wp.float64(0.25 * square)
            fastest = greater(greater(wp.abs(u0), wp.abs(u1)), greater(wp.abs(v0), wp.abs(v1)))
            fastest = greater(fastest, greater(wp.abs(w0), wp.abs(w1)))
            speed[i, b, k] = greater(speed[i, b, k], fastest)
            k += 1
        j += 1


@wp.kernel
def _measure_departure(rows: Rows, a: wp.array3d[float], ambient: float, departure_out: wp.array3d[float]):
    """Largest: departure = max |a − ambient| in a block of rows; NaN if a has a NaN there."""
    i, b, c = wp.tid()
    i += rows.first
    src = dense(a)
    departure = dense(departure_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, a.shape[2])
    k = start
    while k < end:
        departure[i, b, k] = 0.0
        k += 1
    j = b * _ROWS
    last = wp.min(j + _ROWS, a.shape[1])
    while j < last:
        k = start
        while k < end:
            x = wp.abs(src[i, j, k] - ambient)
            y = departure[i, b, k]
            departure[i, b, k] = wp.where(y >= x, y, wp.where(y == y, x, y))
            k += 1
        j += 1


@wp.kernel
def _measure_work(
    rows: Rows,
    u: wp.array3d[float],
    v: wp.array3d[float],
    w: wp.array3d[float],
    fx: wp.array3d[float],
    fy: wp.array3d[float],
    fz: wp.array3d[float],
    power_out: wp.array3d[wp.float64],
    square_out: wp.array3d[wp.float64],
):
    """Work: power = Σ f · ½ (u₋ + u₊) and square = Σ |f|² in a block of rows."""
    i, b, c = wp.tid()
    i += rows.first
    fu = dense(u)
    fv = dense(v)
    fw = dense(w)
    gx = dense(fx)
    gy = dense(fy)
    gz = dense(fz)
    power = _dense_double(power_out)
    square = _dense_double(square_out)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, fx.shape[2])
    k = start
    while k < end:
        power[i, b, k] = wp.float64(0.0)
        square[i, b, k] = wp.float64(0.0)
        k += 1
    j = b * _ROWS
    last = wp.min(j + _ROWS, fx.shape[1])
    while j < last:
        k = start
        while k < end:
            x = gx[i, j, k]
            y = gy[i, j, k]
            z = gz[i, j, k]
            along = x * (fu[i, j, k] + fu[i + 1, j, k]) + y * (fv[i, j, k] + fv[i, j + 1, k])
            along += z * (fw[i, j, k] + fw[i, j, k + 1])
            power[i, b, k] = power[i, b, k] + wp.float64(0.5 * along)
            square[i, b, k] = square[i, b, k] + wp.float64(x * x + y * y + z * z)
            k += 1
        j += 1


class Measures:
    """Measures fields of one lattice."""

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int]):
        """Allocates.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz).
        """
        self._launcher, self._shape = launcher, shape
        self._lines = shape[0], -(-shape[1] // _ROWS), shape[2]
        self._largest = launcher.zeros(self._lines, "measures")
        self._sums = [launcher.zeros(self._lines, "measures", wp.float64) for _ in range(2)]

    def motion(self, velocity: tuple) -> tuple[float, float]:
        """Measures the largest |component| on any face [m/s], and the kinetic energy ½ Σ u² over the faces [m²/s²].

        Faces on the sides of the domain count half.

        Args:
            velocity: u, v, w on faces [m/s].
        """
        self._launcher.launch(_measure_motion, self._lines, *velocity, self._largest, self._sums[0])
        return float(self._largest.numpy().max()), float(self._sums[0].numpy().sum())

    def departure(self, scalar: wp.array, ambient: float) -> float:
        """Measures the largest |a − ambient|; NaN if the field contains one.

        Args:
            scalar: a, [nx, ny, nz].
            ambient: its value outside.
        """
        self._launcher.launch(_measure_departure, self._lines, scalar, ambient, self._largest)
        return float(self._largest.numpy().max())

    def fast_air(self, share: float) -> Box | None:
        """Returns the box of air that, at the last `motion`, was faster than a share of the fastest; None if at rest.

        The box is exact along i and k, and covers whole blocks of rows along j.

        Args:
            share: share of the largest |component|.
        """
        speed = self._largest.numpy()
        return self._box(speed > share * speed.max())

    def departed(self, scalar: wp.array, ambient: float, typical: float) -> Box | None:
        """Returns the box where |a − ambient| exceeds a ten-thousandth of a typical departure; None if nowhere.

        The box is exact along i and k, and covers whole blocks of rows along j.

        Args:
            scalar: a, [nx, ny, nz].
            ambient: its value outside.
            typical: typical departure; the field's largest departure is used if that is less.
        """
        most = self.departure(scalar, ambient)
        return self._box(self._largest.numpy() > _FAINT * min(typical, most))

    def _box(self, found: np.ndarray) -> Box | None:
        """Returns the box of cells around the lines that are set."""
        if not found.any():
            return None
        lower, upper = [], []
        for axis, (count, rows) in enumerate(zip(self._shape, (1, _ROWS, 1), strict=True)):
            lines = np.flatnonzero(found.any(axis=tuple(other for other in range(3) if other != axis)))
            lower.append(int(lines[0]) * rows)
            upper.append(min((int(lines[-1]) + 1) * rows, count))
        return Box(tuple(lower), tuple(upper))

    def work(self, velocity: tuple, force: tuple) -> tuple[float, float]:
        """Measures Σ f · u and Σ |f|² over the cells, where u is the mean of each cell's faces.

        Args:
            velocity: u, v, w on faces [m/s].
            force: acceleration f along x, y, z at cell centres, each [nx, ny, nz] [m/s²].
        """
        self._launcher.launch(_measure_work, self._lines, *velocity, *force, *self._sums)
        power, square = self._sums
        return float(power.numpy().sum()), float(square.numpy().sum())
