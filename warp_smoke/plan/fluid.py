"""Planning of the fluid passes that a domain needs."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from warp_smoke.lattice import Lattice, place_lattice
from warp_smoke.plan.participants import find_colliders, find_emitters, heats, pushes, stirs, weighs
from warp_smoke.plan.passes import DomainPlan, Ledger, When
from warp_smoke.plan.reach import is_moving
from warp_smoke.record import FieldError
from warp_smoke.scene import (
    DIFFUSION_SOLVERS,
    PRESSURE_SOLVERS,
    ArrayCollider,
    ArrayEmitter,
    Collider,
    Emitter,
    Scene,
    SmokeDomain,
)

DEFAULT_ADVECTION = "maccormack"
DEFAULT_TOLERANCE = 1e-3
_STILL = "nothing moves the air: no buoyancy, no wind, no turbulence, no emitter that pushes, no moving collider"
_COLD = "no buoyancy reads it and it is not exported"


def plan_domain(ledger: Ledger, scene: Scene, domain: SmokeDomain, stirred_by: str = "") -> DomainPlan | None:
    """Plans the fluid passes of one domain; returns None if it never holds smoke.

    Args:
        ledger: where the passes are recorded.
        scene: the scene.
        domain: one of its domains.
        stirred_by: what moves the air besides the scene, such as a script's force; empty if nothing does.

    Raises:
        FieldError: the domain asks for a solver that cannot serve it.
    """
    lattice = place_lattice(scene, domain)
    emitters = find_emitters(ledger, scene, domain, lattice)
    if not emitters:
        why = "no emitter that is ever on touches it, so it never holds smoke"
        ledger.omit("simulate", (domain.path,), why)
        return None
    smoke = _Smoke(domain, lattice, emitters, find_colliders(ledger, scene, domain, lattice), stirred_by)
    scheme = domain.advection or DEFAULT_ADVECTION
    solver, solver_why = _pressure_solver(domain, smoke.colliders)
    diffusion_solver, diffusion_why = _diffusion_solver(domain, smoke.colliders)
    choices = [
        *_choose_sources(smoke),
        *_choose_forces(smoke),
        _choose_viscosity(smoke, diffusion_solver, diffusion_why),
        *_choose_flow(smoke, scheme, solver, solver_why),
        *_choose_spreading(smoke, diffusion_solver, diffusion_why),
        *_choose_decay(smoke),
    ]
    for each in choices:
        if each.asked:
            ledger.keep(each.name, (domain.path,), each.when, each.makes, each.why, each.method)
        else:
            ledger.omit(each.name, (domain.path,), each.why_not)
    return DomainPlan(
        domain,
        lattice,
        tuple(each.name for each in choices if each.asked),
        smoke.emitters,
        smoke.colliders,
        scheme,
        solver,
        domain.pressure_tolerance or DEFAULT_TOLERANCE,
        diffusion_solver,
        _choose_grids(ledger, scene, smoke),
    )


class _Choice(NamedTuple):
    """A pass, whether anything asks for it, and the reason why or why not."""

    name: str
    asked: object
    why: str
    why_not: str
    makes: str
    method: str = ""
    when: When = When.SUBSTEP


@dataclass(frozen=True)
class _Smoke:
    """The smoke of a domain: what takes part in the simulation, and what moves the air."""

    domain: SmokeDomain
    lattice: Lattice
    emitters: tuple[Emitter | ArrayEmitter, ...]
    colliders: tuple[Collider | ArrayCollider, ...]
    stirred_by: str

    @property
    def rises_by_heat(self) -> bool:
        hot = any(heats(each, self.domain.ambient_temperature) for each in self.emitters)
        return hot and self.domain.buoyancy_temperature != 0

    @property
    def is_buoyant(self) -> bool:
        sinks = self.domain.buoyancy_density != 0 and any(weighs(each) for each in self.emitters)
        return self.rises_by_heat or sinks

    @property
    def has_heat(self) -> bool:
        return self.rises_by_heat or "temperature" in self.domain.grids

    @property
    def pushing(self) -> list[Emitter | ArrayEmitter]:
        return [each for each in self.emitters if pushes(each)]

    @property
    def stirring(self) -> list[Collider | ArrayCollider]:
        return [each for each in self.colliders if is_moving(each)]

    @property
    def is_windy(self) -> bool:
        return any(self.domain.wind) and "open" in self.lattice.sides

    @property
    def flows(self) -> bool:
        forced = self.is_buoyant or self.is_windy or self.is_turbulent or self.stirred_by
        return bool(forced or self.pushing or self.stirring)

    @property
    def is_turbulent(self) -> bool:
        return self.domain.turbulence > 0 or any(stirs(each) for each in self.emitters)


def _choose_sources(smoke: _Smoke) -> Iterator[_Choice]:
    """Yields the choices of colliders, wind and emitters."""
    domain, emitters, colliders = smoke.domain, smoke.emitters, smoke.colliders
    spreads = domain.density_diffusion or (smoke.has_heat and domain.temperature_diffusion)
    yield _Choice(
        "voxelize_colliders",
        (smoke.flows or spreads) and colliders,
        f"smoke {'flows' if smoke.flows else 'spreads'} around {_paths(colliders)}",
        _STILL if colliders else "no collider touches the domain",
        "solid cells",
        when=When.SUBSTEP if smoke.stirring else When.ONCE,
    )
    why = f"wind is ({', '.join(f'{x:g}' for x in domain.wind)}) m/s"
    why_not = "no side is open for the wind to come in" if any(domain.wind) else "wind is 0"
    yield _Choice("blow_wind", smoke.is_windy, why, why_not, "velocity")
    partial = [each for each in emitters if isinstance(each, Emitter) and each.is_partial]
    why = f"{_paths(partial)} makes smoke by noise or in its surface"
    why_not = "every emitter makes smoke evenly throughout its inside"
    yield _Choice("vary_emission", partial, why, why_not, "shares of cells")
    from_arrays = "arrays" if any(isinstance(each, ArrayEmitter) for each in emitters) else ""
    yield _Choice("emit_density", True, f"{_paths(emitters)} makes smoke", "", "density", from_arrays)
    why = "buoyancy reads it" if smoke.rises_by_heat else "it is among the exported grids"
    yield _Choice("emit_temperature", smoke.has_heat, why, _COLD, "temperature")
    why, why_not = f"{_paths(smoke.pushing)} pushes the air", "no emitter has a velocity or moves"
    yield _Choice("emit_velocity", smoke.pushing, why, why_not, "velocity")


def _choose_forces(smoke: _Smoke) -> Iterator[_Choice]:
    """Yields the choices of the forces on the air."""
    domain = smoke.domain
    why = "smoke is hotter or colder than the air" if smoke.rises_by_heat else "smoke has weight"
    why_not = "no emitter makes smoke that buoyancy acts on"
    yield _Choice("add_buoyancy", smoke.is_buoyant, why, why_not, "velocity")
    stirring = [f"that of {each.path} {each.turbulence:g} m/s²" for each in smoke.emitters if stirs(each)]
    why = ", ".join([f"turbulence is {domain.turbulence:g} m/s²", *stirring])
    yield _Choice("stir_air", smoke.is_turbulent, why, "turbulence is 0", "velocity")
    why, why_not = f"vorticity is {domain.vorticity:g}", _STILL if domain.vorticity else "vorticity is 0"
    yield _Choice("confine_vorticity", smoke.flows and domain.vorticity, why, why_not, "velocity")


def _choose_viscosity(smoke: _Smoke, solver: str, solver_why: str) -> _Choice:
    """Returns the choice of velocity diffusion."""
    domain = smoke.domain
    sticky = domain.boundary is not None and "no_slip" in domain.boundary
    rough = [each for each in smoke.colliders if each.friction]
    slips = "viscosity is 0" + ", so air slides along the sides that are no_slip too" * sticky
    slips += f", so air slides along {_paths(rough)}" if rough else ""
    why = f"viscosity is {domain.viscosity:g} m²/s; {solver_why}"
    asked, why_not = smoke.flows and domain.viscosity, _STILL if domain.viscosity else slips
    return _Choice("diffuse_velocity", asked, why, why_not, "velocity", solver)


def _choose_flow(smoke: _Smoke, scheme: str, solver: str, solver_why: str) -> Iterator[_Choice]:
    """Yields the choices of pressure projection and advection."""
    flows, stirred_by = smoke.flows, smoke.stirred_by
    why = f"{stirred_by} moves the air; " * bool(stirred_by) + f"air keeps its volume; {solver_why}"
    yield _Choice("project_pressure", flows, why, _STILL, "velocity without divergence", solver)
    why = "air and smoke are advected only in a box around the smoke and the fast air"
    boxed, why_not = smoke.domain.active_box, _STILL if smoke.domain.active_box else "activeBox is false"
    yield _Choice("fit_active_box", flows and boxed, why, why_not, "cells that are active")
    yield _Choice("advect_velocity", flows, "air carries its own motion along", _STILL, "velocity", scheme)
    yield _Choice("advect_density", flows, "air carries smoke along", _STILL, "density", scheme)
    why, why_not = "air carries heat along", _STILL if smoke.has_heat else _COLD
    yield _Choice("advect_temperature", flows and smoke.has_heat, why, why_not, "temperature", scheme)


def _choose_spreading(smoke: _Smoke, solver: str, solver_why: str) -> Iterator[_Choice]:
    """Yields the choices of diffusion of smoke and heat."""
    spread = smoke.domain.density_diffusion
    why = f"densityDiffusion is {spread:g} m²/s; {solver_why}"
    yield _Choice("diffuse_density", spread, why, "densityDiffusion is 0", "density", solver)
    spread = smoke.domain.temperature_diffusion
    why = f"temperatureDiffusion is {spread:g} m²/s; {solver_why}"
    why_not = "temperatureDiffusion is 0" if smoke.has_heat else _COLD
    yield _Choice("diffuse_temperature", smoke.has_heat and spread, why, why_not, "temperature", solver)


def _choose_decay(smoke: _Smoke) -> Iterator[_Choice]:
    """Yields the choices of dissipation and cooling."""
    rate = smoke.domain.density_dissipation
    why = f"densityDissipation is {rate:g}/s"
    yield _Choice("dissipate_density", rate, why, "densityDissipation is 0", "density")
    rate = smoke.domain.temperature_cooling
    why, why_not = f"temperatureCooling is {rate:g}/s", "temperatureCooling is 0" if smoke.has_heat else _COLD
    yield _Choice("cool_temperature", smoke.has_heat and rate, why, why_not, "temperature")


def _choose_grids(ledger: Ledger, scene: Scene, smoke: _Smoke) -> tuple[str, ...]:
    """Returns the grids that are written to the volume file."""
    path, asked = smoke.domain.path, smoke.domain.grids
    dark = not any(scene.ambient) and not any(light.shines for light in scene.lights)
    needless = {"velocity": not smoke.flows and _STILL, "light": dark and "no light shines"}
    grids = tuple(grid for grid in asked if not needless.get(grid))
    for grid in set(asked) - set(grids):
        ledger.omit(f"write {grid}", (path,), needless[grid])
    ledger.keep("write_volume", (path,), When.FRAME, ", ".join(grids), "the domain's smoke is exported")
    return grids


def _paths(prims: list | tuple) -> str:
    return ", ".join(prim.path for prim in prims)


def _pressure_solver(domain: SmokeDomain, colliders: tuple[Collider | ArrayCollider, ...]) -> tuple[str, str]:
    """Returns the pressure solver and why it is used."""
    solver = domain.pressure_solver
    if solver is None and colliders:
        return "multigrid", f"multigrid is the fastest solver around {_paths(colliders)}"
    if solver is None:
        return "spectral", "spectral is exact where no collider is in the domain"
    if solver == "spectral" and colliders:
        others = ", ".join(name for name in PRESSURE_SOLVERS if name != "spectral")
        allowed = f"{others}, since {colliders[0].path} is a collider in it"
        raise FieldError(domain.path, "pressure_solver", solver, allowed)
    return solver, f"pressureSolver is {solver}"


def _diffusion_solver(domain: SmokeDomain, colliders: tuple[Collider | ArrayCollider, ...]) -> tuple[str, str]:
    """Returns the diffusion solver and why it is used."""
    solver = domain.diffusion_solver
    if solver is None and colliders:
        return "jacobi", f"jacobi takes {_paths(colliders)} into account"
    if solver is None:
        return "spectral", "spectral is exact where no collider is in the domain"
    if solver == "spectral" and colliders:
        others = ", ".join(name for name in DIFFUSION_SOLVERS if name != "spectral")
        allowed = f"{others}, since {colliders[0].path} is a collider in it"
        raise FieldError(domain.path, "diffusion_solver", solver, allowed)
    return solver, f"diffusionSolver is {solver}"
