"""The pressure projection: subtracts from the velocity the pressure gradient that makes it divergence-free.

∇²p = ∇·u / dt, u ← u − dt ∇p, after solid faces have been given the velocity of the collider (J. Stam, *Stable Fluids*,
1999).
"""

from typing import TYPE_CHECKING

from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.operators import (
    close_sides,
    measure_divergence,
    measure_fluid_divergence,
    subtract_fluid_gradient,
    subtract_gradient,
)
from warp_smoke.fluid.pressure import PRESSURE_SOLVERS, PressureProblem, PressureStatus
from warp_smoke.fluid.state import SmokeState
from warp_smoke.launch import Launcher

if TYPE_CHECKING:
    from warp_smoke.plan import DomainPlan


class PressureProjection:
    """The projection in one domain.

    Attributes:
        divergence: h times the divergence of the velocity before the last projection, [nx, ny, nz] [m/s].
    """

    def __init__(self, launcher: Launcher, plan: "DomainPlan", solids: Solids | None):
        """Makes the solver.

        Args:
            launcher: where it runs.
            plan: the lattice, and how the pressure is solved for.
            solids: the colliders on the lattice, or None.
        """
        self._launcher, self._sides, self._solids = launcher, plan.lattice.sides, solids
        shape = plan.lattice.shape
        problem = PressureProblem(shape=shape, sides=self._sides, solids=solids, tolerance=plan.pressure_tolerance)
        self._solver = PRESSURE_SOLVERS[plan.pressure_solver](launcher, problem)
        self.divergence = launcher.zeros(shape, "divergence")

    def project(self, state: SmokeState) -> PressureStatus:
        """Makes the velocity divergence-free, with the last pressure as first guess; returns the solver's status."""
        launcher, velocity, pressure = self._launcher, state.velocity, state.pressure
        if self._solids:
            self._solids.apply(velocity)
            measure_fluid_divergence(launcher, velocity, self._solids, self.divergence)
            status = self._solver.solve(self.divergence, pressure)
            subtract_fluid_gradient(launcher, pressure, self._sides, self._solids, velocity)
        else:
            close_sides(launcher, self._sides, velocity)
            measure_divergence(launcher, velocity, self.divergence)
            status = self._solver.solve(self.divergence, pressure)
            subtract_gradient(launcher, pressure, self._sides, velocity)
        return status
