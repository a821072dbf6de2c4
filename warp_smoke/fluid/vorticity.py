"""Vorticity confinement, which restores swirls that advection has smoothed away, but adds no more energy than that.

R. Fedkiw, J. Stam, H. W. Jensen, *Visual Simulation of Smoke*, 2001, eqs. 9–11: f = ε h (N × ω), N = ∇|ω| / |∇|ω||.
"""

from math import hypot, sqrt

import warp as wp

from warp_smoke.fluid.forces import accelerate
from warp_smoke.fluid.grid import inner_faces, seam_faces
from warp_smoke.fluid.halo import Halo
from warp_smoke.fluid.measures import Measures
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})

# Ghosts that the force needs: it is a gradient of differences.
_REACH = 2


@wp.func
def _inverse_width(lower: int, upper: int, h: float):
    """Returns 1 / (2 distance between two cells' centres); 0 if they are the same cell."""
    return wp.where(upper > lower, 0.5 / (float(upper - lower) * h), 0.0)


@wp.func
def _curl(
    u: wp.array3d[float], v: wp.array3d[float], w: wp.array3d[float], h: float, i: int, j: int, k: int, k0: int, k1: int
):
    """Returns ∇ × u at a cell from differences of its neighbours' mean velocities; k0 and k1 are those along k."""
    fu = dense(u)
    fv = dense(v)
    fw = dense(w)
    i0 = wp.max(i - 1, 0)
    j0 = wp.max(j - 1, 0)
    i1 = wp.min(i + 1, v.shape[0] - 1)
    j1 = wp.min(j + 1, u.shape[1] - 1)
    x = _inverse_width(i0, i1, h)
    y = _inverse_width(j0, j1, h)
    z = _inverse_width(k0, k1, h)
    wy = (fw[i, j1, k] + fw[i, j1, k + 1]) - (fw[i, j0, k] + fw[i, j0, k + 1])
    vz = (fv[i, j, k1] + fv[i, j + 1, k1]) - (fv[i, j, k0] + fv[i, j + 1, k0])
    uz = (fu[i, j, k1] + fu[i + 1, j, k1]) - (fu[i, j, k0] + fu[i + 1, j, k0])
    wx = (fw[i1, j, k] + fw[i1, j, k + 1]) - (fw[i0, j, k] + fw[i0, j, k + 1])
    vx = (fv[i1, j, k] + fv[i1, j + 1, k]) - (fv[i0, j, k] + fv[i0, j + 1, k])
    uy = (fu[i, j1, k] + fu[i + 1, j1, k]) - (fu[i, j0, k] + fu[i + 1, j0, k])
    return y * wy - z * vz, z * uz - x * wx, x * vx - y * uy


@wp.kernel
def _measure_vorticity(
    rows: Rows,
    u: wp.array3d[float],
    v: wp.array3d[float],
    w: wp.array3d[float],
    h: float,
    x_out: wp.array3d[float],
    y_out: wp.array3d[float],
    z_out: wp.array3d[float],
    size_out: wp.array3d[float],
):
    """(x, y, z) = ∇ × u and size = |∇ × u|, by central differences; one-sided in the outermost cells."""
    i, j, c = wp.tid()
    i += rows.first
    ox = dense_store(x_out)
    oy = dense_store(y_out)
    oz = dense_store(z_out)
    size = dense_store(size_out)
    nz = size_out.shape[2]
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, nz)
    # The ends of a row are separate: with clamped neighbours in the loop it would not be vectorised.
    if k == 0:
        x, y, z = _curl(u, v, w, h, i, j, 0, 0, wp.min(1, nz - 1))
        ox[i, j, 0] = bits(x)
        oy[i, j, 0] = bits(y)
        oz[i, j, 0] = bits(z)
        size[i, j, 0] = bits(wp.sqrt(x * x + y * y + z * z))
    if end == nz and nz > 1:
        n = nz - 1
        x, y, z = _curl(u, v, w, h, i, j, n, n - 1, n)
        ox[i, j, n] = bits(x)
        oy[i, j, n] = bits(y)
        oz[i, j, n] = bits(z)
        size[i, j, n] = bits(wp.sqrt(x * x + y * y + z * z))
    k = wp.max(k, 1)
    end = wp.min(end, nz - 1)
    while k < end:
        x, y, z = _curl(u, v, w, h, i, j, k, k - 1, k + 1)
        ox[i, j, k] = bits(x)
        oy[i, j, k] = bits(y)
        oz[i, j, k] = bits(z)
        size[i, j, k] = bits(wp.sqrt(x * x + y * y + z * z))
        k += 1


@wp.kernel
def _confine(
    rows: Rows,
    size: wp.array3d[float],
    strength: float,
    x_inout: wp.array3d[float],
    y_inout: wp.array3d[float],
    z_inout: wp.array3d[float],
):
    """ω = (x, y, z) becomes strength (N × ω), N = g / |g|, g = ∇|ω|; 0 where g = 0 and in the outermost cells."""
    i, j, c = wp.tid()
    i += rows.first
    a = dense(size)
    x = dense(x_inout)
    y = dense(y_inout)
    z = dense(z_inout)
    start = wp.max(c * rows.run, 0)
    end = wp.min(start + rows.run, size.shape[2])
    first = wp.max(start, 1)
    last = wp.min(end, size.shape[2] - 1)
    if i == 0 or i == size.shape[0] - 1 or j == 0 or j == size.shape[1] - 1:
        last = first
    k = first
    while k < last:
        gx = a[i + 1, j, k] - a[i - 1, j, k]
        gy = a[i, j + 1, k] - a[i, j - 1, k]
        gz = a[i, j, k + 1] - a[i, j, k - 1]
        square = gx * gx + gy * gy + gz * gz
        scale = wp.where(square > 0.0, strength / wp.sqrt(square), 0.0)
        ox = x[i, j, k]
        oy = y[i, j, k]
        oz = z[i, j, k]
        x[i, j, k] = scale * (gy * oz - gz * oy)
        y[i, j, k] = scale * (gz * ox - gx * oz)
        z[i, j, k] = scale * (gx * oy - gy * ox)
        k += 1
    k = start
    while k < end:
        if k < first or k >= last:
            x[i, j, k] = 0.0
            y[i, j, k] = 0.0
            z[i, j, k] = 0.0
        k += 1


def measure_vorticity(launcher: Launcher, velocity: tuple, h: float, vorticity: tuple, size: wp.array) -> None:
    """Computes the vorticity ω = ∇ × u at cell centres; exact for velocities that are linear in space.

    Args:
        launcher: where it runs.
        velocity: u, v, w on faces [m/s].
        h: side of a cell [m].
        vorticity: ω along x, y, z, each [nx, ny, nz] [1/s], written.
        size: |ω|, [nx, ny, nz] [1/s], written.
    """
    launcher.launch(_measure_vorticity, size.shape, *velocity, h, *vorticity, size)


def capped_scale(work: float, square: float, cap: float) -> float:
    """Returns the largest s in [0, 1] with s · work + s² · square ≤ cap.

    Args:
        work: A, first-order gain of energy.
        square: B ≥ 0, second-order gain of energy.
        cap: limit of the gain, ≥ 0.
    """
    if work + square <= cap:
        return 1.0
    # The positive root of B s² + A s − cap, in the form without cancellation.
    root = hypot(work, 2.0 * sqrt(square) * sqrt(cap))
    scale = 2.0 * cap / (work + root) if work > 0.0 else (root - work) / (2.0 * square)
    return min(scale, 1.0)


class VorticityConfinement:
    """Confinement of strength ε that never adds more kinetic energy than allowed."""

    def __init__(
        self, launcher: Launcher, shape: tuple[int, int, int], sides: tuple[str, ...], h: float, measures: Measures
    ):
        """Allocates.

        Args:
            launcher: where it runs.
            shape: cells along each axis (nx, ny, nz).
            sides: open, closed or periodic for each of -x +x -y +y -z +z.
            h: side of a cell [m].
            measures: measures on the same lattice.
        """
        self._launcher, self._h, self._measures = launcher, h, measures
        self._force = self._inner_force = tuple(launcher.zeros(shape, "vorticity") for _ in range(3))
        self._size = launcher.zeros(shape, "vorticity")
        self._patches = [[inner_faces(shape, axis), *seam_faces(shape, sides, axis)] for axis in range(3)]
        self._halo = None
        if "periodic" in sides:
            halo = self._halo = Halo(launcher, shape, sides, _REACH)
            self._force, self._size = tuple(halo.zeros("vorticity") for _ in range(3)), halo.zeros("vorticity")
            self._padded = tuple(halo.zeros("vorticity", axis) for axis in range(3))

    def add(self, velocity: tuple, strength: float, dt: float, cap: float) -> float:
        """Adds s dt ε h (N × ω) with the largest s ≤ 1 that keeps the gain of kinetic energy within the cap.

        With f_face = ½ (f₋ + f₊), Σ_faces f_face² ≤ Σ_cells |f|²: the gain may stay below the cap but never exceeds it.

        Args:
            velocity: u, v, w on faces [m/s], changed.
            strength: ε.
            dt: [s].
            cap: largest gain of ½ Σ u² over the faces [m²/s²].

        Returns:
            s.
        """
        self._measure_force(velocity, strength)
        power, square = self._measures.work(velocity, self._inner_force)
        scale = capped_scale(dt * power, 0.5 * dt * dt * square, cap)
        for component, patches, force in zip(velocity, self._patches, self._inner_force, strict=True):
            accelerate(self._launcher, patches, force, 0.0, scale * dt, component)
        return scale

    def _measure_force(self, velocity: tuple, strength: float) -> None:
        """Computes the force ε h (N × ω) in the cells of the domain."""
        if self._halo:
            for axis, (component, padded) in enumerate(zip(velocity, self._padded, strict=True)):
                self._halo.pad(component, padded, axis)
            velocity = self._padded
        measure_vorticity(self._launcher, velocity, self._h, self._force, self._size)
        self._launcher.launch(_confine, self._size.shape, self._size, strength * self._h, *self._force)
        if self._halo:
            for padded, force in zip(self._force, self._inner_force, strict=True):
                self._halo.crop(padded, force)
