"""Which effects a scene calls for: the passes that its outputs need, in order, and why every other pass is left out.

The plan walks back from the outputs (volume files, baked textures) to what they need, and keeps only that.
`simulation.py` runs exactly the passes that stand here.
"""

from dataclasses import dataclass, field

import numpy as np

from warp_smoke.lattice import Lattice, place_lattice
from warp_smoke.reach import in_box, in_range, light_in_box, may_shadow, swept_corners, times_in
from warp_smoke.record import FieldError, Samples, each_value
from warp_smoke.scene import Collider, DistantLight, Emitter, Light, Scene, SmokeDomain, Surface

DEFAULT_TOLERANCE = 1e-3
ONCE, EACH_FRAME, EACH_SUBSTEP = "once", "each frame", "each substep"


@dataclass(frozen=True)
class Pass:
    """One thing that is computed.

    Attributes:
        name: what is done; the executor has one method or kernel group for it.
        subjects: prim paths that it is done for; the first one is the place (domain, receiver or light) that owns
            the result.
        when: once, each frame or each substep.
        makes: the result, in words.
        why: what asks for it.
        method: which of several methods, where there is a choice.
        needs: names of the passes whose results it reads.
    """

    name: str
    subjects: tuple[str, ...]
    when: str
    makes: str
    why: str
    method: str = ""
    needs: tuple[str, ...] = ()


@dataclass(frozen=True)
class LeftOut:
    """A pass that nothing needs, and why not."""

    name: str
    subjects: tuple[str, ...]
    why: str


@dataclass(frozen=True)
class DomainPlan:
    """The fluid passes of one domain.

    Attributes:
        passes: names of the passes that are kept.
        emitters, colliders: those that touch the domain.
        advection, pressure_solver, pressure_tolerance: the schemes.
        grids: what is written to the volume file.
    """

    domain: SmokeDomain
    lattice: Lattice
    passes: tuple[str, ...]
    emitters: tuple[Emitter, ...]
    colliders: tuple[Collider, ...]
    advection: str
    pressure_solver: str
    pressure_tolerance: float
    grids: tuple[str, ...]


@dataclass(frozen=True)
class LightPlan:
    """What one light does for one receiver.

    Attributes:
        surface_shadow: cube, directional or exact; None = nothing stands between them.
        smoke: the domains whose smoke may stand between them, and the method of each.
        when: once or each frame: how often the light's radiance and surface shadow change.
    """

    light: Light
    surface_shadow: str | None
    smoke: tuple[tuple[DomainPlan, str], ...]
    when: str


@dataclass(frozen=True)
class ReceiverPlan:
    """What is baked for one surface, and the lights that reach it."""

    surface: Surface
    bakes: tuple[str, ...]
    lights: tuple[LightPlan, ...]
    when: str


@dataclass(frozen=True)
class Plan:
    """What is run for a scene.

    Attributes:
        passes: in the order in which they run.
        left_out: what is not run.
        domains, receivers: the same, as the executor reads it.
        bytes: estimate of device memory by pass group [bytes].
    """

    scene: Scene
    passes: tuple[Pass, ...]
    left_out: tuple[LeftOut, ...]
    domains: tuple[DomainPlan, ...]
    receivers: tuple[ReceiverPlan, ...]
    bytes: dict[str, int] = field(default_factory=dict)

    def __str__(self) -> str:
        lines = ["Passes, in order:"]
        for each in self.passes:
            method = f" [{each.method}]" if each.method else ""
            lines.append(f"  {each.name}{method}  {' × '.join(each.subjects)}  ({each.when}): {each.why}")
        lines += ["Left out:"] + [f"  {out.name}  {' × '.join(out.subjects)}: {out.why}" for out in self.left_out]
        lines.append(f"Memory: {sum(self.bytes.values()) / 2**20:.0f} MiB")
        return "\n".join(lines)


def make_plan(scene: Scene) -> Plan:
    """Works out which passes a scene's outputs need.

    Raises:
        FieldError: a domain asks for schemes that cannot serve it.
    """
    return _Planner(scene).plan()


def is_moving(*prims) -> bool:
    """Whether any of the prims changes place or shape."""
    return any(prim.moves or (hasattr(prim, "mesh") and prim.mesh.deforms) for prim in prims)


class _Planner:
    def __init__(self, scene: Scene):
        self.scene, self.frames = scene, scene.frames
        self.passes: dict[tuple, Pass] = {}
        self.left_out: dict[tuple, LeftOut] = {}

    def plan(self) -> Plan:
        domains = tuple(filter(None, (self._domain(domain) for domain in self.scene.domains)))
        if not self.scene.domains:
            self._omit("simulate", (), "the stage has no smoke domain")
        receivers = self._receivers(domains)
        order = {name: n for n, name in enumerate(_ORDER)}
        passes = sorted(self.passes.values(), key=lambda each: order[each.name])
        estimate = {each.domain.path: fluid_bytes(each) for each in domains}
        estimate |= {each.surface.path: receiver_bytes(each) for each in receivers}
        return Plan(self.scene, tuple(passes), tuple(self.left_out.values()), domains, receivers, estimate)

    def _keep(self, name: str, subjects: tuple[str, ...], when: str, makes: str, why: str, **more) -> None:
        self.passes.setdefault((name, subjects), Pass(name, subjects, when, makes, why, **more))

    def _omit(self, name: str, subjects: tuple[str, ...], why: str) -> None:
        self.left_out.setdefault((name, subjects), LeftOut(name, subjects, why))

    # Fluid

    def _domain(self, domain: SmokeDomain) -> DomainPlan | None:
        lattice = place_lattice(self.scene, domain)
        emitters = self._emitters(domain, lattice)
        if not emitters:
            self._omit("simulate", (domain.path,), "no emitter that is ever on touches it, so it never holds smoke")
            return None
        colliders = self._colliders(domain, lattice)
        here = (domain.path,)
        kept: list[str] = []

        def choose(name, asked, makes, why, why_not, when=EACH_SUBSTEP, **more):
            if asked:
                kept.append(name)
                self._keep(name, here, when, makes, why, **more)
            else:
                self._omit(name, here, why_not)
            return bool(asked)

        hot = any(np.any(each_value(e.temperature) != domain.ambient_temperature) for e in emitters)
        thermal = domain.buoyancy_temperature != 0 and hot
        heavy = domain.buoyancy_density != 0 and any(np.any(each_value(e.density)) for e in emitters)
        warm = thermal or "temperature" in domain.grids
        pushing = [e for e in emitters if np.any(each_value(e.velocity)) or (e.inherit_velocity and is_moving(e))]
        moving_colliders = [c for c in colliders if is_moving(c)]
        driven = thermal or heavy or pushing or moving_colliders
        still = "nothing moves the air: no buoyancy, no moving emitter or collider"

        names = ", ".join(e.path for e in emitters)
        choose("emit_density", True, "density", f"{names} make smoke", "")
        asks = "buoyancy reads it" if thermal else "it is among the exported grids"
        cold = (
            "no buoyancy reads it (no emitter differs from ambient, or buoyancyTemperature is 0) and it is not exported"
        )
        choose("emit_temperature", warm, "temperature", asks, cold)
        pushes = ", ".join(e.path for e in pushing)
        resting = "no emitter has a velocity or moves"
        choose("emit_velocity", pushing, "velocity", f"{pushes} push the air", resting)
        when = EACH_SUBSTEP if moving_colliders else ONCE
        solid = ", ".join(c.path for c in colliders)
        choose("voxelize_colliders", driven and colliders, "solid cells", f"smoke flows around {solid}",
               still if colliders else "no collider touches the domain", when)  # fmt: skip
        why = "smoke is hotter or colder than the air" if thermal else "dense smoke sinks or rises"
        choose("add_buoyancy", thermal or heavy, "velocity", why, "no emitter makes smoke that buoyancy acts on")
        choose("confine_vorticity", driven and domain.vorticity, "velocity", f"vorticity is {domain.vorticity:g}",
               still if domain.vorticity else "vorticity is 0")  # fmt: skip
        solver, tolerance = self._pressure(domain, colliders)
        choose("project_pressure", driven, "velocity without divergence", "air keeps its volume", still, method=solver)
        scheme = domain.advection or "maccormack"
        choose("advect_velocity", driven, "velocity", "air carries its own motion along", still, method=scheme)
        choose("advect_density", driven, "density", "air carries smoke along", still, method=scheme)
        choose("advect_temperature", driven and warm, "temperature", "air carries heat along",
               still if warm else cold, method=scheme)  # fmt: skip
        choose("dissipate_density", domain.density_dissipation, "density",
               f"densityDissipation is {domain.density_dissipation:g}/s", "densityDissipation is 0")  # fmt: skip
        choose("cool_temperature", warm and domain.temperature_cooling, "temperature",
               f"temperatureCooling is {domain.temperature_cooling:g}/s",
               "temperatureCooling is 0" if warm else cold)  # fmt: skip
        grids = tuple(g for g in domain.grids if g != "velocity" or driven)
        if "velocity" in domain.grids and not driven:
            self._omit("write velocity", here, still)
        self._keep("write_volume", here, EACH_FRAME, ", ".join(grids), "the domain's smoke is exported")
        return DomainPlan(domain, lattice, tuple(kept), emitters, colliders, scheme, solver, tolerance, grids)

    def _emitters(self, domain: SmokeDomain, lattice: Lattice) -> tuple[Emitter, ...]:
        found = []
        for emitter in self.scene.emitters:
            pair = (domain.path, emitter.path)
            gives = emitter.density if emitter.rate is None else emitter.rate
            corners = swept_corners(emitter, self.frames)
            if not np.any(_over(emitter.enabled, self.frames)):
                self._omit("emit", pair, f"{emitter.path} is off at every frame")
            elif not np.any(each_value(gives)) and not np.any(each_value(emitter.temperature)):
                self._omit("emit", pair, f"{emitter.path} makes no smoke (density or rate is 0)")
            elif not len(corners) or not in_box(lattice, corners):
                self._omit("emit", pair, f"{emitter.path} never touches {domain.path}")
            else:
                found.append(emitter)
        return tuple(found)

    def _colliders(self, domain: SmokeDomain, lattice: Lattice) -> tuple[Collider, ...]:
        found = []
        for collider in self.scene.colliders:
            corners = swept_corners(collider, self.frames)
            if len(corners) and in_box(lattice, corners):
                found.append(collider)
            else:
                self._omit("collide", (domain.path, collider.path), f"{collider.path} never touches {domain.path}")
        return tuple(found)

    def _pressure(self, domain: SmokeDomain, colliders: tuple) -> tuple[str, float]:
        solver = domain.pressure_solver or ("conjugate_gradient" if colliders else "spectral")
        if solver == "spectral" and colliders:
            allowed = f"conjugate_gradient, since {colliders[0].path} is a collider in it"
            raise FieldError(domain.path, "pressure_solver", solver, allowed)
        return solver, domain.pressure_tolerance or DEFAULT_TOLERANCE

    # Shadows and shading

    def _receivers(self, domains: tuple[DomainPlan, ...]) -> tuple[ReceiverPlan, ...]:
        candidates = [s for s in self.scene.surfaces if s.receiver is not None]
        if not candidates:
            self._omit("bake", (), "no mesh has SmokeReceiverAPI, so no light, shadow or texture is computed")
            return ()
        lights = []
        for light in self.scene.lights:
            if not np.any(_over(light.enabled, self.frames)):
                self._omit("light", (light.path,), "it is off at every frame")
            elif not light.shines:
                self._omit("light", (light.path,), "its intensity or colour is 0 at every frame")
            else:
                lights.append(light)
        plans = []
        for surface in candidates:
            if not np.any(_over(surface.visible, self.frames)):
                self._omit("bake", (surface.path,), "it is invisible at every frame")
            elif not surface.receiver.bake:
                self._omit("bake", (surface.path,), "smoke:bake names no texture")
            elif not lights and not any(self.scene.ambient):
                self._omit("bake", (surface.path,), "no light shines on it")
            else:
                plans.append(self._receiver(surface, lights, domains))
        return tuple(plans)

    def _receiver(self, surface: Surface, lights: list[Light], domains: tuple[DomainPlan, ...]) -> ReceiverPlan:
        corners = swept_corners(surface, self.frames)
        reaching = []
        for light in lights:
            if in_range(light, corners, self.frames):
                reaching.append(self._light(light, surface, corners, domains))
            else:
                self._omit("shade_light", (surface.path, light.path), f"{surface.path} lies beyond its falloffEnd")
        bakes = surface.receiver.bake
        shadowed = any(each.surface_shadow for each in reaching)
        smoky = any(each.smoke for each in reaching)
        kept = []
        for bake in bakes:
            if bake == "visibility" and not shadowed:
                self._omit("bake visibility", (surface.path,), "nothing casts a shadow on it")
            elif bake == "smokeShadow" and not smoky:
                self._omit("bake smokeShadow", (surface.path,), "no smoke can shadow it")
            else:
                kept.append(bake)
        changing = smoky or any(each.when == EACH_FRAME for each in reaching)
        when = EACH_FRAME if changing or is_moving(surface) else ONCE
        for bake in kept:
            why = f"smoke:bake asks for {bake}"
            self._keep("bake", (surface.path, bake), when, f"{bake} texture", why)
        return ReceiverPlan(surface, tuple(kept), tuple(reaching), when)

    def _light(self, light: Light, surface: Surface, corners: np.ndarray, domains: tuple) -> LightPlan:
        pair = (surface.path, light.path)
        bakes = surface.receiver.bake
        casters = self._casters(light, surface, corners) if {"lit", "visibility"} & set(bakes) else []
        method = None
        if casters:
            if light.shadow_filter == "exact":
                method = "exact"
            else:
                method = "directional" if isinstance(light, DistantLight) else "cube"
        varies = any(isinstance(v, Samples) for v in (light.intensity, light.enabled)) or is_moving(light, surface)
        # A highlight follows the camera.
        varies |= self.scene.camera is not None and is_moving(self.scene.camera)
        caster_moves = any(is_moving(c) or isinstance(c.visible, Samples) for c in casters)
        when = EACH_FRAME if varies or caster_moves else ONCE
        if method:
            names = ", ".join(c.path for c in casters[:3]) + (
                f" and {len(casters) - 3} more" if len(casters) > 3 else ""
            )
            if method != "exact":
                moves = caster_moves or is_moving(light)
                makes, why = "depth map", f"{names} may shadow {surface.path}"
                self._keep("trace_shadow_map", (light.path,), EACH_FRAME if moves else ONCE, makes, why, method=method)
            why = f"{names} may stand between the light and it"
            self._keep("surface_visibility", pair, when, "share of light past surfaces", why, method=method)
        smoke = self._smoke(light, surface, corners, domains) if {"lit", "smokeShadow"} & set(bakes) else ()
        if smoke:
            places = ", ".join(each.domain.path for each, _ in smoke)
            why = f"smoke in {places} may stand between the light and it"
            self._keep("smoke_transmittance", pair, EACH_FRAME, "share of light through smoke", why)
        self._keep("shade_light", pair, when, "radiance", "the light shines on it")
        return LightPlan(light, method, smoke, when)

    def _casters(self, light: Light, surface: Surface, corners: np.ndarray) -> list[Surface]:
        pair = (surface.path, light.path)
        if not light.shadow_enable:
            self._omit("surface_visibility", pair, f"{light.path} has shadows switched off")
        elif not surface.receiver.receive_shadow:
            self._omit("surface_visibility", pair, "smoke:receiveShadow is false")
        else:
            casters = [
                other
                for other in self.scene.surfaces
                if np.any(_over(other.visible, self.frames))
                and not (other is surface and _is_flat(surface))
                and may_shadow(light, swept_corners(other, self.frames), corners, self.frames)
            ]
            if casters:
                return casters
            self._omit("surface_visibility", pair, "nothing stands between the light and it")
        return []

    def _smoke(self, light: Light, surface: Surface, corners: np.ndarray, domains: tuple) -> tuple:
        pair = (surface.path, light.path)
        if not domains:
            self._omit("smoke_transmittance", pair, "there is no smoke")
        elif not light.shadow_enable:
            self._omit("smoke_transmittance", pair, f"{light.path} has shadows switched off")
        elif not surface.receiver.receive_smoke:
            self._omit("smoke_transmittance", pair, "smoke:receiveSmoke is false")
        else:
            found = []
            for each in domains:
                box = _box_corners(each.lattice)
                three = (each.domain.path, *pair)
                if not each.domain.extinction:
                    self._omit("project_smoke", three, "extinction is 0, so its smoke casts no shadow")
                elif not may_shadow(light, box, corners, self.frames):
                    self._omit("project_smoke", three, "its smoke never stands between the light and the surface")
                else:
                    found.append((each, self._smoke_method(light, each)))
            return tuple(found)
        return ()

    def _smoke_method(self, light: Light, each: DomainPlan) -> str:
        method, why = light.smoke_shadow, f"smoke in {each.domain.path} casts a shadow"
        if method != "ray_traced" and light_in_box(light, each.lattice, self.frames):
            method, why = "ray_traced", f"{why}; the light enters the domain, so no plane behind the smoke can hold it"
        if method != "ray_traced":
            self._keep("project_smoke", (light.path, each.domain.path), EACH_FRAME, "light buffer", why, method=method)
        return method


# Fluid first, then what reads its density; inside each group as a step runs.
_ORDER = (
    "voxelize_colliders",
    "emit_density",
    "emit_temperature",
    "emit_velocity",
    "add_buoyancy",
    "confine_vorticity",
    "project_pressure",
    "advect_velocity",
    "advect_density",
    "advect_temperature",
    "dissipate_density",
    "cool_temperature",
    "write_volume",
    "trace_shadow_map",
    "surface_visibility",
    "shade_light",
    "project_smoke",
    "smoke_transmittance",
    "bake",
)


def _over(value, frames: range) -> np.ndarray:
    """A switch at every frame and at its own samples between them."""
    if not isinstance(value, Samples):
        return np.asarray(value)
    return np.array([value.at(time) for time in times_in(value, frames)])


def _is_flat(surface: Surface) -> bool:
    """Whether all points lie in one plane, so that the surface cannot shadow itself."""
    if surface.mesh.deforms:
        return False
    points = each_value(surface.mesh.points)[0].astype(np.float64)
    if len(points) < 4:
        return True
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[2] <= 1e-6 * spread[0])


def _box_corners(lattice: Lattice) -> np.ndarray:
    """World corners of a lattice's box, [8, 3]."""
    cells = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * lattice.shape
    matrix = lattice.cells_to_world()
    return cells @ matrix[:3, :3] + matrix[3, :3]


def fluid_bytes(plan: DomainPlan) -> int:
    """Estimate of the device memory of a domain's solver [bytes]."""
    raise_if_unplanned = {"advect_density"} <= set(plan.passes)
    return plan.lattice.cells * 4 * (20 if raise_if_unplanned else 2)


def receiver_bytes(plan: ReceiverPlan) -> int:
    """Estimate of the device memory of a receiver's bake [bytes]."""
    texels = plan.surface.receiver.texture_size**2
    return texels * (40 + 20 * len(plan.lights))
