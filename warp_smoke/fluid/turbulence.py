"""Turbulence: a divergence-free force, the curl of noise, that stirs all air or the air inside emitters.

R. Bridson, J. Hourihan, M. Nordenstam, *Curl-Noise for Procedural Fluid Flow*, 2007. The potential's components are
gradient noise (K. Perlin, *Improving Noise*, 2002) on the edges of the cells, so the curl on their faces is
divergence-free to round-off, and the pressure removes none of it. Over time the gradients rotate (K. Perlin, F. Neyret,
*Flow Noise*, 2001), each about its own axis and at its own speed.

The noise's nodes are an eddy apart, so gradients are few. A row of cells needs only the ramps of the four lines of
nodes around it, blended across the row: n = lerp(a_m + b_m f, a_(m+1) + b_(m+1) (f − 1), fade(f)), where f is the
position along the row from node m to the next.
"""

from math import sqrt

import numpy as np
import warp as wp

from warp_smoke.fluid.eddies import place_eddies
from warp_smoke.fluid.emitters import Source, inside
from warp_smoke.fluid.grid import Block, beside
from warp_smoke.fluid.halo import join_seams
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})

# Root mean square of the curl of three such noises with nodes 1 apart: measured on 8³ eddies at 60 times.
_MEAN_CURL = 1.204
# Bound on the largest component, as a multiple of the root mean square: measured 2.9.
PEAK = 4.0
# Standard deviation of the turning speeds: after one lifetime an eddy's correlation with its past is e^(−2²/2) = 14 %.
_MEAN_SPIN = wp.constant(2.0)


@wp.kernel
def _draw_gradients(
    rows: Rows,
    seed: int,
    first_out: wp.array3d[wp.vec3],
    second_out: wp.array3d[wp.vec3],
    spin_out: wp.array3d[float],
):
    """Draws two perpendicular unit vectors and a speed for each node, independent of the number of nodes."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, spin_out.shape[2])
    while k < end:
        state = wp.rand_init(seed, (i * 1024 + j) * 1024 + k)
        first = wp.sample_unit_sphere_surface(state)
        axis = wp.sample_unit_sphere_surface(state)
        first_out[i, j, k] = first
        second_out[i, j, k] = wp.normalize(wp.cross(first, axis))
        spin_out[i, j, k] = _MEAN_SPIN * wp.randn(state)
        k += 1


@wp.kernel
def _turn_gradients(
    rows: Rows,
    first: wp.array3d[wp.vec3],
    second: wp.array3d[wp.vec3],
    spin: wp.array3d[float],
    time: float,
    gradient_out: wp.array3d[wp.vec3],
):
    """Rotation: g = cos(ω t) first + sin(ω t) second."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, spin.shape[2])
    while k < end:
        angle = spin[i, j, k] * time
        gradient_out[i, j, k] = wp.cos(angle) * first[i, j, k] + wp.sin(angle) * second[i, j, k]
        k += 1


@wp.func
def _fade(t: float):
    """Returns the weight of the next node, 0 to 1: 6 t⁵ − 15 t⁴ + 10 t³."""
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)


@wp.kernel
def _blend_across(
    rows: Rows,
    gradient: wp.array3d[wp.vec3],
    middle: wp.vec3,
    scale: wp.vec3,
    a_out: wp.array3d[float],
    b_out: wp.array3d[float],
):
    """Blend: a = Σ w (g_x x + g_y y), b = Σ w g_z over the four nodes k around row (i, j), (x, y) from node to row."""
    i, j, c = wp.tid()
    i += rows.first
    x = (float(i) + middle[0]) / scale[0]
    y = (float(j) + middle[1]) / scale[1]
    ni = int(x)
    nj = int(y)
    x -= float(ni)
    y -= float(nj)
    u = _fade(x)
    v = _fade(y)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, a_out.shape[2])
    while k < end:
        g00 = gradient[ni, nj, k]
        g01 = gradient[ni, nj + 1, k]
        g10 = gradient[ni + 1, nj, k]
        g11 = gradient[ni + 1, nj + 1, k]
        a0 = wp.lerp(g00[0] * x + g00[1] * y, g01[0] * x + g01[1] * (y - 1.0), v)
        a1 = wp.lerp(g10[0] * (x - 1.0) + g10[1] * y, g11[0] * (x - 1.0) + g11[1] * (y - 1.0), v)
        a_out[i, j, k] = wp.lerp(a0, a1, u)
        b_out[i, j, k] = wp.lerp(wp.lerp(g00[2], g01[2], v), wp.lerp(g10[2], g11[2], v), u)
        k += 1


@wp.kernel
def _fill_potential(
    rows: Rows, a: wp.array3d[float], b: wp.array3d[float], middle: float, scale: float, n_out: wp.array3d[float]
):
    """Noise along rows: n = lerp(a_m + b_m f, a_(m+1) + b_(m+1) (f − 1), fade(f)), m + f = (k + middle) / scale."""
    i, j, c = wp.tid()
    i += rows.first
    ramp = dense(a)
    slope = dense(b)
    out = dense_store(n_out)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, n_out.shape[2])
    while k < end:
        z = (float(k) + middle) / scale
        m = int(z)
        f = z - float(m)
        before = ramp[i, j, m] + slope[i, j, m] * f
        after = ramp[i, j, m + 1] + slope[i, j, m + 1] * (f - 1.0)
        out[i, j, k] = bits(before + _fade(f) * (after - before))
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
    """Curl: u += strength ((c(x + first) − c(x)) − (b(x + second) − b(x))), the next two axes in cyclic order."""
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


@wp.kernel
def _stir_inside(
    rows: Rows,
    faces: Block,
    lower: wp.vec3i,
    fraction: wp.array3d[float],
    first: wp.vec3i,
    second: wp.vec3i,
    b: wp.array3d[float],
    c: wp.array3d[float],
    strength: float,
    u_inout: wp.array3d[float],
):
    """Curl as in `_stir`, times the mean inside share of the face's two cells."""
    i, j, n = wp.tid()
    i += rows.first + faces.first[0]
    j += faces.first[1]
    k = wp.max(faces.first[2] + n * rows.run, 0)
    end = wp.min(k + rows.run, faces.stop)
    while k < end:
        before = inside(fraction, i - faces.before[0], j - faces.before[1], k - faces.before[2])
        share = 0.5 * (before + inside(fraction, i, j, k))
        x = lower[0] + i
        y = lower[1] + j
        z = lower[2] + k
        curl = c[x + first[0], y + first[1], z + first[2]] - c[x, y, z]
        curl -= b[x + second[0], y + second[1], z + second[2]] - b[x, y, z]
        u_inout[x, y, z] = u_inout[x, y, z] + share * strength * curl
        k += 1


class Turbulence:
    """The force in one domain."""

    def __init__(self, launcher: Launcher, lattice: Lattice, strength: float, scale: float | None):
        """Allocates.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            strength: root mean square of the acceleration [m/s²]; its largest value if it varies.
            scale: size of the eddies [m], at least two cells; None = an eighth of the domain's longest side.
        """
        self._launcher = launcher
        eddies = place_eddies(lattice, scale)
        self._scale, self._rings = eddies.scale, eddies.rings
        # An eddy changes over the time in which the force moves air across it.
        self._lasts = sqrt(self._scale * lattice.h / strength)
        self._place, self._scales = (lattice.shape, lattice.sides), wp.vec3(*eddies.spacing)
        corners, nodes = tuple(n + 1 for n in lattice.shape), eddies.nodes
        self._potential = tuple(launcher.zeros(corners, "turbulence") for _ in range(3))
        self._ramps = [launcher.zeros((*corners[:2], nodes[2]), "turbulence") for _ in range(2)]
        self._gradient = launcher.zeros(nodes, "turbulence", wp.vec3)
        self._drawn = [self._draw(axis, nodes) for axis in range(3)]
        self._axes = [wp.vec3i(*(int(a == axis) for a in range(3))) for axis in range(3)]

    def _draw(self, seed: int, nodes: tuple[int, int, int]) -> tuple:
        """Draws the two vectors and the speed of each gradient of one component."""
        first, second = (self._launcher.zeros(nodes, "turbulence", wp.vec3) for _ in range(2))
        spin = self._launcher.zeros(nodes, "turbulence")
        self._launcher.launch(_draw_gradients, nodes, seed, first, second, spin)
        if any(self._rings):
            again = np.ix_(*(np.arange(n) % (m or n) for n, m in zip(nodes, self._rings, strict=True)))
            for drawn in (first, second, spin):
                drawn.assign(drawn.numpy()[again])
        return first, second, spin

    def turn(self, time: float) -> None:
        """Makes the noise for a time.

        Args:
            time: simulated time [s].
        """
        launch, gradient, ramps = self._launcher.launch, self._gradient, self._ramps
        for axis, (drawn, potential) in enumerate(zip(self._drawn, self._potential, strict=True)):
            middle = wp.vec3(*(0.5 * (a == axis) for a in range(3)))
            launch(_turn_gradients, gradient.shape, *drawn, time / self._lasts, gradient)
            launch(_blend_across, ramps[0].shape, gradient, middle, self._scales, *ramps)
            launch(_fill_potential, potential.shape, *ramps, middle[2], self._scales[2], potential)

    def add(self, velocity: tuple, strength: float, dt: float) -> None:
        """Adds dt times the force.

        Args:
            velocity: u, v, w on faces [m/s], changed.
            strength: root mean square of the acceleration [m/s²].
            dt: [s].
        """
        for axis, component in enumerate(velocity):
            self._launcher.launch(_stir, component.shape, *self._noise(axis), self._gain(strength, dt), component)
        join_seams(self._launcher, *self._place, velocity)

    def add_inside(self, source: Source, velocity: tuple, strength: float, dt: float) -> None:
        """Adds dt times the force inside an emitter, weighted by the share that is inside; none on closed sides.

        Args:
            source: the emitter, placed at its current position.
            velocity: u, v, w on faces [m/s], changed.
            strength: root mean square of the acceleration [m/s²].
            dt: [s].
        """
        for axis, component in enumerate(velocity):
            for lower, fraction, (shape, faces) in source.faces(axis):
                args = (faces, lower, fraction, *self._noise(axis), self._gain(strength, dt), component)
                self._launcher.launch(_stir_inside, shape, *args)
        join_seams(self._launcher, *self._place, velocity)

    def _noise(self, axis: int) -> tuple:
        """Returns the next two axes in cyclic order, and the components of the potential along them."""
        b, c = (axis + 1) % 3, (axis + 2) % 3
        return self._axes[b], self._axes[c], self._potential[b], self._potential[c]

    def _gain(self, strength: float, dt: float) -> float:
        return strength * dt * self._scale / _MEAN_CURL
