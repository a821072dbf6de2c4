"""The smoke domain, and the emitters and colliders in it; physical quantities are in SI units."""

from dataclasses import dataclass

import numpy as np

from warp_smoke.geometry import Mesh, Points
from warp_smoke.record import (
    SMALLEST,
    FieldError,
    Samples,
    at_least,
    each_value,
    finite,
    flag,
    one_of,
    positive,
    switch,
    tokens,
    whole,
)
from warp_smoke.scene.prim import Prim

SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")
BOUNDARIES = ("open", "closed", "no_slip", "periodic")
ADVECTION_SCHEMES = ("semi_lagrangian", "semi_lagrangian_cubic", "maccormack", "bfecc")
PRESSURE_SOLVERS = (
    "spectral",
    "multigrid",
    "spectral_conjugate_gradient",
    "conjugate_gradient",
    "red_black",
    "jacobi",
)
DIFFUSION_SOLVERS = ("spectral", "jacobi")
SOURCES = ("volume", "surface")
GRIDS = ("density", "temperature", "velocity", "light")
MAX_RESOLUTION = 4096


@dataclass(frozen=True, eq=False, kw_only=True)
class SmokeDomain(Prim):
    """A box in which smoke lives, and how it behaves there (USD: `SmokeDomainAPI`).

    Attributes:
        lower, upper: corners in local space; the transform may turn and scale the box but not shear it.
        resolution: cells along the longest side; cells are cubes.
        boundary: open, closed (air slides along it), no_slip (closed, and viscous air sticks to it) or periodic (what
            leaves re-enters on the opposite side, which must be periodic too) for each of the sides
            -x +x -y +y -z +z of the box; None = open, with the bottom closed.
        time_scale: seconds of smoke for each second of the stage.
        max_courant: largest max|u| dt / h of a substep.
        buoyancy_density: α, downward acceleration per unit of density [m/s²].
        buoyancy_temperature: β, upward acceleration per degree above ambient [m/s²].
        ambient_temperature: temperature of the air.
        vorticity: strength ε of vorticity confinement (0 = off).
        turbulence: root mean square of a random force that stirs all the air [m/s²].
        turbulence_scale: size of its eddies [m], at least two cells; None = an eighth of the longest side.
        viscosity: kinematic viscosity ν of the air [m²/s].
        wind: velocity of the air at the start, and of the air that enters through open sides, along the stage's axes
            [m/s].
        density_diffusion, temperature_diffusion: diffusivity of smoke and of heat [m²/s].
        density_dissipation, temperature_cooling: decay rates [1/s].
        extinction: σ [1/m] at density 1.
        extinction_color: factor on σ for red, green and blue; shadows take the colours that are let through.
        albedo: fraction of the extinguished light that is scattered, linear RGB; used by the light grid.
        density_scale: factor on the exported density.
        grids: fields written to the volume files: density, temperature, velocity, light (what the smoke scatters).
        active_box: whether advection is limited to a box around the smoke and the fast air.
        advection, pressure_solver, pressure_tolerance, diffusion_solver: None = chosen by the plan.
        diffusion_sweeps: most sweeps of the diffusion solver jacobi, for each field and substep.
    """

    lower: tuple[float, float, float] = (-1.0, -1.0, -1.0)
    upper: tuple[float, float, float] = (1.0, 1.0, 1.0)
    resolution: int = 64
    boundary: tuple[str, ...] | None = None
    time_scale: float = 1.0
    max_courant: float = 4.0
    buoyancy_density: float = 0.0
    buoyancy_temperature: float = 1.0
    ambient_temperature: float = 0.0
    vorticity: float = 0.0
    turbulence: float = 0.0
    turbulence_scale: float | None = None
    viscosity: float = 0.0
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    density_diffusion: float = 0.0
    temperature_diffusion: float = 0.0
    density_dissipation: float = 0.0
    temperature_cooling: float = 0.0
    extinction: float = 4.0
    extinction_color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    albedo: tuple[float, float, float] = (1.0, 1.0, 1.0)
    density_scale: float = 1.0
    grids: tuple[str, ...] = ("density", "velocity")
    active_box: bool = True
    advection: str | None = None
    pressure_solver: str | None = None
    pressure_tolerance: float | None = None
    diffusion_solver: str | None = None
    diffusion_sweeps: int = 20

    def __post_init__(self):
        super().__post_init__()
        self._check(finite, "lower", "upper", shape=(3,))
        if not all(a < b for a, b in zip(self.lower, self.upper, strict=True)):
            raise FieldError(self.path, "upper", self.upper, f"greater than lower {self.lower} on each axis")
        self._check(whole, "resolution", low=1, high=MAX_RESOLUTION)
        self._check(positive, "time_scale", "max_courant", "density_scale")
        self._check(finite, "buoyancy_density", "buoyancy_temperature", "ambient_temperature")
        self._check(finite, "wind", shape=(3,))
        if self.turbulence_scale is not None:
            self._check(positive, "turbulence_scale")
        self._check(at_least, "turbulence", "vorticity", "viscosity", "density_diffusion", "density_dissipation")
        self._check(at_least, "temperature_diffusion", "temperature_cooling", "extinction")
        self._check(at_least, "extinction_color", "albedo", shape=(3,))
        if max(self.albedo) > 1:
            raise FieldError(self.path, "albedo", self.albedo, "0 to 1")
        if self.boundary is not None:
            self._check(tokens, "boundary", allowed=BOUNDARIES)
            if len(self.boundary) != len(SIDES):
                raise FieldError(self.path, "boundary", self.boundary, "six tokens, one for each of " + " ".join(SIDES))
            pairs = zip(self.boundary[0::2], self.boundary[1::2], strict=True)
            if any("periodic" in pair and pair[0] != pair[1] for pair in pairs):
                allowed = "periodic on both of two opposite sides, or on neither"
                raise FieldError(self.path, "boundary", self.boundary, allowed)
        self._check(flag, "active_box")
        self._check(tokens, "grids", allowed=GRIDS)
        self._store("grids", tuple(dict.fromkeys(self.grids)))
        if self.advection is not None:
            self._check(one_of, "advection", allowed=ADVECTION_SCHEMES)
        if self.pressure_solver is not None:
            self._check(one_of, "pressure_solver", allowed=PRESSURE_SOLVERS)
        if self.pressure_tolerance is not None:
            self._check(positive, "pressure_tolerance")
        if self.diffusion_solver is not None:
            self._check(one_of, "diffusion_solver", allowed=DIFFUSION_SOLVERS)
        self._check(whole, "diffusion_sweeps", low=1, high=10_000)
        for matrix in each_value(self.transform):
            axes = matrix[:3, :3]
            lengths = np.linalg.norm(axes, axis=1)
            if lengths.min() <= 0 or np.abs(axes @ axes.T - np.diag(lengths**2)).max() > 1e-4 * lengths.max() ** 2:
                raise FieldError(
                    self.path, "transform", matrix[:3, :3].tolist(), "axes of non-zero length at right angles"
                )
            sides = lengths * (np.array(self.upper) - self.lower)
            if sides.min() < SMALLEST:
                raise FieldError(
                    self.path, "upper", self.upper, f"a box with sides of at least {SMALLEST:g} in the world"
                )
        self._check_reach(np.array([self.lower, self.upper]))

    @property
    def dims_light(self) -> bool:
        """Whether its smoke casts a shadow."""
        return bool(self.extinction and any(self.extinction_color))

    @property
    def colors_light(self) -> bool:
        """Whether its smoke dims some colours more than others."""
        return bool(self.extinction and np.ptp(self.extinction_color))


@dataclass(frozen=True, eq=False, kw_only=True)
class Emitter(Prim):
    """A mesh, or a set of points, that emits smoke from its inside (USD: `SmokeEmitterAPI`).

    Attributes:
        mesh: its shape, in local space; points are small spheres.
        density, temperature: those of the smoke it emits; may change.
        rate: [1/s], smoke of `density` added each second; None = the values are held inside the mesh; may change.
        velocity: [m/s] along the stage's axes, imposed on air that is slower in that direction; may change.
        inherit_velocity: fraction of the emitter's own motion given to the smoke.
        source: volume (the whole inside) or surface (a skin one voxel thick).
        noise: how far noise in space and time lowers density and temperature: 0 = not at all, 1 = down to nothing.
        noise_scale: size of the noise's features [stage units]; None = a quarter of the emitter's longest side.
        turbulence: root mean square of a random force that stirs the air inside it [m/s²], with the domain's
            `turbulence_scale`.
        enabled: whether it emits; may change.
    """

    mesh: Mesh | Points
    density: float | Samples = 1.0
    temperature: float | Samples = 1.0
    rate: float | Samples | None = None
    velocity: tuple[float, float, float] | Samples = (0.0, 0.0, 0.0)
    inherit_velocity: float = 1.0
    source: str = "volume"
    noise: float = 0.0
    noise_scale: float | None = None
    turbulence: float = 0.0
    enabled: bool | Samples = True

    def __post_init__(self):
        super().__post_init__()
        self._check_reach(self.mesh.points)
        self._check(at_least, "density")
        self._check(finite, "temperature", "inherit_velocity")
        self._check(finite, "velocity", shape=(3,))
        self._check(switch, "enabled")
        if self.rate is not None:
            self._check(at_least, "rate")
        self._check(one_of, "source", allowed=SOURCES)
        self._check(at_least, "noise", "turbulence")
        if self.noise > 1:
            raise FieldError(self.path, "noise", self.noise, "0 to 1")
        if self.noise_scale is not None:
            self._check(positive, "noise_scale")

    @property
    def is_partial(self) -> bool:
        """Whether it emits less smoke in some of the cells inside it than in others."""
        return self.noise > 0.0 or self.source == "surface"


@dataclass(frozen=True, eq=False, kw_only=True)
class Collider(Prim):
    """A mesh that smoke flows around (USD: `SmokeColliderAPI`).

    Attributes:
        mesh: its shape, in local space.
        thickness: layer added around the mesh [voxels].
        friction: how strongly it holds back viscous air moving along it: 0 = slip, 1 = no slip.
    """

    mesh: Mesh
    thickness: float = 0.0
    friction: float = 0.0

    def __post_init__(self):
        super().__post_init__()
        self._check_reach(self.mesh.points)
        self._check(at_least, "thickness", "friction")
        if self.friction > 1:
            raise FieldError(self.path, "friction", self.friction, "0 to 1")
