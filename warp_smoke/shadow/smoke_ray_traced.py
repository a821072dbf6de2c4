"""Smoke shadow by a fine march along each receiver point's ray to the light: the reference for light buffers.

Transmittance by Beer and Lambert, T = exp(−σ ∫ ρ ds); density is trilinear between cell centres, constant in the
outer half of the outermost cells, and zero outside the box.
"""

import numpy as np
import warp as wp

from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Light
from warp_smoke.shadow.light_buffer import light_in_cells, set_to_cells

wp.set_module_options({"enable_backward": False})


@wp.func
def _cell_axis(x: float, n: int):
    """Lower sample, its upper neighbour, and the weight of that neighbour, for x in cells."""
    c = wp.clamp(x - 0.5, 0.0, float(n - 1))
    i = wp.min(int(c), wp.max(n - 2, 0))
    return i, wp.min(i + 1, n - 1), c - float(i)


@wp.func
def trilinear_density(density: wp.array3d[float], x: wp.vec3):
    """Density at a point inside the box, in cell coordinates."""
    i, i1, f = _cell_axis(x[0], density.shape[0])
    j, j1, g = _cell_axis(x[1], density.shape[1])
    k, k1, h = _cell_axis(x[2], density.shape[2])
    a = wp.lerp(wp.lerp(density[i, j, k], density[i, j, k1], h), wp.lerp(density[i, j1, k], density[i, j1, k1], h), g)
    b = wp.lerp(
        wp.lerp(density[i1, j, k], density[i1, j, k1], h), wp.lerp(density[i1, j1, k], density[i1, j1, k1], h), g
    )
    return wp.lerp(a, b, f)


@wp.kernel
def _march_rays(
    rows: Rows,
    density: wp.array3d[float],
    from_set: wp.mat44,
    light: wp.vec4,
    extinction: float,
    step: float,
    points: wp.array[wp.vec3],
    color: wp.vec3,
    transmittance_inout: wp.array2d[float],
):
    """transmittance[c, n] *= exp(−σ color_c Σ ρ(x + (m + ½) Δ d) Δ), Δ ≤ step, to the light or the box's side."""
    n = rows.first + wp.tid()
    x = wp.transform_point(from_set, points[n])
    ray = wp.vec3(light[0], light[1], light[2]) - light[3] * x
    distance = wp.max(wp.length(ray), 1.0e-20)
    direction = ray / distance
    start = wp.float32(0.0)
    end = wp.where(light[3] > 0.0, distance, 1.0e20)
    for axis in range(3):
        # A ray along a side of the box must not become 0 · ∞.
        d = direction[axis]
        inverse = 1.0 / wp.where(wp.abs(d) < 1.0e-12, 1.0e-12, d)
        low = -x[axis] * inverse
        high = (float(density.shape[axis]) - x[axis]) * inverse
        start = wp.max(start, wp.min(low, high))
        end = wp.min(end, wp.max(low, high))
    if end > start:
        steps = int(wp.ceil((end - start) / step))
        length = (end - start) / float(steps)
        total = wp.float32(0.0)
        for m in range(steps):
            total += trilinear_density(density, x + (start + (float(m) + 0.5) * length) * direction)
        depth = extinction * length * total
        for c in range(transmittance_inout.shape[0]):
            transmittance_inout[c, n] = transmittance_inout[c, n] * wp.exp(-color[c] * depth)


class RayTracedSmokeShadow:
    """How much of a light the smoke of one domain lets through, by one ray per point; the light may be anywhere."""

    def __init__(
        self,
        launcher: Launcher,
        lattice: Lattice,
        light: Light,
        origin: np.ndarray,
        extinction: float,
        color: tuple[float, float, float] = (1.0, 1.0, 1.0),
        step: float = 0.5,
    ):
        """Prepares the rays.

        Args:
            launcher: launches the kernels.
            lattice: the smoke's cells.
            light: any light.
            origin: world position of set space's origin [stage units], [3] float64.
            extinction: σ [1/m] at density 1.
            color: factor on σ for red, green and blue.
            step: largest distance between samples, in cells.
        """
        self._launcher, self._lattice, self._light, self._step = launcher, lattice, light, step
        self._extinction, self._color = extinction * lattice.h, wp.vec3(*color)
        self._from_set = wp.mat44(set_to_cells(lattice, np.asarray(origin, np.float64)).T.astype(np.float32))

    def update(self, density: wp.array, time: float) -> None:
        """Sets the smoke [nx, ny, nz], which must not change before look-ups, and the light at a time code."""
        self._density = density
        self._homogeneous = wp.vec4(*light_in_cells(self._light, self._lattice, time).tolist())

    def transmittance(self, points: wp.array, transmittance_inout: wp.array) -> None:
        """Multiplies by the share of light that passes the smoke between the light and each point.

        Args:
            points: in set space, [n] vec3.
            transmittance_inout: [1, n], or [3, n] for red, green and blue.
        """
        self._launcher.launch_each(
            _march_rays,
            len(points),
            self._density,
            self._from_set,
            self._homogeneous,
            self._extinction,
            self._step,
            points,
            self._color,
            transmittance_inout,
        )
