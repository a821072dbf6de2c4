"""Turbulence: a force without divergence that stirs all air, the curl of noise.

R. Bridson, J. Hourihan, M. Nordenstam, *Curl-Noise for Procedural Fluid Flow*, 2007. The potential's components are
Perlin noise in space and time on the edges of the cells, so the curl on their faces is free of divergence to round-off,
and pressure takes none of it away.
"""

from math import sqrt

import warp as wp

from warp_smoke.fluid.grid import beside
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})

# Root mean square of the curl of three of Warp's noises, with features of size 1: measured 1.007 over time.
_MEAN_CURL = 1.0
# Largest component, as a multiple of it: measured 3.1.
PEAK = 4.0


@wp.kernel
def _fill_potential(rows: Rows, seed: int, middle: wp.vec3, scale: float, time: float, a_out: wp.array3d[float]):
    """Noise: a = n((x + middle) / scale, time) at x = (i, j, k)."""
    i, j, c = wp.tid()
    i += rows.first
    out = dense_store(a_out)
    state = wp.rand_init(seed)
    x = (float(i) + middle[0]) / scale
    y = (float(j) + middle[1]) / scale
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, a_out.shape[2])
    while k < end:
        z = (float(k) + middle[2]) / scale
        out[i, j, k] = bits(wp.noise(state, wp.vec4(x, y, z, time)))
        k += 1


@wp.kernel
def _stir(
    rows: Rows,
    first: wp.vec3i,
    second: wp.vec3i,
    b: wp.array3d[float],
    c: wp.array3d[float],
    strength: float,
    u_inout: wp.array3d[float],
):
    """Curl: u += strength ((c(x + first) − c(x)) − (b(x + second) − b(x))), first and second the next axes in turn."""
    i, j, n = wp.tid()
    i += rows.first
    b0 = dense(b)
    c0 = dense(c)
    b1 = beside(b, -second)
    c1 = beside(c, -first)
    u = dense(u_inout)
    k = wp.max(n * rows.run, 0)
    end = wp.min(k + rows.run, u_inout.shape[2])
    while k < end:
        u[i, j, k] = u[i, j, k] + strength * ((c1[i, j, k] - c0[i, j, k]) - (b1[i, j, k] - b0[i, j, k]))
        k += 1


class Turbulence:
    """The force in one domain."""

    def __init__(self, launcher: Launcher, lattice: Lattice, strength: float, scale: float | None):
        """Allocates.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            strength: root mean square of the acceleration [m/s²].
            scale: size of the eddies [m]; None = an eighth of the domain's longest side.
        """
        self._launcher, self._strength = launcher, strength
        longest = max(lattice.shape)
        self._scale = scale / lattice.h if scale else longest / 8.0  # in cells
        # An eddy changes in the time in which the force moves air across it.
        self._lasts = sqrt(self._scale * lattice.h / strength)
        corners = tuple(n + 1 for n in lattice.shape)
        self._potential = tuple(launcher.zeros(corners, "turbulence") for _ in range(3))
        self._axes = [wp.vec3i(*(int(a == axis) for a in range(3))) for axis in range(3)]

    def add(self, velocity: tuple, time: float, dt: float) -> None:
        """Adds dt times the force.

        Args:
            velocity: u, v, w on faces [m/s], changed.
            time: of the smoke [s].
            dt: [s].
        """
        for axis, potential in enumerate(self._potential):
            middle = wp.vec3(*(0.5 * (a == axis) for a in range(3)))
            args = (axis, middle, self._scale, time / self._lasts, potential)
            self._launcher.launch(_fill_potential, potential.shape, *args)
        strength = self._strength * dt * self._scale / _MEAN_CURL
        for axis, component in enumerate(velocity):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            args = (self._axes[b], self._axes[c], self._potential[b], self._potential[c], strength, component)
            self._launcher.launch(_stir, component.shape, *args)
