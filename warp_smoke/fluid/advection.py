"""Advection: each field is carried along the traces of a step.

J. Stam, *Stable Fluids*, 1999: the semi-Lagrangian scheme, which the others build on.

Density and temperature that enter through an open side have ambient values: one layer of ambient cells lies beyond it.
Velocity there is the wind's or, without wind, the same as on the side. Nothing enters through a closed side: traces end
on it, and between it and the first cell centre a field is constant. Beyond a periodic side, ghost cells repeat the
other end of the domain (`periodic_advection.py`).
"""

from math import inf, sqrt

import warp as wp

from warp_smoke.fluid.grid import Block, Box, all_cells, beside, box_of, patch_of
from warp_smoke.fluid.halo import copy_samples
from warp_smoke.fluid.interpolation import clamped_place, mixed, sample, settle
from warp_smoke.fluid.runge_kutta import trace_back
from warp_smoke.fluid.samples import Samples
from warp_smoke.fluid.solid_boundary import SolidBoundary
from warp_smoke.fluid.trace import Displacement, make_displacement, trace_limits
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.func
def end_of_trace(
    block: Block, d: Displacement, i: int, j: int, k: int, a: wp.array3d[float], lower: wp.vec3, upper: wp.vec3
):
    """Returns where the trace of sample (i, j, k) ends, in sample indices of a, and the weight of a as against ambient.

    The displacement is the mean of the adjacent cells' displacements; the end is clamped to [lower, upper].
    """
    x0 = beside(d.x, block.before)
    y0 = beside(d.y, block.before)
    z0 = beside(d.z, block.before)
    x1 = beside(d.x, block.after)
    y1 = beside(d.y, block.after)
    z1 = beside(d.z, block.after)
    x = float(i) + 0.5 * (x0[i, j, k] + x1[i, j, k])
    y = float(j) + 0.5 * (y0[i, j, k] + y1[i, j, k])
    z = float(k) + 0.5 * (z0[i, j, k] + z1[i, j, k])
    return clamped_place(a, x, y, z, lower, upper)


def sampling_kernel(interpolate: wp.Function, module: str) -> wp.Kernel:
    """Makes the semi-Lagrangian kernel for an interpolation function.

    Args:
        interpolate: (a, x, y, z) → value of field a at (x, y, z), in sample indices of a and within its range.
        module: name of the module that the kernel is compiled with.
    """

    @wp.kernel(name="sample_back", module=wp.get_module(module))
    def sample_back(
        rows: Rows,
        block: Block,
        d: Displacement,
        a: wp.array3d[float],
        lower: wp.vec3,
        upper: wp.vec3,
        ambient: float,
        a_out: wp.array3d[float],
    ):
        """Semi-Lagrangian: a_out(x) = a(x + d); one sample outside a, the value is ambient."""
        i, j, c = wp.tid()
        i += rows.first + block.first[0]
        j += block.first[1]
        out = dense_store(a_out)
        k = wp.max(block.first[2] + c * rows.run, 0)
        end = wp.min(k + rows.run, block.stop)
        while k < end:
            x, y, z, inside = end_of_trace(block, d, i, j, k, a, lower, upper)
            out[i, j, k] = bits(settle(mixed(ambient, interpolate(a, x, y, z), inside)))
            k += 1

    return sample_back


sample_back = sampling_kernel(sample, __name__)


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
            shape: cells along each axis (nx, ny, nz), including ghost cells.
            sides: open or closed for each of -x +x -y +y -z +z.
            boundary: boundary of the colliders, or None.
            trace: one of `TRACES`.
            layers: layers of ghost cells at both ends of each axis.
        """
        self._launcher, self._boundary, self._scheme = launcher, boundary, trace
        self._trace_limits = trace_limits(shape, sides)
        self._traced = all_cells(shape)
        self._air = box_of(self._traced)
        self._cells = Samples(shape, sides, layers, None)
        self._faces = tuple(Samples(shape, sides, layers, axis) for axis in range(3))
        self._back = make_displacement(launcher, shape)
        self._spare = {samples: launcher.zeros(samples.shape, "advection") for samples in (self._cells, *self._faces)}

    def activate(self, air: Box, smoke: Box) -> None:
        """Limits advection of velocity to one box and of scalars to another inside it; elsewhere fields are unchanged.

        Args:
            air: cells in which velocity is advected.
            smoke: cells in which scalars are advected.
        """
        self._cells.activate(smoke)
        if air != self._air:
            self._air, self._traced = air, patch_of(air, self._traced)
            for faces in self._faces:
                faces.activate(air)
            for displacement in self._ways():
                for along in (displacement.x, displacement.y, displacement.z):
                    along.zero_()

    def trace(self, velocity: tuple, step: float, courant: float = inf) -> None:
        """Traces back through one step; the fields advected next follow these traces.

        Args:
            velocity: u, v, w on faces [m/s], changed inside solids.
            step: dt / h [s/m].
            courant: most cells that air moves in the step.
        """
        if self._boundary:
            self._boundary.follow(courant)
            self._boundary.extend(velocity)
        self._trace(velocity, step)
        if self._boundary:
            self._boundary.stop(*self._ways())

    def _trace(self, velocity: tuple, step: float) -> None:
        trace_back(self._launcher, self._scheme, self._traced, velocity, step, self._trace_limits, self._back)

    def _ways(self) -> tuple[Displacement, Displacement]:
        """Returns the displacements backward and forward at which fields are sampled; they may be the same."""
        return self._back, self._back

    def advect_velocity(self, velocity: tuple, wind: tuple[float, float, float] | None = None) -> tuple:
        """Advects u, v, w; returns them, in the given arrays or in spare ones for which it then keeps the given ones.

        Args:
            velocity: u, v, w on faces [m/s].
            wind: velocity beyond open sides, along the lattice's axes [m/s]; None = the same as on the side.
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
        """Advects a cell-centred field; returns it, in the given array or in a spare one like `advect_velocity`.

        Args:
            scalar: [nx, ny, nz].
            ambient: its value outside open sides.
        """
        return self._advect(self._cells, scalar, self._cells.limits, ambient)

    def _advect(self, samples: Samples, field: wp.array, limits: tuple, ambient: float) -> wp.array:
        # Faces on closed sides are never written: they are 0 in the field and in the spare array.
        new = self._spare[samples]
        if samples.few:  # then copying these back is cheaper than copying the rest
            self._carry(samples, field, limits, ambient, new)
            copy_samples(self._launcher, [samples.alone], new, field)
            self._continue(samples, field, field)
            return field
        self._keep(samples, field, new)
        self._carry(samples, field, limits, ambient, new)
        self._continue(samples, field, new)
        self._spare[samples] = field
        return new

    def _carry(self, samples: Samples, field: wp.array, limits: tuple, ambient: float, new: wp.array) -> None:
        shape, block = samples.carried
        self._launcher.launch(self._kernel, shape, block, self._back, field, *limits, ambient, new)
        if self._boundary and samples is self._cells:
            self._boundary.sample(self._back, field, limits, ambient, (new, new, new))

    def _keep(self, samples: Samples, field: wp.array, new: wp.array) -> None:
        copy_samples(self._launcher, samples.kept, field, new)

    def _continue(self, samples: Samples, field: wp.array, new: wp.array) -> None:
        # In a domain one cell thick there is no next face inside; those on its sides keep their velocity.
        copy_samples(self._launcher, samples.continued, field if samples.thin else new, new)


def limit_energy(launcher: Launcher, velocity: tuple, energy: float, most: float) -> None:
    """Scales the velocity down if its kinetic energy exceeds a limit: advection does no work.

    Args:
        launcher: where it runs.
        velocity: u, v, w on faces [m/s], changed.
        energy: kinetic energy of the velocity [m²/s²].
        most: limit of the kinetic energy [m²/s²].
    """
    if energy > most:
        for component in velocity:
            launcher.launch(_scale, component.shape, sqrt(most / energy), component)
