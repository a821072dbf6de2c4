"""The share of each cell that an emitter fills: its interior or only its skin, uniform or varied by noise.

The noise is K. Perlin's (*Improving Noise*, 2002) in space and time: fixed to the domain, changing within a few frames,
and the same in every run.
"""

from math import prod

import numpy as np
import warp as wp

from warp_smoke.geometry import transform_points
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Emitter

wp.set_module_options({"enable_backward": False})

# Time codes over which the noise changes completely.
_LASTS = 12.0
_SEED = wp.constant(1)


@wp.kernel
def _peel(rows: Rows, lower: wp.vec3i, cells: wp.vec3i, fraction: wp.array3d[float], share_out: wp.array3d[float]):
    """Skin: share = f − min of f and its six neighbours; f is 0 outside the box, and constant beyond the domain."""
    i, j, c = wp.tid()
    i += rows.first
    last = wp.vec3i(fraction.shape[0] - 1, fraction.shape[1] - 1, fraction.shape[2] - 1)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fraction.shape[2])
    while k < end:
        here = fraction[i, j, k]
        least = here
        for axis in range(3):
            for side in range(2):
                step = 2 * side - 1
                x = i + wp.where(axis == 0, step, 0)
                y = j + wp.where(axis == 1, step, 0)
                z = k + wp.where(axis == 2, step, 0)
                n = wp.where(axis == 0, x, wp.where(axis == 1, y, z))
                if n >= 0 and n <= last[axis]:
                    least = wp.min(least, fraction[x, y, z])
                elif lower[axis] + n >= 0 and lower[axis] + n < cells[axis]:
                    least = 0.0
        share_out[i, j, k] = here - least
        k += 1


@wp.kernel
def _make_uneven(
    rows: Rows,
    lower: wp.vec3i,
    share: wp.array3d[float],
    noise: float,
    scale: float,
    time: float,
    share_out: wp.array3d[float],
):
    """Noise: share (1 − noise n), with n in [0, 1] evaluated at the cell's centre / scale and the time."""
    i, j, c = wp.tid()
    i += rows.first
    state = wp.rand_init(_SEED)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, share.shape[2])
    while k < end:
        x = wp.vec4(
            (float(lower[0] + i) + 0.5) / scale,
            (float(lower[1] + j) + 0.5) / scale,
            (float(lower[2] + k) + 0.5) / scale,
            time,
        )
        n = wp.clamp(0.5 + wp.noise(state, x), 0.0, 1.0)
        share_out[i, j, k] = share[i, j, k] * (1.0 - noise * n)
        k += 1


class EmitterShare:
    """The share of each cell in the box of an emitter's voxels that emits smoke."""

    def __init__(self, launcher: Launcher, lattice: Lattice, emitter: Emitter, voxels):
        """Prepares.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            emitter: the emitter, of which source and noise are used.
            voxels: voxels of the emitter's shape, `MeshVoxels` or `PointVoxels`.
        """
        self._launcher, self._lattice, self._emitter, self._voxels = launcher, lattice, emitter, voxels
        self._skin, self._uneven = None, None
        self._storage = {}
        self._scale = emitter.noise_scale / lattice.voxel_size if emitter.noise_scale else _quarter(lattice, emitter)

    def update(self, changed: bool, time: float) -> None:
        """Updates the shares to the voxels and the time.

        Args:
            changed: whether the voxels have changed.
            time: time code.
        """
        if 0 in self._voxels.shape:
            return
        lower = wp.vec3i(*self._voxels.lower)
        if self._emitter.source == "surface" and (changed or self._skin is None):
            self._skin = self._room("skin")
            # Along periodic axes the box may cross the sides, so its ends are never those of the domain.
            ring = [side == "periodic" for side in self._lattice.sides[0::2]]
            place = zip(ring, self._voxels.lower, self._voxels.shape, self._lattice.shape, strict=True)
            first, cells = zip(*((1, count + 2) if wraps else (low, n) for wraps, low, count, n in place), strict=True)
            args = (wp.vec3i(*first), wp.vec3i(*cells), self._voxels.fraction, self._skin)
            self._launcher.launch(_peel, self._skin.shape, *args)
        if self._emitter.noise:
            source, self._uneven = self._even(), self._room("uneven")
            args = (lower, source, self._emitter.noise, self._scale, time / _LASTS, self._uneven)
            self._launcher.launch(_make_uneven, source.shape, *args)

    def fraction(self) -> wp.array:
        """Returns the share of each cell, [*shape], 0 to 1."""
        return self._uneven if self._emitter.noise else self._even()

    def _even(self) -> wp.array:
        return self._skin if self._emitter.source == "surface" else self._voxels.fraction

    def _room(self, name: str) -> wp.array:
        """Returns an array over the box, in storage that grows with it."""
        count = prod(self._voxels.shape)
        if name not in self._storage or self._storage[name].size < count:
            self._storage[name] = self._launcher.zeros(count, "emitters")
        return self._storage[name][:count].reshape(self._voxels.shape)


def _quarter(lattice: Lattice, emitter: Emitter) -> float:
    """Returns a quarter of the emitter's longest side at its first sample, at least one cell [cells]."""
    time = -np.inf
    points = transform_points(emitter.transform_at(time) @ lattice.world_to_cells(), emitter.mesh.points_at(time))
    return max(1.0, float(np.ptp(points, axis=0).max()) / 4.0)
