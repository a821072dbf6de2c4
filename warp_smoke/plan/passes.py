"""The parts of a plan: passes that run, passes that do not, and the same grouped for the executor."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from warp_smoke.lattice import Lattice
from warp_smoke.scene import ArrayCollider, ArrayEmitter, Collider, Emitter, Light, SmokeDomain, Surface

# The fluid first, then what reads its density; within each group in the order in which a step runs them.
PASS_NAMES = (
    "voxelize_colliders",
    "blow_wind",
    "vary_emission",
    "emit_density",
    "emit_temperature",
    "emit_velocity",
    "add_buoyancy",
    "stir_air",
    "confine_vorticity",
    "diffuse_velocity",
    "project_pressure",
    "fit_active_box",
    "advect_velocity",
    "advect_density",
    "advect_temperature",
    "diffuse_density",
    "diffuse_temperature",
    "dissipate_density",
    "cool_temperature",
    "write_volume",
    "trace_shadow_map",
    "write_depth_map",
    "surface_visibility",
    "shade_light",
    "project_smoke",
    "smoke_transmittance",
    "light_volume",
    "bake",
)


class When(StrEnum):
    """How often a pass runs."""

    ONCE = "once"
    FRAME = "each frame"
    SUBSTEP = "each substep"


@dataclass(frozen=True)
class Pass:
    """One pass: something that is computed.

    Attributes:
        name: one of PASS_NAMES.
        subjects: prim paths that it is run for.
        when: how often.
        makes: the result, in words.
        why: what asks for it.
        method: the method chosen, if there are several; else empty.
    """

    name: str
    subjects: tuple[str, ...]
    when: When
    makes: str
    why: str
    method: str = ""

    def __str__(self) -> str:
        method = f" [{self.method}]" if self.method else ""
        return f"{self.name}{method}  {' × '.join(self.subjects)}  ({self.when}): {self.why}"


@dataclass(frozen=True)
class LeftOut:
    """A pass that does not run, and why not."""

    name: str
    subjects: tuple[str, ...]
    why: str

    def __str__(self) -> str:
        return f"{self.name}  {' × '.join(self.subjects)}: {self.why}"


class Ledger:
    """The passes and omissions found so far while a plan is being made."""

    def __init__(self):
        self.passes: dict[tuple, Pass] = {}
        self.left_out: dict[tuple, LeftOut] = {}

    def keep(self, name: str, subjects: tuple[str, ...], when: When, makes: str, why: str, method: str = "") -> None:
        """Records a pass, once for each combination of name and subjects."""
        self.passes.setdefault((name, subjects), Pass(name, subjects, when, makes, why, method))

    def omit(self, name: str, subjects: tuple[str, ...], why: str) -> None:
        """Records that a pass is not run, with the first reason for its name and subjects."""
        self.left_out.setdefault((name, subjects), LeftOut(name, subjects, why))

    def in_order(self) -> tuple[Pass, ...]:
        """Returns the passes in the order in which they run."""
        return tuple(sorted(self.passes.values(), key=lambda each: PASS_NAMES.index(each.name)))


@dataclass(frozen=True)
class DomainPlan:
    """The fluid passes of one domain.

    Attributes:
        passes: names of the passes that run.
        emitters, colliders: those that touch the domain.
        advection, pressure_solver, pressure_tolerance, diffusion_solver: the schemes.
        grids: what is written to the volume file.
    """

    domain: SmokeDomain
    lattice: Lattice
    passes: tuple[str, ...]
    emitters: tuple[Emitter | ArrayEmitter, ...]
    colliders: tuple[Collider | ArrayCollider, ...]
    advection: str
    pressure_solver: str
    pressure_tolerance: float
    diffusion_solver: str
    grids: tuple[str, ...]


class SmokeShadowPlan(NamedTuple):
    """How smoke that may lie between one light and one receiver is treated.

    Attributes:
        domain: the domain that holds the smoke.
        method: the smoke shadow method.
        layer: slices in each layer of the light buffer; None = all, where the receiver is outside the domain.
    """

    domain: DomainPlan
    method: str
    layer: int | None


@dataclass(frozen=True)
class LightPlan:
    """What one light does for one receiver.

    Attributes:
        surface_shadow: cube, spot, directional, exact or area; None = no surface casts a shadow.
        smoke: one for each domain whose smoke may lie between them.
        when: how often the light's radiance and surface shadow change.
    """

    light: Light
    surface_shadow: str | None
    smoke: tuple[SmokeShadowPlan, ...]
    when: When


@dataclass(frozen=True)
class ReceiverPlan:
    """What is baked for one surface, how often each bake changes, and the lights that reach it."""

    surface: Surface
    bakes: dict[str, When]
    lights: tuple[LightPlan, ...]


@dataclass(frozen=True)
class VolumePlan:
    """The light inside one domain's smoke, and the lights that reach it."""

    domain: DomainPlan
    lights: tuple[LightPlan, ...]


@dataclass(frozen=True)
class DepthPlan:
    """The lights whose shadow maps are written as pictures for one surface."""

    surface: Surface
    lights: tuple[LightPlan, ...]


def buffer_layers(lights: Iterable[LightPlan]) -> dict[tuple[str, str, str], int | None]:
    """Returns the slices in each layer of shared light buffers by light path, domain path and method; None = all."""
    layers: dict[tuple[str, str, str], int | None] = {}
    for light in lights:
        for each in light.smoke:
            key = (light.light.path, each.domain.domain.path, each.method)
            layers[key] = min(filter(None, (layers.get(key), each.layer)), default=None)
    return layers
