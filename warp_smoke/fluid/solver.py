"""Stable fluids: the smoke of one domain, step by step.

J. Stam, *Stable Fluids*, 1999; R. Fedkiw, J. Stam, H. W. Jensen, *Visual Simulation of Smoke*, 2001. A step emits, adds
forces, diffuses and projects the velocity, advects all fields along it, and diffuses and dissipates the smoke.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import ceil, inf, sqrt
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warp_smoke.fluid.array_source import ArraySource
from warp_smoke.fluid.body_forces import BodyForces
from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.diffusion import DIFFUSION_SOLVERS, DiffusionProblem, diffuse_scalar, diffusion_number
from warp_smoke.fluid.dissipation import decay
from warp_smoke.fluid.emitters import Interval, Source
from warp_smoke.fluid.guard import Guard
from warp_smoke.fluid.measures import Measures
from warp_smoke.fluid.periodic_advection import PaddedSolids, advection_halo
from warp_smoke.fluid.pressure import PressureStatus
from warp_smoke.fluid.projection import PressureProjection
from warp_smoke.fluid.solid_boundary import SolidBoundary
from warp_smoke.fluid.solid_faces import empty_solids
from warp_smoke.fluid.state import make_state
from warp_smoke.fluid.step_report import StepReport, join_reports
from warp_smoke.fluid.transport import MAX_PARTS, ROUND_OFF, Transport
from warp_smoke.launch import Launcher
from warp_smoke.scene import ArrayEmitter
from warp_smoke.timing import Timings

if TYPE_CHECKING:
    from warp_smoke.plan import DomainPlan


class SmokeSolver:
    """The smoke of one domain. Only the plan's passes are launched, and only what they need is allocated.

    Attributes:
        state: the fields.
        solids: the colliders on the lattice, or None.
        on_substep: called in each step after all forces and before the pressure, with this solver, the time code at
            the step's end and the step's length [s]; or None. What it adds to the velocity is projected and advected.
    """

    def __init__(self, launcher: Launcher, plan: "DomainPlan", timings: Timings):
        """Allocates; steps allocate nothing on the device unless a mesh outgrows its box.

        Args:
            launcher: where it runs.
            plan: the domain, its lattice and what runs in it.
            timings: records the time of each pass.
        """
        self._launcher, self._timings, self._passes = launcher, timings, frozenset(plan.passes)
        self._domain, self._lattice = plan.domain, plan.lattice
        self.on_substep: Callable[[SmokeSolver, float, float], None] | None = None
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
        self._flows, measures, divergence = self._has("project_pressure"), None, None
        if self._flows:
            measures = Measures(launcher, shape)
            self._forces = BodyForces(launcher, plan, timings, measures, self._sources)
            self._projection = PressureProjection(launcher, plan, self.solids)
            divergence = self._projection.divergence
        self._guard = Guard(plan, timings, self.state, measures, divergence)
        if self._flows:
            self._transport = Transport(launcher, plan, timings, self._guard, halo, self._boundary, self.solids)
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
        """Makes the first frame: air at rest or moving with the wind, and the values that emitters hold.

        Args:
            time: time code.
        """
        self._guard.time = time
        self._place_colliders(time, time, 0.0)
        if self._flows and self._transport.wind:
            with self._timings.measure("blow_wind"):
                self._transport.wind.fill(self.state.velocity)
            self._project_pressure()
        self._emit(time, time, 0.0)
        if self.solids:
            fluid, state = self.solids.fluid, self.state
            empty_solids(self._launcher, fluid, state.density, 0.0)
            if state.temperature:
                empty_solids(self._launcher, fluid, state.temperature, self._domain.ambient_temperature)

    def advance(self, start: float, end: float, seconds: float) -> StepReport:
        """Advances the smoke in as many steps as the Courant number requires.

        Args:
            start: time code.
            end: time code.
            seconds: simulated time between them [s].

        Raises:
            NotFiniteError: a field is not finite.
        """
        self._guard.time = end
        self._guard.check_scalars(f"frame {start:g}")
        if not self._flows:
            return self.step(start, end, seconds)
        reports, left = [], 0
        speed, _ = self._guard.motion(f"frame {start:g}")
        while left != 1:
            if self.solids:  # a wall must not jump far, though the air may still be at rest
                speed = max(speed, self.solids.max_speed(start, end, seconds))
            left = max(1, min(self._count_steps(seconds, speed), MAX_PARTS - len(reports)))
            dt, reached = seconds / left, start + (end - start) / left
            reports.append(self.step(start, reached, dt))
            start, seconds, speed = reached, seconds - dt, reports[-1].speed
        return join_reports(reports)

    def save(self) -> dict[str, np.ndarray]:
        """Copies everything that later steps depend on to the host, by name; `load` restores it."""
        return self.state.save()

    def load(self, saved: Mapping[str, np.ndarray], first: float, time: float) -> None:
        """Restores what `save` returned; the following steps are bit-identical to those of an uninterrupted run.

        Args:
            saved: arrays saved by a solver of the same plan.
            first: time code of the first frame. Meshes are placed there first, because which of several equally distant
                triangles a query finds depends on the shape for which the bounding volume hierarchy was built.
            time: time code at which the state was saved.
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
            dt: simulated time between them [s].

        Raises:
            NotFiniteError: a field is not finite.
        """
        report = StepReport()
        self._guard.time = end
        self._place_colliders(start, end, dt)
        self._emit(start, end, dt)
        confinement = self._add_forces(start, end, dt)
        if self._flows:
            diffusion = self._diffuse_velocity(dt)
            pressure = self._project_pressure()
            courant, speed = self._transport.advect(self.state, dt)
            report = StepReport(1, courant, speed, [pressure], confinement, diffusion)
        diffusion = self._diffuse_scalars(dt)
        self._dissipate(dt)
        self._guard.check_scalars()
        return replace(report, diffusion=max(report.diffusion, diffusion))

    def _count_steps(self, seconds: float, speed: float) -> int:
        """Returns how many steps keep (max|u| + a dt) dt within the limit, a the largest acceleration by forces."""
        acceleration = self._forces.acceleration(self._guard.density, self._guard.temperature)
        reach = self._domain.max_courant * self._lattice.h  # how far smoke may go in a step [m]
        steps = seconds * (speed + sqrt(speed * speed + 4.0 * acceleration * reach)) / (2.0 * reach)
        return ceil(min(steps, MAX_PARTS) * (1.0 - ROUND_OFF))

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

    def _add_forces(self, start: float, end: float, dt: float) -> float:
        """Adds the forces; returns the share of the confinement that its cap allowed."""
        share = self._forces.add(self.state, start, end, dt) if self._flows else 1.0
        if self.on_substep:
            self._guard.interferes = True
            with self._timings.measure("on_substep"):
                self.on_substep(self, end, dt)
        return share

    def _diffuse_velocity(self, dt: float) -> float:
        """Diffuses the velocity; returns the bound on the error."""
        if not self._has("diffuse_velocity"):
            return 0.0
        r = diffusion_number(self._domain.viscosity, dt, self._lattice.h)
        with self._timings.measure("diffuse_velocity"):
            if self.solids:
                self.solids.apply(self.state.velocity)
            return max(self._diffusion.diffuse(axis, faces, r) for axis, faces in enumerate(self.state.velocity))

    def _diffuse_scalars(self, dt: float) -> float:
        """Diffuses density and temperature; returns the bound on the error."""
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
        with self._timings.measure("project_pressure"):
            return self._projection.project(self.state)

    def _dissipate(self, dt: float) -> None:
        domain, state = self._domain, self.state
        if self._has("dissipate_density"):
            with self._timings.measure("dissipate_density"):
                decay(self._launcher, state.density, 0.0, domain.density_dissipation, dt)
        if self._has("cool_temperature"):
            with self._timings.measure("cool_temperature"):
                decay(self._launcher, state.temperature, domain.ambient_temperature, domain.temperature_cooling, dt)
