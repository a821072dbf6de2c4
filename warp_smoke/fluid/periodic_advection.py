"""Advection in domains with periodic sides: any scheme, applied to copies of the fields with ghost cells."""

from math import ceil, inf

import warp as wp

from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.grid import Box, closed_ends
from warp_smoke.fluid.halo import Halo
from warp_smoke.fluid.solid_boundary import SolidBoundary
from warp_smoke.launch import Launcher

# Most cells that a trace may cross; faster flow is advected in more parts.
MOST_COURANT = 8.0
# Ghosts needed beyond the length of a trace: interpolation at its end, and its start in the first ghost.
_STENCIL = 3


def advection_halo(
    launcher: Launcher, shape: tuple[int, int, int], sides: tuple[str, ...], max_courant: float
) -> Halo | None:
    """Makes ghost cells for traces up to a Courant number; returns None if no side is periodic."""
    if "periodic" not in sides:
        return None
    return Halo(launcher, shape, sides, ceil(min(max_courant, MOST_COURANT)) + _STENCIL)


class PaddedSolids:
    """The colliders of a domain on its lattice with ghost cells; attributes as in `Solids`."""

    def __init__(self, solids: Solids, halo: Halo):
        """Allocates."""
        self._solids, self._halo, self.changes = solids, halo, 0
        self.fluid = halo.zeros("colliders")
        self.held = self.fluid if solids.held is solids.fluid else halo.zeros("colliders")
        self.wx, self.wy, self.wz = (halo.zeros("colliders", axis) for axis in range(3))
        self.box = None

    def update(self, start: float, end: float, seconds: float) -> None:
        """Moves the solids like `Solids.update`, and copies them."""
        solids, halo = self._solids, self._halo
        solids.update(start, end, seconds)
        halo.pad(solids.held, self.held)
        if self.changes == solids.changes:
            return
        halo.pad(solids.fluid, self.fluid)
        for axis, (share, padded) in enumerate(((solids.wx, self.wx), (solids.wy, self.wy), (solids.wz, self.wz))):
            halo.pad(share, padded, axis)
        self.changes, self.box = solids.changes, solids.box
        if solids.box is not None:  # images of the solids may be anywhere along periodic axes
            lower, upper = zip(
                *((0, n) if g else ends for *ends, n, g in zip(*solids.box, halo.shape, halo.layers, strict=True)),
                strict=True,
            )
            self.box = Box(lower, upper)


class PeriodicAdvection:
    """An advection scheme on a lattice with ghost cells; methods as in `SemiLagrangian`."""

    def __init__(
        self,
        launcher: Launcher,
        scheme: type,
        sides: tuple[str, ...],
        halo: Halo,
        boundary: SolidBoundary | None = None,
    ):
        """Allocates.

        Args:
            launcher: where it runs.
            scheme: one of the advection schemes.
            sides: open, closed or periodic for each of -x +x -y +y -z +z.
            halo: from `advection_halo`.
            boundary: boundary of the `PaddedSolids`, or None.
        """
        self._halo, self._boundary = halo, boundary
        self._advection = scheme(launcher, halo.shape, closed_ends(sides), boundary, layers=halo.layers)
        self._velocity = tuple(halo.zeros("advection", axis) for axis in range(3))
        self._scalar = halo.zeros("advection")
        whole = halo.whole
        self.activate(whole, whole)

    def activate(self, air: Box, smoke: Box) -> None:
        """Limits advection of velocity to one box and of scalars to another inside it."""
        self._advection.activate(self._halo.pad_box(air), self._halo.pad_box(smoke))

    def trace(self, velocity: tuple, step: float, courant: float = inf) -> None:
        """Traces back through one step; the fields advected next follow these traces."""
        self._pad(velocity)
        self._advection.trace(self._velocity, step, courant)

    def advect_velocity(self, velocity: tuple, wind: tuple[float, float, float] | None = None) -> tuple:
        """Advects u, v, w, and returns them."""
        self._pad(velocity)
        if self._boundary:
            self._boundary.extend(self._velocity)
        self._velocity = self._advection.advect_velocity(self._velocity, wind)
        for padded, component in zip(self._velocity, velocity, strict=True):
            self._halo.crop(padded, component)
        return velocity

    def advect_scalar(self, scalar: wp.array, ambient: float) -> wp.array:
        """Advects a cell-centred field, and returns it."""
        self._scalar = self._advection.advect_scalar(self._halo.pad(scalar, self._scalar), ambient)
        self._halo.crop(self._scalar, scalar)
        return scalar

    def _pad(self, velocity: tuple) -> None:
        for axis, (component, padded) in enumerate(zip(velocity, self._velocity, strict=True)):
            self._halo.pad(component, padded, axis)
