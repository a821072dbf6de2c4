"""The forces on the air of a domain that the plan calls for: vorticity confinement, buoyancy and turbulence."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from warp_smoke.fluid.array_source import ArraySource
from warp_smoke.fluid.emitters import Source
from warp_smoke.fluid.forces import Buoyancy
from warp_smoke.fluid.measures import Measures
from warp_smoke.fluid.state import SmokeState
from warp_smoke.fluid.turbulence import PEAK, Turbulence
from warp_smoke.fluid.vorticity import VorticityConfinement
from warp_smoke.launch import Launcher
from warp_smoke.timing import Timings

if TYPE_CHECKING:
    from warp_smoke.plan import DomainPlan


class BodyForces:
    """The forces of one domain."""

    def __init__(
        self,
        launcher: Launcher,
        plan: "DomainPlan",
        timings: Timings,
        measures: Measures,
        sources: Sequence[Source | ArraySource],
    ):
        """Allocates what the plan's forces need.

        Args:
            launcher: where it runs.
            plan: the domain, its lattice and what runs in it.
            timings: records the time of each pass.
            measures: measures on the same lattice.
            sources: the emitters, some of which may stir the air.
        """
        self._timings, self._domain, lattice = timings, plan.domain, plan.lattice
        self._buoyancy = self._turbulence = self._confinement = None
        if "add_buoyancy" in plan.passes:
            self._buoyancy = Buoyancy(launcher, lattice.shape, lattice.sides, lattice.up)
        self._stirring = [each for each in sources if each.turbulence]
        self._strength = plan.domain.turbulence + sum(each.turbulence for each in self._stirring)
        if "stir_air" in plan.passes and self._strength:
            self._turbulence = Turbulence(launcher, lattice, self._strength, plan.domain.turbulence_scale)
        if "confine_vorticity" in plan.passes:
            self._confinement = VorticityConfinement(launcher, lattice.shape, lattice.sides, lattice.h, measures)

    def add(self, state: SmokeState, start: float, end: float, dt: float) -> float:
        """Adds dt times each force to the velocity.

        Args:
            state: state of the smoke; its velocity is changed.
            start: time code.
            end: time code.
            dt: simulated time between them [s].

        Returns:
            The share of the confinement that its cap allowed.
        """
        share = 1.0
        if self._confinement:  # before buoyancy changes faces of solids, which its cap counts
            with self._timings.measure("confine_vorticity"):
                share = self._confinement.add(state.velocity, self._domain.vorticity, dt, state.energy_lost)
        if self._buoyancy:
            with self._timings.measure("add_buoyancy"):
                self._lift(state, dt)
        if self._turbulence:
            with self._timings.measure("stir_air"):
                self._stir(state, start, end, dt)
        return share

    def _lift(self, state: SmokeState, dt: float) -> None:
        domain = self._domain
        if domain.buoyancy_density:
            self._buoyancy.add(state.density, 0.0, -domain.buoyancy_density * dt, state.velocity)
        if domain.buoyancy_temperature and state.temperature is not None:
            strength = domain.buoyancy_temperature * dt
            self._buoyancy.add(state.temperature, domain.ambient_temperature, strength, state.velocity)

    def _stir(self, state: SmokeState, start: float, end: float, dt: float) -> None:
        self._turbulence.turn(end * dt / (end - start))
        if self._domain.turbulence:
            self._turbulence.add(state.velocity, self._domain.turbulence, dt)
        for source in self._stirring:
            if source.acts(end):
                self._turbulence.add_inside(source, state.velocity, source.turbulence, dt)

    def acceleration(self, density: float, temperature: float) -> float:
        """Returns an upper bound of the acceleration by buoyancy and turbulence [m/s²].

        Args:
            density: largest density.
            temperature: largest departure from ambient temperature.
        """
        domain, acceleration = self._domain, 0.0
        if self._buoyancy:
            acceleration += abs(domain.buoyancy_density) * density + abs(domain.buoyancy_temperature) * temperature
        if self._turbulence:
            acceleration += PEAK * self._strength
        return acceleration
