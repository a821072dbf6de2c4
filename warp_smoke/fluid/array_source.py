"""Emitters from arrays: values held or added in each cell of the domain, without a shape to voxelize.

They follow the rules of `warp_smoke.fluid.emitters`: a value is held where it is further from ambient than the field,
a velocity where the air moves more slowly in its direction.
"""

import numpy as np
import warp as wp

from warp_smoke.fluid.emitters import Interval, divide
from warp_smoke.fluid.grid import Block, inner_faces, seam_faces, side_faces
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.record import FieldError, value_at
from warp_smoke.scene import ArrayEmitter

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _hold_cells(rows: Rows, values: wp.array3d[float], ambient: float, a_inout: wp.array3d[float]):
    """Hold: a = the value where it is further from ambient than a."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, values.shape[2])
    while k < end:
        value = values[i, j, k]
        if wp.abs(value - ambient) > wp.abs(a_inout[i, j, k] - ambient):
            a_inout[i, j, k] = value
        k += 1


@wp.kernel
def _add_cells(rows: Rows, values: wp.array3d[float], factor: float, a_inout: wp.array3d[float]):
    """Addition: a += factor · value."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, values.shape[2])
    while k < end:
        a_inout[i, j, k] = a_inout[i, j, k] + factor * values[i, j, k]
        k += 1


@wp.kernel
def _push_cells(rows: Rows, faces: Block, values: wp.array4d[float], axis: int, u_inout: wp.array3d[float]):
    """Hold: u = mean of the two cells' values along the face's axis, unless u is at least as fast in that direction."""
    i, j, c = wp.tid()
    i += rows.first + faces.first[0]
    j += faces.first[1]
    a = faces.before
    b = faces.after
    k = wp.max(faces.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, faces.stop)
    while k < end:
        given = 0.5 * (values[i - a[0], j - a[1], k - a[2], axis] + values[i - b[0], j - b[1], k - b[2], axis])
        u = u_inout[i, j, k]
        u_inout[i, j, k] = wp.where(given > 0.0, wp.max(u, given), wp.where(given < 0.0, wp.min(u, given), u))
        k += 1


class ArraySource:
    """One emitter from arrays acting in a domain; same interface as `Source`.

    Attributes:
        pushes: whether it gives the air a velocity.
        turbulence: none.
    """

    turbulence = 0.0

    def __init__(self, launcher: Launcher, lattice: Lattice, emitter: ArrayEmitter):
        """Takes the arrays; copies NumPy arrays to the device.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            emitter: the emitter.

        Raises:
            FieldError: an array that is not NumPy's is not a contiguous float32 Warp array on the launcher's device.
        """
        self._launcher, self._emitter = launcher, emitter
        self._fields = {name: self._take_in(name, values) for name, values in emitter.fields.items()}
        self.pushes = "velocity" in self._fields
        place = lattice.shape, lattice.sides
        self._faces = [
            [inner_faces(lattice.shape, axis), *side_faces(*place, axis), *seam_faces(*place, axis)]
            for axis in range(3)
        ]

    def _take_in(self, name: str, values: object) -> wp.array:
        if isinstance(values, np.ndarray):
            return self._launcher.array(values, "emitters")
        usable = isinstance(values, wp.array) and values.dtype == wp.float32 and values.is_contiguous
        if not usable or values.device != self._launcher.device:
            allowed = f"a contiguous float32 array on {self._launcher.device}"
            raise FieldError(self._emitter.path, name, f"{type(values).__name__} of {values.dtype}", allowed)
        return values

    def sweep(self, start: float, end: float, dt: float) -> list[Interval]:
        """Divides a step at the samples of the rate; arguments as for `Source.sweep`."""
        emitter = self._emitter
        return divide(start, end, dt, 1, () if emitter.rate is None else (emitter.rate, emitter.enabled))

    def place(self, interval: Interval) -> None:
        """Does nothing: arrays cover the domain."""

    def emit_density(self, interval: Interval, density: wp.array) -> None:
        """Holds the density, or adds to it at the emitter's rate; arguments as for `Source.emit_density`."""
        rate = self._emitter.rate
        if rate is None:
            self._hold("density", interval.end, 0.0, density)
        elif "density" in self._fields and value_at(self._emitter.enabled, interval.middle):
            factor = float(value_at(rate, interval.middle)) * interval.dt
            self._launcher.launch(_add_cells, density.shape, self._fields["density"], factor, density)

    def emit_temperature(self, interval: Interval, temperature: wp.array, ambient: float) -> None:
        """Holds the temperature; arguments as for `Source.emit_temperature`."""
        self._hold("temperature", interval.end, ambient, temperature)

    def emit_velocity(self, interval: Interval, velocity: tuple) -> None:
        """Holds the velocity; arguments as for `Source.emit_velocity`."""
        if value_at(self._emitter.enabled, interval.end):
            values = self._fields["velocity"]
            for axis, (patches, component) in enumerate(zip(self._faces, velocity, strict=True)):
                for shape, block in patches:
                    self._launcher.launch(_push_cells, shape, block, values, axis, component)

    def _hold(self, name: str, time: float, ambient: float, field: wp.array) -> None:
        if name in self._fields and value_at(self._emitter.enabled, time):
            self._launcher.launch(_hold_cells, field.shape, self._fields[name], ambient, field)
