"""Transport: a step's advection of velocity, density and temperature along the projected velocity."""

from math import ceil
from typing import TYPE_CHECKING

from warp_smoke.fluid.active_box import FAST, fit_boxes, typical_amounts
from warp_smoke.fluid.advection import limit_energy
from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.grid import hull
from warp_smoke.fluid.guard import Guard
from warp_smoke.fluid.halo import Halo
from warp_smoke.fluid.periodic_advection import MOST_COURANT, PeriodicAdvection
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.fluid.solid_boundary import SolidBoundary
from warp_smoke.fluid.state import SmokeState
from warp_smoke.fluid.wind import Wind
from warp_smoke.launch import Launcher
from warp_smoke.timing import Timings

if TYPE_CHECKING:
    from warp_smoke.plan import DomainPlan

# Most parts of a step; beyond that the Courant number may exceed the domain's limit, but the smoke stays stable.
MAX_PARTS = 1000
# A Courant number that exceeds the limit by round-off is not worth another step.
ROUND_OFF = 1e-5


class Transport:
    """Advection in one domain, by the plan's scheme, in the active box if it has one.

    Attributes:
        wind: the wind that enters through open sides, or None.
    """

    def __init__(
        self,
        launcher: Launcher,
        plan: "DomainPlan",
        timings: Timings,
        guard: Guard,
        halo: Halo | None,
        boundary: SolidBoundary | None,
        solids: Solids | None,
    ):
        """Allocates.

        Args:
            launcher: where it runs.
            plan: the domain, its lattice and what runs in it.
            timings: records the time of each pass.
            guard: guard of the same domain.
            halo: ghost cells beyond periodic sides, or None.
            boundary: the colliders as a boundary for advection, on the lattice with ghost cells if any, or None.
            solids: the colliders on the lattice, or None.
        """
        self._launcher, self._plan, self._timings, self._guard, self._solids = launcher, plan, timings, guard, solids
        domain, lattice, scheme = plan.domain, plan.lattice, ADVECTION_SCHEMES[plan.advection]
        if halo:
            self._advection = PeriodicAdvection(launcher, scheme, lattice.sides, halo, boundary)
        else:
            self._advection = scheme(launcher, lattice.shape, lattice.sides, boundary)
        self._limit = min(domain.max_courant, MOST_COURANT) if halo else domain.max_courant
        self._boxed, self._warm = "fit_active_box" in plan.passes, "advect_temperature" in plan.passes
        if self._boxed:
            self._density, self._heat = typical_amounts(plan.emitters, domain.ambient_temperature)
        windy = "blow_wind" in plan.passes and any(domain.wind)
        self.wind = Wind(launcher, lattice, domain.wind) if windy else None

    def advect(self, state: SmokeState, dt: float) -> tuple[float, float]:
        """Advects all fields along the velocity.

        Args:
            state: state of the smoke, changed; its velocity is divergence-free.
            dt: [s].

        Returns:
            The Courant number of each part of the step, and the largest speed afterwards [m/s].
        """
        timings, h, wind = self._timings, self._plan.lattice.h, self.wind
        speed, energy = self._guard.motion("project_pressure")
        courant = speed * dt / h
        parts = max(1, ceil(min(courant / self._limit, MAX_PARTS) * (1.0 - ROUND_OFF)))
        if self._boxed:
            with timings.measure("fit_active_box"):
                self._fit_active_box(state, courant)
        with timings.measure("advect_velocity"):
            self._advection.trace(state.velocity, dt / parts / h, courant / parts)
        for _ in range(parts):
            self._advect_once(state)
        if self._solids:
            with timings.measure("advect_velocity"):
                self._solids.apply(state.velocity)
        speed, left = self._guard.motion("advect_velocity")
        with timings.measure("advect_velocity"):
            limit_energy(self._launcher, state.velocity, left, energy + (wind.energy_let_in(courant) if wind else 0.0))
        state.energy_lost = max(0.0, energy - left)
        return courant / parts, speed

    def _advect_once(self, state: SmokeState) -> None:
        """Advects all fields along the traces."""
        timings, wind = self._timings, self.wind
        with timings.measure("advect_velocity"):
            state.velocity = self._advection.advect_velocity(state.velocity, wind.velocity if wind else None)
        if wind:
            with timings.measure("blow_wind"):
                wind.let_in(state.velocity)
        with timings.measure("advect_density"):
            state.density = self._advection.advect_scalar(state.density, 0.0)
        if self._warm:
            with timings.measure("advect_temperature"):
                ambient = self._plan.domain.ambient_temperature
                state.temperature = self._advection.advect_scalar(state.temperature, ambient)

    def _fit_active_box(self, state: SmokeState, courant: float) -> None:
        """Limits advection to what moves, by the last measured motion."""
        measures, lattice = self._guard.measures, self._plan.lattice
        fast = measures.fast_air(FAST)
        smoke = measures.departed(state.density, 0.0, self._density)
        if self._warm:
            heat = measures.departed(state.temperature, self._plan.domain.ambient_temperature, self._heat)
            smoke = hull((smoke, heat))
        periodic = tuple(side == "periodic" for side in lattice.sides[0::2])
        self._advection.activate(*fit_boxes(smoke, fast, courant, lattice.shape, periodic))
