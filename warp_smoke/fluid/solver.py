"""Stable fluids: the smoke of one domain, step by step.

J. Stam, *Stable Fluids*, 1999; R. Fedkiw, J. Stam, H. W. Jensen, *Visual Simulation of Smoke*, 2001. A step emits, adds
forces, diffuses the velocity and projects it, carries all fields along it, and diffuses and dissipates the smoke.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import ceil, inf, isfinite, sqrt
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warp_smoke.fluid.active_box import FAST, fit_boxes, typical_amounts
from warp_smoke.fluid.advection import limit_energy
from warp_smoke.fluid.array_source import ArraySource
from warp_smoke.fluid.colliders import Solids, empty_solids
from warp_smoke.fluid.diffusion import DIFFUSION_SOLVERS, DiffusionProblem, diffuse_scalar, diffusion_number
from warp_smoke.fluid.dissipation import decay
from warp_smoke.fluid.emitters import Interval, Source
from warp_smoke.fluid.forces import Buoyancy
from warp_smoke.fluid.grid import hull
from warp_smoke.fluid.guard import NotFiniteError
from warp_smoke.fluid.measures import Measures
from warp_smoke.fluid.operators import (
    close_sides,
    measure_divergence,
    measure_fluid_divergence,
    subtract_fluid_gradient,
    subtract_gradient,
)
from warp_smoke.fluid.periodic_advection import MOST_COURANT, PaddedSolids, PeriodicAdvection, advection_halo
from warp_smoke.fluid.pressure import PRESSURE_SOLVERS, PressureProblem, PressureStatus
from warp_smoke.fluid.schemes import ADVECTION_SCHEMES
from warp_smoke.fluid.solid_boundary import SolidBoundary
from warp_smoke.fluid.state import make_state
from warp_smoke.fluid.step_report import StepReport, join_reports
from warp_smoke.fluid.turbulence import PEAK, Turbulence
from warp_smoke.fluid.vorticity import VorticityConfinement
from warp_smoke.fluid.wind import Wind
from warp_smoke.launch import Launcher
from warp_smoke.scene import ArrayEmitter
from warp_smoke.timing import Timings

if TYPE_CHECKING:
    from warp_smoke.plan import DomainPlan

# With more steps in a frame than this, the Courant number may exceed the domain's limit: the smoke stays stable.
_MAX_STEPS = 1000
# A Courant number that exceeds the limit by round-off is not worth another step.
_ROUND_OFF = 1e-5
# Passes that write velocity before the pressure, and scalars after that, in their order.
_FORCES = ("emit_velocity", "confine_vorticity", "add_buoyancy", "stir_air", "on_substep", "diffuse_velocity")
_LAST = {
    "density": ("emit_density", "advect_density", "diffuse_density", "dissipate_density"),
    "temperature": ("emit_temperature", "advect_temperature", "diffuse_temperature", "cool_temperature"),
}


class SmokeSolver:
    """The smoke of one domain. Only the plan's passes are launched, and only what they need is allocated.

    Attributes:
        state: the fields.
        solids: the colliders on the lattice, or None.
        on_substep: called in each step after all forces and before the pressure, with this solver, the time code of
            the step's end and its seconds; or None. What it adds to the velocity is projected and carried along.
    """

    def __init__(self, launcher: Launcher, plan: "DomainPlan", timings: Timings):
        """Allocates; steps allocate nothing on the device, except where a mesh outgrows its box.

        Args:
            launcher: where it runs.
            plan: the domain, its lattice and what runs in it.
            timings: takes the time of each pass.
        """
        self._launcher, self._timings, self._passes = launcher, timings, frozenset(plan.passes)
        self._domain, self._lattice = plan.domain, plan.lattice
        self.on_substep: Callable[[SmokeSolver, float, float], None] | None = None
        self._time = 0.0  # time code that is worked towards
        shape, sides = plan.lattice.shape, plan.lattice.sides
        self._sources = [
            (ArraySource if isinstance(each, ArrayEmitter) else Source)(launcher, plan.lattice, each)
            for each in plan.emitters
        ]
        self.state = make_state(launcher, shape, self._passes, plan.domain.ambient_temperature)
        self.solids = Solids(launcher, plan.lattice, plan.colliders) if self._has("voxelize_colliders") else None
        halo = advection_halo(launcher, shape, sides, plan.domain.max_courant) if self._has("advect_density") else None
        solids = PaddedSolids(self.solids, halo) if self.solids and halo else self.solids
        self._boundary = SolidBoundary(launcher, solids) if solids else None
        self._flows = self._has("project_pressure")
        if self._flows:
            problem = PressureProblem(shape=shape, sides=sides, solids=self.solids, tolerance=plan.pressure_tolerance)
            self._pressure_solver = PRESSURE_SOLVERS[plan.pressure_solver](launcher, problem)
            self._divergence = launcher.zeros(shape, "divergence")
            scheme = ADVECTION_SCHEMES[plan.advection]
            if halo:
                self._advection = PeriodicAdvection(launcher, scheme, sides, halo, self._boundary)
            else:
                self._advection = scheme(launcher, shape, sides, self._boundary)
            self._measures = Measures(launcher, shape)
        if self._has("fit_active_box"):
            self._density, self._heat = typical_amounts(plan.emitters, plan.domain.ambient_temperature)
        windy = self._has("blow_wind") and any(plan.domain.wind)
        self._wind = Wind(launcher, plan.lattice, plan.domain.wind) if windy else None
        if self._has("add_buoyancy"):
            self._buoyancy = Buoyancy(launcher, shape, sides, plan.lattice.up)
        self._turbulence, strength = None, plan.domain.turbulence
        if self._has("stir_air") and strength:
            self._turbulence = Turbulence(launcher, plan.lattice, strength, plan.domain.turbulence_scale)
        if self._has("confine_vorticity"):
            self._confinement = VorticityConfinement(launcher, shape, sides, plan.lattice.h, self._measures)

        spreads = self._has("diffuse_density") or self._has("diffuse_temperature")
        diffusing = (0, 1, 2) * self._has("diffuse_velocity") + (None,) * spreads
        if diffusing:
            problem = DiffusionProblem(
                shape, sides, plan.lattice.no_slip, diffusing, plan.domain.diffusion_sweeps, self.solids
            )
            self._diffusion = DIFFUSION_SOLVERS[plan.diffusion_solver](launcher, problem)

    def _has(self, name: str) -> bool:
        return name in self._passes

    def begin(self, time: float) -> None:
        """Makes the first frame: air at rest or in the wind, and what the emitters hold.

        Args:
            time: time code.
        """
        self._time = time
        self._place_colliders(time, time, 0.0)
        if self._wind:
            with self._timings.measure("blow_wind"):
                self._wind.fill(self.state.velocity)
            self._project_pressure()
        self._emit(time, time, 0.0)
        if self.solids:
            empty_solids(self._launcher, self.solids, self.state.density, 0.0)
            if self.state.temperature:
                empty_solids(self._launcher, self.solids, self.state.temperature, self._domain.ambient_temperature)

    def advance(self, start: float, end: float, seconds: float) -> StepReport:
        """Advances the smoke in as many steps as the Courant number calls for.

        Args:
            start: time code.
            end: time code.
            seconds: of smoke between them [s].

        Raises:
            NotFiniteError: a field is not finite.
        """
        self._time = end
        self._check_scalars(f"frame {start:g}")
        if not self._flows:
            return self.step(start, end, seconds)
        reports, left = [], 0
        speed, _ = self._motion(f"frame {start:g}")
        while left != 1:
            if self.solids:  # a wall must not jump far, though the air may still be at rest
                speed = max(speed, self.solids.max_speed(start, end, seconds))
            left = max(1, min(self._count_steps(seconds, speed), _MAX_STEPS - len(reports)))
            dt, reached = seconds / left, start + (end - start) / left
            reports.append(self.step(start, reached, dt))
            start, seconds, speed = reached, seconds - dt, reports[-1].speed
        return join_reports(reports)

    def save(self) -> dict[str, np.ndarray]:
        """Copies all that later steps depend on to the host, by name; `load` takes it back."""
        return self.state.save()

    def load(self, saved: Mapping[str, np.ndarray], first: float, time: float) -> None:
        """Goes on from what `save` gave; steps are then the same to the bit as if nothing had been in between.

        Args:
            saved: by a solver of the same plan.
            first: time code of the first frame. Meshes are placed there before: which triangle a query finds among
                several at one distance follows from the shape that the hierarchy was given at first.
            time: time code at which it was saved.
        """
        for placed in (first, time):
            self._place_colliders(placed, placed, 0.0)
        for source in self._sources:
            source.place(Interval(first, first, 0.0))
        self.state.load(saved)

    def step(self, start: float, end: float, dt: float) -> StepReport:
        """Advances the smoke in one step; only advection is split, if the Courant number is above the limit.

        Args:
            start: time code.
            end: time code.
            dt: seconds of smoke between them [s].

        Raises:
            NotFiniteError: a field is not finite.
        """
        report = StepReport()
        self._time = end
        self._place_colliders(start, end, dt)
        self._emit(start, end, dt)
        confinement = self._confine_vorticity(dt)  # before buoyancy moves faces of solids: its cap counts them
        self._add_buoyancy(dt)
        self._stir_air(start, end, dt)
        if self.on_substep:
            with self._timings.measure("on_substep"):
                self.on_substep(self, end, dt)
        if self._flows:
            diffusion = self._diffuse_velocity(dt)
            pressure = self._project_pressure()
            courant, speed = self._advect(dt)
            report = StepReport(1, courant, speed, [pressure], confinement, diffusion)
        diffusion = self._diffuse_scalars(dt)
        self._dissipate(dt)
        self._check_scalars()
        return replace(report, diffusion=max(report.diffusion, diffusion))

    def _count_steps(self, seconds: float, speed: float) -> int:
        """Steps that keep (max|u| + a dt) dt within the limit, a the largest acceleration by forces."""
        domain, acceleration = self._domain, 0.0
        if self._has("add_buoyancy"):
            acceleration = abs(domain.buoyancy_density) * self._departures["density"]
            acceleration += abs(domain.buoyancy_temperature) * self._departures["temperature"]
        reach = domain.max_courant * self._lattice.h  # how far smoke may go in a step [m]
        if self._turbulence:
            acceleration += PEAK * domain.turbulence
        steps = seconds * (speed + sqrt(speed * speed + 4.0 * acceleration * reach)) / (2.0 * reach)
        return ceil(min(steps, _MAX_STEPS) * (1.0 - _ROUND_OFF))

    def _motion(self, name: str) -> tuple[float, float]:
        """Largest speed [m/s] and kinetic energy [m²/s²] after the pass `name`."""
        with self._timings.measure("measure_motion"):
            speed, energy = self._measures.motion(self.state.velocity)
        if not isfinite(energy):
            self._refuse_velocity(name)
        return speed, energy

    def _check_scalars(self, after: str | None = None) -> None:
        """Measures how far density and temperature depart from ambient at most.

        Args:
            after: what wrote them; the last pass that does unless given.

        Raises:
            NotFiniteError: one of them is not finite.
        """
        self._departures = {"density": 0.0, "temperature": 0.0}
        for name, ambient in (("density", 0.0), ("temperature", self._domain.ambient_temperature)):
            scalar = getattr(self.state, name)
            if scalar is None:
                continue
            with self._timings.measure("measure_motion"):
                departure = self._measures.departure(scalar, ambient) if self._flows else np.abs(scalar.numpy()).max()
            if not isfinite(departure):
                last = [each for each in _LAST[name] if self._has(each)][-1]
                raise NotFiniteError(self._domain.path, name, [scalar], self._frame, after or last)
            self._departures[name] = float(departure)

    def _refuse_velocity(self, after: str) -> None:
        """Says where velocity is not finite. The pressure spreads that; the divergence shows where it was before."""
        fields = self.state.velocity
        if after == "project_pressure" and not np.isfinite(self._divergence.numpy()).all():
            acting = [each for each in _FORCES if self._has(each) or (each == "on_substep" and self.on_substep)]
            fields, after = [self._divergence], acting[-1] if acting else "advect_velocity"
        raise NotFiniteError(self._domain.path, "velocity", fields, self._frame, after)

    @property
    def _frame(self) -> int:
        """The frame that is made."""
        return ceil(self._time - _ROUND_OFF)

    def _place_colliders(self, start: float, end: float, dt: float) -> None:
        if self.solids:
            with self._timings.measure("voxelize_colliders"):
                self._boundary.move(start, end, dt)

    def _emit(self, start: float, end: float, dt: float) -> None:
        state = self.state
        for source in self._sources:
            for interval in source.sweep(start, end, dt):
                with self._timings.measure("emit_density"):
                    source.place(interval)
                    source.emit_density(interval, state.density)
                if self._has("emit_temperature"):
                    with self._timings.measure("emit_temperature"):
                        source.emit_temperature(interval, state.temperature, self._domain.ambient_temperature)
                if self._has("emit_velocity") and source.pushes:
                    with self._timings.measure("emit_velocity"):
                        source.emit_velocity(interval, state.velocity)

    def _confine_vorticity(self, dt: float) -> float:
        """Returns the share of the confinement that its cap let through."""
        if not self._has("confine_vorticity"):
            return 1.0
        with self._timings.measure("confine_vorticity"):
            return self._confinement.add(self.state.velocity, self._domain.vorticity, dt, self.state.energy_lost)

    def _add_buoyancy(self, dt: float) -> None:
        if not self._has("add_buoyancy"):
            return
        domain, state = self._domain, self.state
        with self._timings.measure("add_buoyancy"):
            if domain.buoyancy_density:
                self._buoyancy.add(state.density, 0.0, -domain.buoyancy_density * dt, state.velocity)
            if domain.buoyancy_temperature and state.temperature is not None:
                strength = domain.buoyancy_temperature * dt
                self._buoyancy.add(state.temperature, domain.ambient_temperature, strength, state.velocity)

    def _stir_air(self, start: float, end: float, dt: float) -> None:
        if self._turbulence:
            with self._timings.measure("stir_air"):
                self._turbulence.add(self.state.velocity, end * dt / (end - start), dt)

    def _diffuse_velocity(self, dt: float) -> float:
        """Returns the bound on the error of diffusion."""
        if not self._has("diffuse_velocity"):
            return 0.0
        r = diffusion_number(self._domain.viscosity, dt, self._lattice.h)
        with self._timings.measure("diffuse_velocity"):
            if self.solids:
                self.solids.apply(self.state.velocity)
            return max(self._diffusion.diffuse(axis, faces, r) for axis, faces in enumerate(self.state.velocity))

    def _diffuse_scalars(self, dt: float) -> float:
        """Returns the bound on the error of diffusion."""
        domain, state, error = self._domain, self.state, 0.0
        if self._has("diffuse_density"):
            error = self._diffuse_scalar("diffuse_density", state.density, domain.density_diffusion, dt, 0.0, 0.0)
        if self._has("diffuse_temperature"):
            args = (state.temperature, domain.temperature_diffusion, dt, domain.ambient_temperature, -inf)
            error = max(error, self._diffuse_scalar("diffuse_temperature", *args))
        return error

    def _diffuse_scalar(
        self, name: str, scalar: wp.array, coefficient: float, dt: float, ambient: float, least: float
    ) -> float:
        r = diffusion_number(coefficient, dt, self._lattice.h)
        with self._timings.measure(name):
            return diffuse_scalar(self._launcher, self._diffusion, scalar, r, ambient, least)

    def _project_pressure(self) -> PressureStatus:
        launcher, sides, divergence = self._launcher, self._lattice.sides, self._divergence
        velocity, pressure = self.state.velocity, self.state.pressure
        with self._timings.measure("project_pressure"):
            if self.solids:
                self.solids.apply(velocity)
                measure_fluid_divergence(launcher, velocity, self.solids, divergence)
                status = self._pressure_solver.solve(divergence, pressure)
                subtract_fluid_gradient(launcher, pressure, sides, self.solids, velocity)
            else:
                close_sides(launcher, sides, velocity)
                measure_divergence(launcher, velocity, divergence)
                status = self._pressure_solver.solve(divergence, pressure)
                subtract_gradient(launcher, pressure, sides, velocity)
        return status

    def _advect(self, dt: float) -> tuple[float, float]:
        """Carries all fields along the velocity; returns the Courant number, and the largest speed that is left."""
        domain, state, advection, timings = self._domain, self.state, self._advection, self._timings
        speed, energy = self._motion("project_pressure")
        courant, wind = speed * dt / self._lattice.h, self._wind
        limit = min(domain.max_courant, MOST_COURANT) if "periodic" in self._lattice.sides else domain.max_courant
        parts = max(1, ceil(min(courant / limit, _MAX_STEPS) * (1.0 - _ROUND_OFF)))
        self._fit_active_box(courant)
        with timings.measure("advect_velocity"):
            advection.trace(state.velocity, dt / parts / self._lattice.h, courant / parts)
        for _ in range(parts):
            with timings.measure("advect_velocity"):
                state.velocity = advection.advect_velocity(state.velocity, wind.velocity if wind else None)
            if wind:
                with timings.measure("blow_wind"):
                    wind.let_in(state.velocity)
            with timings.measure("advect_density"):
                state.density = advection.advect_scalar(state.density, 0.0)
            if self._has("advect_temperature"):
                with timings.measure("advect_temperature"):
                    state.temperature = advection.advect_scalar(state.temperature, domain.ambient_temperature)
        if self.solids:
            with timings.measure("advect_velocity"):
                self.solids.apply(state.velocity)
        speed, left = self._motion("advect_velocity")
        with timings.measure("advect_velocity"):
            limit_energy(self._launcher, state.velocity, left, energy + (wind.energy_let_in(courant) if wind else 0.0))
        state.energy_lost = max(0.0, energy - left)
        return courant / parts, speed

    def _fit_active_box(self, courant: float) -> None:
        """Carries what moves, and nothing else; follows `_motion`."""
        if not self._has("fit_active_box"):
            return
        state, measures = self.state, self._measures
        with self._timings.measure("fit_active_box"):
            fast = measures.fast_air(FAST)
            smoke = measures.departed(state.density, 0.0, self._density)
            if self._has("advect_temperature"):
                heat = measures.departed(state.temperature, self._domain.ambient_temperature, self._heat)
                smoke = hull((smoke, heat))
            lattice = self._lattice
            periodic = tuple(side == "periodic" for side in lattice.sides[0::2])
            self._advection.activate(*fit_boxes(smoke, fast, courant, lattice.shape, periodic))

    def _dissipate(self, dt: float) -> None:
        domain, state = self._domain, self.state
        if self._has("dissipate_density"):
            with self._timings.measure("dissipate_density"):
                decay(self._launcher, state.density, 0.0, domain.density_dissipation, dt)
        if self._has("cool_temperature"):
            with self._timings.measure("cool_temperature"):
                decay(self._launcher, state.temperature, domain.ambient_temperature, domain.temperature_cooling, dt)
