"""Which fluid passes a domain calls for."""

import numpy as np

from warp_smoke.lattice import Lattice, place_lattice
from warp_smoke.plan.passes import DomainPlan, Ledger, When
from warp_smoke.plan.reach import is_moving, may_touch, over, swept_corners
from warp_smoke.record import FieldError, each_value
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
from warp_smoke.scene.arrays import check_cells

DEFAULT_ADVECTION = "maccormack"
DEFAULT_TOLERANCE = 1e-3


def plan_domain(ledger: Ledger, scene: Scene, domain: SmokeDomain, stirred_by: str = "") -> DomainPlan | None:
    """Plans the fluid of one domain, or None if it never holds smoke.

    Args:
        ledger: takes the passes.
        scene: all of it.
        domain: one of its domains.
        stirred_by: what else moves the air, which the scene does not tell of; nothing if empty.
    """
    lattice = place_lattice(scene, domain)
    emitters = _emitters(ledger, scene, domain, lattice)
    if not emitters:
        why = "no emitter that is ever on touches it, so it never holds smoke"
        ledger.omit("simulate", (domain.path,), why)
        return None
    colliders = _colliders(ledger, scene, domain, lattice)
    solver, solver_why = _pressure_solver(domain, colliders)
    diffusion_solver, diffusion_why = _diffusion_solver(domain, colliders)
    scheme = domain.advection or DEFAULT_ADVECTION

    hot = any(_heats(each, domain.ambient_temperature) for each in emitters)
    buoyant_by_heat = hot and domain.buoyancy_temperature != 0
    buoyant_by_weight = domain.buoyancy_density != 0 and any(_weighs(each) for each in emitters)
    has_heat = buoyant_by_heat or "temperature" in domain.grids
    pushing = [each for each in emitters if _pushes(each)]
    stirring = [c for c in colliders if is_moving(c)]
    windy = any(domain.wind) and "open" in lattice.sides
    flows = bool(
        buoyant_by_heat or buoyant_by_weight or pushing or stirring or windy or domain.turbulence or stirred_by
    )
    still = "nothing moves the air: no buoyancy, no wind, no turbulence, no emitter that pushes, no moving collider"
    cold = "no buoyancy reads it and it is not exported"

    kept = []

    def choose(name: str, asked: object, why: str, why_not: str, *, makes: str, when=When.SUBSTEP, method="") -> None:
        if asked:
            kept.append(name)
            ledger.keep(name, (domain.path,), when, makes, why, method)
        else:
            ledger.omit(name, (domain.path,), why_not)

    spreads = domain.density_diffusion or (has_heat and domain.temperature_diffusion)
    choose(
        "voxelize_colliders",
        (flows or spreads) and colliders,
        f"smoke flows around {_paths(colliders)}" if flows else f"smoke spreads around {_paths(colliders)}",
        still if colliders else "no collider touches the domain",
        makes="solid cells",
        when=When.SUBSTEP if stirring else When.ONCE,
    )
    why = f"wind is ({', '.join(f'{x:g}' for x in domain.wind)}) m/s"
    why_not = "no side is open for the wind to come in" if any(domain.wind) else "wind is 0"
    choose("blow_wind", windy, why, why_not, makes="velocity")
    partial = [e for e in emitters if isinstance(e, Emitter) and e.is_partial]
    why = f"{_paths(partial)} makes smoke by noise or in its surface"
    why_not = "all emitters make smoke evenly in all their inside"
    choose("vary_emission", partial, why, why_not, makes="shares of cells")
    from_arrays = "arrays" if any(isinstance(e, ArrayEmitter) for e in emitters) else ""
    choose("emit_density", True, f"{_paths(emitters)} makes smoke", "", makes="density", method=from_arrays)
    asks = "buoyancy reads it" if buoyant_by_heat else "it is among the exported grids"
    choose("emit_temperature", has_heat, asks, cold, makes="temperature")
    why, why_not = f"{_paths(pushing)} pushes the air", "no emitter has a velocity or moves"
    choose("emit_velocity", pushing, why, why_not, makes="velocity")
    why = "smoke is hotter or colder than the air" if buoyant_by_heat else "smoke has weight"
    why_not = "no emitter makes smoke that buoyancy acts on"
    choose("add_buoyancy", buoyant_by_heat or buoyant_by_weight, why, why_not, makes="velocity")
    why = f"turbulence is {domain.turbulence:g} m/s²"
    choose("stir_air", domain.turbulence, why, "turbulence is 0", makes="velocity")
    why_not = still if domain.vorticity else "vorticity is 0"
    choose(
        "confine_vorticity", flows and domain.vorticity, f"vorticity is {domain.vorticity:g}", why_not, makes="velocity"
    )
    sticky = domain.boundary is not None and "no_slip" in domain.boundary
    why = f"viscosity is {domain.viscosity:g} m²/s; {diffusion_why}"
    rough = [each for each in colliders if isinstance(each, Collider) and each.friction]
    slips = "viscosity is 0" + ", so air slides along the sides that are no_slip too" * sticky
    slips += f", so air slides along {_paths(rough)}" if rough else ""
    why_not = still if domain.viscosity else slips
    choose("diffuse_velocity", flows and domain.viscosity, why, why_not, makes="velocity", method=diffusion_solver)
    why = f"{stirred_by} moves the air; " * bool(stirred_by) + f"air keeps its volume; {solver_why}"
    choose("project_pressure", flows, why, still, makes="velocity without divergence", method=solver)
    why = "air and smoke are carried where there is smoke or fast air, and around it, and nowhere else"
    why_not = still if domain.active_box else "activeBox is false"
    choose("fit_active_box", flows and domain.active_box, why, why_not, makes="cells that are active")
    choose("advect_velocity", flows, "air carries its own motion along", still, makes="velocity", method=scheme)
    choose("advect_density", flows, "air carries smoke along", still, makes="density", method=scheme)
    why, why_not = "air carries heat along", still if has_heat else cold
    choose("advect_temperature", flows and has_heat, why, why_not, makes="temperature", method=scheme)
    spread, why_not = domain.density_diffusion, "densityDiffusion is 0"
    why = f"densityDiffusion is {spread:g} m²/s; {diffusion_why}"
    choose("diffuse_density", spread, why, why_not, makes="density", method=diffusion_solver)
    spread = domain.temperature_diffusion
    why, why_not = f"temperatureDiffusion is {spread:g} m²/s; {diffusion_why}", "temperatureDiffusion is 0"
    why_not = why_not if has_heat else cold
    asked = has_heat and spread
    choose("diffuse_temperature", asked, why, why_not, makes="temperature", method=diffusion_solver)
    rate = domain.density_dissipation
    choose("dissipate_density", rate, f"densityDissipation is {rate:g}/s", "densityDissipation is 0", makes="density")
    rate = domain.temperature_cooling
    why, why_not = f"temperatureCooling is {rate:g}/s", "temperatureCooling is 0" if has_heat else cold
    choose("cool_temperature", has_heat and rate, why, why_not, makes="temperature")

    dark = not any(scene.ambient) and not any(light.shines for light in scene.lights)
    needless = {"velocity": not flows and still, "light": dark and "no light shines"}
    grids = tuple(grid for grid in domain.grids if not needless.get(grid))
    for grid in set(domain.grids) - set(grids):
        ledger.omit(f"write {grid}", (domain.path,), needless[grid])
    ledger.keep("write_volume", (domain.path,), When.FRAME, ", ".join(grids), "the domain's smoke is exported")
    tolerance = domain.pressure_tolerance or DEFAULT_TOLERANCE
    return DomainPlan(
        domain, lattice, tuple(kept), emitters, colliders, scheme, solver, tolerance, diffusion_solver, grids
    )


def _paths(prims: list | tuple) -> str:
    return ", ".join(prim.path for prim in prims)


def _heats(emitter: Emitter | ArrayEmitter, ambient: float) -> bool:
    """Whether its smoke may be hotter or colder than the air; what an array holds may change."""
    if isinstance(emitter, ArrayEmitter):
        return emitter.temperature is not None
    return bool(np.any(each_value(emitter.temperature) != ambient))


def _weighs(emitter: Emitter | ArrayEmitter) -> bool:
    """Whether it may make smoke that has a density."""
    if isinstance(emitter, ArrayEmitter):
        return emitter.density is not None
    return bool(np.any(each_value(emitter.density)))


def _pushes(emitter: Emitter | ArrayEmitter) -> bool:
    """Whether it may give the air a velocity."""
    if isinstance(emitter, ArrayEmitter):
        return emitter.velocity is not None
    return bool(np.any(each_value(emitter.velocity)) or (emitter.inherit_velocity and is_moving(emitter)))


def _covers(record: ArrayEmitter | ArrayCollider, domain: SmokeDomain, lattice: Lattice) -> bool:
    """Whether a record's arrays are meant for a domain.

    Raises:
        FieldError: they are, and do not fit its cells.
    """
    if record.domain not in (None, domain.path):
        return False
    check_cells(record, lattice.shape)
    return True


def _emitters(
    ledger: Ledger, scene: Scene, domain: SmokeDomain, lattice: Lattice
) -> tuple[Emitter | ArrayEmitter, ...]:
    found = []
    for emitter in scene.emitters:
        if isinstance(emitter, ArrayEmitter):
            if _covers(emitter, domain, lattice):
                found.append(emitter)
            else:
                ledger.omit("emit", (domain.path, emitter.path), f"{emitter.path} is for {emitter.domain}")
            continue
        gives = emitter.density if emitter.rate is None else emitter.rate
        corners = swept_corners(emitter, scene.frames)
        if not np.any(over(emitter.enabled, scene.frames)):
            why = f"{emitter.path} is off at every frame"
        elif not np.any(each_value(gives)) and not np.any(each_value(emitter.temperature)):
            why = f"{emitter.path} makes no smoke: its density or rate is 0"
        elif not may_touch(lattice, corners):
            why = f"{emitter.path} never touches {domain.path}"
        else:
            found.append(emitter)
            continue
        ledger.omit("emit", (domain.path, emitter.path), why)
    return tuple(found)


def _colliders(
    ledger: Ledger, scene: Scene, domain: SmokeDomain, lattice: Lattice
) -> tuple[Collider | ArrayCollider, ...]:
    found = []
    for collider in scene.colliders:
        if isinstance(collider, ArrayCollider):
            if _covers(collider, domain, lattice):
                found.append(collider)
            else:
                ledger.omit("collide", (domain.path, collider.path), f"{collider.path} is for {collider.domain}")
        elif may_touch(lattice, swept_corners(collider, scene.frames)):
            found.append(collider)
        else:
            why = f"{collider.path} never touches {domain.path}"
            ledger.omit("collide", (domain.path, collider.path), why)
    return tuple(found)


def _pressure_solver(domain: SmokeDomain, colliders: tuple[Collider | ArrayCollider, ...]) -> tuple[str, str]:
    """The solver, and why it is taken."""
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
    """The solver, and why it is taken."""
    solver = domain.diffusion_solver
    if solver is None and colliders:
        return "jacobi", f"jacobi knows {_paths(colliders)}"
    if solver is None:
        return "spectral", "spectral is exact where no collider is in the domain"
    if solver == "spectral" and colliders:
        others = ", ".join(name for name in DIFFUSION_SOLVERS if name != "spectral")
        allowed = f"{others}, since {colliders[0].path} is a collider in it"
        raise FieldError(domain.path, "diffusion_solver", solver, allowed)
    return solver, f"diffusionSolver is {solver}"
