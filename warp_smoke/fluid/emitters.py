"""Emitters: meshes and points that hold density, temperature and velocity inside themselves, or add density at a rate.

A cell is weighted by the share f of it that is inside. A held value e sets ambient + f (e − ambient) where that is
further from ambient than the field, so emitting twice is the same as once. A velocity component is held likewise where
the air is slower in its direction or moves the other way; faster air, sped up by buoyancy for instance, stays as it is.
A rate adds rate · dt · density · f, with Σ f scaled to the emitter's true volume; the mass does not depend on substeps.
"""

from bisect import insort
from collections.abc import Iterable, Iterator
from itertools import pairwise, product
from math import ceil
from typing import NamedTuple

import numpy as np
import warp as wp

from warp_smoke.fluid.emitter_share import EmitterShare
from warp_smoke.fluid.grid import Block, Patch, make_patch
from warp_smoke.fluid.point_voxels import PointVoxels
from warp_smoke.fluid.voxelize import MeshVoxels
from warp_smoke.geometry import Points
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.record import Samples, each_value, value_at
from warp_smoke.scene import Emitter

wp.set_module_options({"enable_backward": False})

# Shortest part of a step: in less, the distance a surface moves would be lost in the round-off of its position.
_LEAST_PART = 1e-6


@wp.kernel
def _hold(
    rows: Rows,
    lower: wp.vec3i,
    fraction: wp.array3d[float],
    value: float,
    ambient: float,
    a_inout: wp.array3d[float],
):
    """Hold: a = ambient + f (value − ambient) where that is further from ambient than a."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fraction.shape[2])
    while k < end:
        departure = fraction[i, j, k] * (value - ambient)
        if wp.abs(departure) > wp.abs(a_inout[lower[0] + i, lower[1] + j, lower[2] + k] - ambient):
            a_inout[lower[0] + i, lower[1] + j, lower[2] + k] = ambient + departure
        k += 1


@wp.kernel
def _add(rows: Rows, lower: wp.vec3i, fraction: wp.array3d[float], amount: float, a_inout: wp.array3d[float]):
    """Addition: a += f · amount."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fraction.shape[2])
    while k < end:
        x = lower[0] + i
        y = lower[1] + j
        z = lower[2] + k
        a_inout[x, y, z] = a_inout[x, y, z] + amount * fraction[i, j, k]
        k += 1


@wp.func
def inside(a: wp.array3d[float], i: int, j: int, k: int):
    """Returns the value of a, or 0 outside its cells."""
    value = wp.float32(0.0)
    if i >= 0 and j >= 0 and k >= 0 and i < a.shape[0] and j < a.shape[1] and k < a.shape[2]:
        value = a[i, j, k]
    return value


@wp.func
def _farther(given: float, u: float):
    """Returns the given velocity, or u if that has the same direction and is at least as fast."""
    return wp.where(given > 0.0, wp.max(u, given), wp.where(given < 0.0, wp.min(u, given), u))


@wp.kernel
def _push(
    rows: Rows,
    faces: Block,
    lower: wp.vec3i,
    fraction: wp.array3d[float],
    velocity: float,
    u_inout: wp.array3d[float],
):
    """Hold: u = ½ (f₋ + f₊) velocity unless u is at least as fast in that direction; f₋, f₊ in the face's two cells."""
    i, j, c = wp.tid()
    i += rows.first + faces.first[0]
    j += faces.first[1]
    k = wp.max(faces.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, faces.stop)
    while k < end:
        before = inside(fraction, i - faces.before[0], j - faces.before[1], k - faces.before[2])
        share = 0.5 * (before + inside(fraction, i, j, k))
        u = u_inout[lower[0] + i, lower[1] + j, lower[2] + k]
        u_inout[lower[0] + i, lower[1] + j, lower[2] + k] = _farther(share * velocity, u)
        k += 1


@wp.kernel
def _drag(
    rows: Rows,
    faces: Block,
    lower: wp.vec3i,
    fraction: wp.array3d[float],
    surface: wp.array3d[float],
    inherit: float,
    velocity: float,
    u_inout: wp.array3d[float],
):
    """Like `_push` with ½ Σ f (velocity + inherit s) over the face's two cells, s the surface's velocity."""
    i, j, c = wp.tid()
    i += rows.first + faces.first[0]
    j += faces.first[1]
    k = wp.max(faces.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, faces.stop)
    while k < end:
        x = i - faces.before[0]
        y = j - faces.before[1]
        z = k - faces.before[2]
        given = inside(fraction, x, y, z) * (velocity + inherit * inside(surface, x, y, z))
        given += inside(fraction, i, j, k) * (velocity + inherit * inside(surface, i, j, k))
        u = u_inout[lower[0] + i, lower[1] + j, lower[2] + k]
        u_inout[lower[0] + i, lower[1] + j, lower[2] + k] = _farther(0.5 * given, u)
        k += 1


class Interval(NamedTuple):
    """A part of a step.

    Attributes:
        start, end: time codes.
        dt: simulated time between them [s].
    """

    start: float
    end: float
    dt: float

    @property
    def middle(self) -> float:
        """The time code halfway between start and end."""
        return 0.5 * (self.start + self.end)


def divide(start: float, end: float, dt: float, parts: int, changing: Iterable[object] = ()) -> list[Interval]:
    """Divides a step into equal parts, and further at samples of changing values, which are linear in between.

    Args:
        start: time code.
        end: time code.
        dt: simulated time between them [s].
        parts: number of equal parts.
        changing: values, or `Samples` of them.
    """
    times = np.linspace(start, end, parts + 1).tolist()
    samples = [each.times.tolist() for each in changing if isinstance(each, Samples)]
    turns = {time for each in samples for time in each if start < time < end}
    for time in sorted(turns):
        if min(abs(time - each) for each in times) > _LEAST_PART * (end - start):
            insort(times, time)
    if len(times) == parts + 1:
        return [Interval(*ends, dt / parts) for ends in pairwise(times)]
    return [Interval(a, b, dt * (b - a) / (end - start)) for a, b in pairwise(times)]


class Source:
    """One emitter acting in a domain.

    Held values are taken at the end of an interval; a rate, and whether its emitter is on, at the middle, where the
    value is the mean over the interval.

    Attributes:
        pushes: whether it gives the air a velocity.
        turbulence: root mean square of the acceleration that stirs the air inside it [m/s²].
    """

    def __init__(self, launcher: Launcher, lattice: Lattice, emitter: Emitter):
        """Copies the emitter's shape to the device.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            emitter: the emitter.
        """
        self._launcher, self._lattice, self._emitter = launcher, lattice, emitter
        if isinstance(emitter.mesh, Points):
            self._voxels = PointVoxels(launcher, lattice, emitter, "emitters")
        else:
            # A sheet has no inside; its skin reaches half a voxel to both sides.
            margin = 0.5 if emitter.source == "surface" and not emitter.mesh.is_closed else 0.0
            self._voxels = MeshVoxels(launcher, lattice, emitter, "emitters", margin)
        self._share = EmitterShare(launcher, lattice, emitter, self._voxels) if emitter.is_partial else None
        self._inherits = self._voxels.moves and emitter.inherit_velocity != 0.0
        self.pushes = self._inherits or bool(np.any(each_value(emitter.velocity)))
        self.turbulence = emitter.turbulence

    def sweep(self, start: float, end: float, dt: float) -> list[Interval]:
        """Divides a step so that the emitter moves at most about a cell in each part, and leaves no gaps.

        Args:
            start: time code.
            end: time code.
            dt: simulated time between them [s].
        """
        parts, emitter = 1, self._emitter
        if self._voxels.moves:
            # More parts would only help an emitter that is in the domain for a small part of its path.
            parts = min(max(1, ceil(self._voxels.travel(start, end))), 2 * sum(self._lattice.shape))
        return divide(start, end, dt, parts, () if emitter.rate is None else (emitter.rate, emitter.enabled))

    def place(self, interval: Interval) -> None:
        """Moves the emitter to where it is at the end of an interval."""
        changed = self._voxels.update(*interval)
        if self._share:
            self._share.update(changed, interval.end)

    def emit_density(self, interval: Interval, density: wp.array) -> None:
        """Holds the density, or adds to it at the emitter's rate.

        Args:
            interval: from `sweep`.
            density: [nx, ny, nz], changed.
        """
        emitter, middle = self._emitter, interval.middle
        if emitter.rate is None:
            self._hold(interval.end, density, value_at(emitter.density, interval.end), 0.0)
        elif self.acts(middle):
            amount = value_at(emitter.rate, middle) * value_at(emitter.density, middle) * interval.dt
            amount *= self._voxels.volume_ratio()
            for lower, fraction in self._smoke():
                self._launcher.launch(_add, fraction.shape, lower, fraction, float(amount), density)

    def emit_temperature(self, interval: Interval, temperature: wp.array, ambient: float) -> None:
        """Holds the temperature.

        Args:
            interval: from `sweep`.
            temperature: [nx, ny, nz], changed.
            ambient: temperature of the ambient air.
        """
        self._hold(interval.end, temperature, value_at(self._emitter.temperature, interval.end), ambient)

    def emit_velocity(self, interval: Interval, velocity: tuple) -> None:
        """Holds the emitter's velocity plus the inherited share of its motion; closed sides of the domain stay closed.

        Args:
            interval: from `sweep`.
            velocity: u, v, w on faces along the lattice's axes [m/s], changed.
        """
        if not self.acts(interval.end):
            return
        given = self._lattice.axes @ np.asarray(value_at(self._emitter.velocity, interval.end))
        for axis, component in enumerate(velocity):
            for lower, fraction, (shape, faces) in self.faces(axis):
                place = lower, fraction
                if self._inherits:
                    surface = self._voxels.velocity[axis]
                    args = (*place, surface, self._emitter.inherit_velocity, float(given[axis]), component)
                    self._launcher.launch(_drag, shape, faces, *args)
                elif given[axis]:
                    self._launcher.launch(_push, shape, faces, *place, float(given[axis]), component)

    def acts(self, time: float) -> bool:
        """Returns whether the emitter is on at a time code and has cells in the domain."""
        return 0 not in self._voxels.shape and bool(value_at(self._emitter.enabled, time))

    def _smoke(self) -> Iterator[tuple[wp.vec3i, wp.array]]:
        """Yields the parts of the box in the domain: first cell there, and share of each cell that emits smoke."""
        fraction = self._share.fraction() if self._share else self._voxels.fraction
        for spans in product(*(self._spans(axis, 0) for axis in range(3))):
            part = tuple(slice(first, end) for first, end, _ in spans)
            whole = all(n == each.stop - each.start for n, each in zip(fraction.shape, part, strict=True))
            yield wp.vec3i(*(first + shift for first, _, shift in spans)), fraction if whole else fraction[part]

    def _spans(self, axis: int, more: int) -> list[tuple[int, int, int]]:
        """Returns the box's samples in the domain along an axis: first, end, and domain index of the box's sample 0.

        Beyond a periodic side the box continues at the other end.

        Args:
            axis: 0, 1 or 2.
            more: by how much samples outnumber cells, in the box and the domain: 1 for faces across the axis, else 0.
        """
        lower, count, n = self._voxels.lower[axis], self._voxels.shape[axis], self._lattice.shape[axis]
        shifts = [0]
        if self._lattice.sides[2 * axis] == "periodic" and count <= n + 1:  # else it is longer than the domain
            shifts = range((lower - 1) // n, (lower + count) // n + 1)
        spans = [(max(0, m * n - lower), min(count + more, (m + 1) * n + more - lower), lower - m * n) for m in shifts]
        return [span for span in spans if span[0] < span[1]]

    def _hold(self, time: float, field: wp.array, value: float, ambient: float) -> None:
        if self.acts(time):
            for lower, fraction in self._smoke():
                self._launcher.launch(_hold, fraction.shape, lower, fraction, float(value), ambient, field)

    def faces(self, axis: int) -> Iterator[tuple[wp.vec3i, wp.array, Patch]]:
        """Yields the faces across an axis, in box indices, without those on closed sides of the domain.

        For each part of the box in the domain: the domain index of the box's first cell, the share of each cell of the
        box that is inside, and the faces.
        """
        n, (low, high) = self._lattice.shape[axis], self._lattice.sides[2 * axis : 2 * axis + 2]
        unit = tuple(int(a == axis) for a in range(3))
        for spans in product(*(self._spans(a, step) for a, step in enumerate(unit))):
            first, end, shift = zip(*spans, strict=True)
            skipped = int(first[axis] + shift[axis] == 0 and low == "closed")
            left_out = int(end[axis] + shift[axis] == n + 1 and high == "closed")
            start = tuple(a + skipped * step for a, step in zip(first, unit, strict=True))
            shape = tuple(b - a - left_out * step for a, b, step in zip(start, end, unit, strict=True))
            yield wp.vec3i(*shift), self._voxels.fraction, make_patch(start, shape, unit, (0, 0, 0))
