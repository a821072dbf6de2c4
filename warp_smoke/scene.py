"""What a user asks for: the scene as frozen records, checked when they are made.

Lengths are in stage units (`Scene.meters_per_unit`), points and transforms in USD's row-vector convention (p' = p
M). Quantities of the smoke are in SI units. A field marked "may change" takes a plain value or `Samples`.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from warp_smoke.geometry import Mesh, Points
from warp_smoke.material import WRAP_MODES as WRAP_MODES
from warp_smoke.material import Material as Material
from warp_smoke.material import Procedural as Procedural
from warp_smoke.material import Texture as Texture
from warp_smoke.record import (
    FieldError,
    Record,
    Samples,
    at_least,
    each_value,
    finite,
    one_of,
    positive,
    switch,
    value_at,
    whole,
)

AXES = ("X", "Y", "Z")
SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")
BOUNDARIES = ("open", "closed", "no_slip")
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
BAKES = ("lit", "irradiance", "visibility", "smokeShadow", "normal")
FALLOFF_MODELS = ("inverseSquare", "linear", "polynomial")
SHADOW_FILTERS = ("hard", "pcf_grid", "pcf_disk", "pcf_disk_view", "pcss", "exact", "area")
SMOKE_SHADOWS = ("march", "nearest", "bilinear", "gaussian", "footprint", "dpd", "ray_traced")
SMOKE_DIFFUSERS = ("paper", "sweeps", "exact")
SMOKE_PROJECTIONS = ("parallel", "rays")
SMOKE_COMPOSITINGS = ("opacity", "transmittance")
MAX_RESOLUTION = 4096
MAX_DIFFUSION = 1000.0


def _identity() -> np.ndarray:
    return np.eye(4)


@dataclass(frozen=True, eq=False, kw_only=True)
class Prim(Record):
    """Something with a place on the stage.

    Attributes:
        path: prim path, unique among the scene's records of one kind.
        transform: local to world, 4 × 4 row-vector matrix in stage units; may change.
    """

    path: str
    transform: np.ndarray | Samples = field(default_factory=_identity)

    def __post_init__(self):
        if not isinstance(self.path, str) or not self.path.startswith("/"):
            raise FieldError(str(self.path), "path", self.path, "an absolute prim path")
        self._store("transform", finite(self.path, "transform", self.transform, (4, 4)))

    def transform_at(self, time: float) -> np.ndarray:
        """Local to world at a time code, 4 × 4 float64."""
        return value_at(self.transform, time)

    @property
    def moves(self) -> bool:
        """Whether the transform changes."""
        return isinstance(self.transform, Samples) and bool(np.ptp(self.transform.values, axis=0).any())

    def _check(self, check, *names: str, **limits) -> None:
        for name in names:
            self._store(name, check(self.path, name, getattr(self, name), **limits))


@dataclass(frozen=True, eq=False, kw_only=True)
class SmokeDomain(Prim):
    """A box in which smoke lives, and how it behaves there (USD: `SmokeDomainAPI`).

    Attributes:
        lower, upper: corners in local space; the transform may turn and scale the box but not shear it.
        resolution: cells along the longest side; cells are cubes.
        boundary: open, closed (air slides along it) or no_slip (closed, and viscous air sticks to it) for each of the
            sides -x +x -y +y -z +z of the box; None = open, with the bottom closed.
        time_scale: seconds of smoke for each second of the stage.
        max_courant: largest max|u| dt / h of a substep.
        buoyancy_density: α, downward acceleration per density [m/s²].
        buoyancy_temperature: β, upward acceleration per degree above ambient [m/s²].
        ambient_temperature: temperature of the air.
        vorticity: strength ε of vorticity confinement (0 = off).
        turbulence: force that stirs all air, root mean square [m/s²].
        turbulence_scale: size of its eddies [m]; None = an eighth of the longest side.
        viscosity: kinematic viscosity ν of the air [m²/s].
        wind: velocity of the air at the beginning, and when it comes in through open sides, along the stage's axes
            [m/s].
        density_diffusion: how fast smoke spreads by itself [m²/s].
        density_dissipation, temperature_cooling: decay rates [1/s].
        extinction: σ [1/m] at density 1.
        extinction_color: factor on σ for red, green and blue: its shadows have the colours that are let through.
        albedo: share of the dimmed light that is scattered on, linear RGB, for the light grid.
        density_scale: factor on the density that is exported.
        grids: fields written to the volume files: density, temperature, velocity, light (what the smoke scatters).
        active_box: whether smoke and air are carried only where there is smoke or fast air, and around it.
        advection, pressure_solver, pressure_tolerance, diffusion_solver: None = chosen by the plan.
        diffusion_sweeps: the most that the diffusion solver jacobi does for each field and substep.
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
        self._check(at_least, "temperature_cooling", "extinction")
        self._check(at_least, "extinction_color", "albedo", shape=(3,))
        if max(self.albedo) > 1:
            raise FieldError(self.path, "albedo", self.albedo, "0 to 1")
        if self.boundary is not None:
            self._store("boundary", tuple(self.boundary))
            if len(self.boundary) != len(SIDES):
                raise FieldError(self.path, "boundary", self.boundary, "six tokens, one for each of " + " ".join(SIDES))
            for token in self.boundary:
                one_of(self.path, "boundary", token, BOUNDARIES)
        self._store("grids", tuple(dict.fromkeys(self.grids)))
        for token in self.grids:
            one_of(self.path, "grids", token, GRIDS)
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
    """A mesh, or points, that make smoke inside themselves (USD: `SmokeEmitterAPI`).

    Attributes:
        mesh: its shape, in local space; points are small spheres.
        density, temperature: of the smoke it makes; may change.
        rate: [1/s], smoke of `density` added each second; None = the values are held inside the mesh; may change.
        velocity: [m/s] along the stage's axes, given to air that is slower that way; may change.
        inherit_velocity: share of the emitter's own motion given to the smoke.
        source: volume (all that is inside) or surface (a skin one voxel thick).
        noise: how uneven density and temperature are, in space and time: 0 even, 1 down to nothing.
        noise_scale: size of the noise's features [stage units]; None = a quarter of the emitter's longest side.
        enabled: may change.
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
    enabled: bool | Samples = True

    def __post_init__(self):
        super().__post_init__()
        self._check(at_least, "density")
        self._check(finite, "temperature", "inherit_velocity")
        self._check(finite, "velocity", shape=(3,))
        self._check(switch, "enabled")
        if self.rate is not None:
            self._check(at_least, "rate")
        self._check(one_of, "source", allowed=SOURCES)
        self._check(at_least, "noise")
        if self.noise > 1:
            raise FieldError(self.path, "noise", self.noise, "0 to 1")
        if self.noise_scale is not None:
            self._check(positive, "noise_scale")

    @property
    def is_partial(self) -> bool:
        """Whether it makes less smoke in some of the cells inside it than in others."""
        return self.noise > 0.0 or self.source == "surface"


@dataclass(frozen=True, eq=False, kw_only=True)
class Collider(Prim):
    """A mesh that smoke flows around (USD: `SmokeColliderAPI`).

    Attributes:
        mesh: its shape, in local space.
        thickness: added outside the mesh [voxels].
    """

    mesh: Mesh
    thickness: float = 0.0

    def __post_init__(self):
        super().__post_init__()
        self._check(at_least, "thickness")


@dataclass(frozen=True, eq=False, kw_only=True)
class Receiver(Record):
    """What is baked for a surface (USD: `SmokeReceiverAPI`)."""

    path: str
    bake: tuple[str, ...] = ("lit",)
    texture_size: int = 1024
    receive_smoke: bool = True
    receive_shadow: bool = True

    def __post_init__(self):
        self._store("bake", tuple(dict.fromkeys(self.bake)))
        for token in self.bake:
            one_of(self.path, "bake", token, BAKES)
        self._store("texture_size", whole(self.path, "texture_size", self.texture_size, 1, 16384))


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface(Prim):
    """A mesh of the set: it casts shadows, and is baked where it has a receiver.

    Attributes:
        mesh: its shape, in local space.
        material: None = the default grey.
        visible: may change; an invisible surface casts no shadow and is not baked.
        receiver: what to bake, or None.
        instancer: path of the `PointInstancer` that the surface is an instance of: it has no prim of its own, and so
            no receiver; not part of equality.
        holds_bakes: whether its prim can hold bakes, as a Mesh can and a Sphere cannot; not part of equality.
    """

    mesh: Mesh
    material: Material | None = None
    visible: bool | Samples = True
    receiver: Receiver | None = None
    instancer: str | None = field(default=None, compare=False)
    holds_bakes: bool = field(default=True, compare=False)

    def __post_init__(self):
        super().__post_init__()
        self._check(switch, "visible")
        if self.receiver is not None and self.instancer is not None:
            raise FieldError(self.path, "receiver", self.receiver.bake, "none, for an instance of a PointInstancer")


@dataclass(frozen=True, eq=False, kw_only=True)
class Light(Prim):
    """What all lights share (USD: `UsdLux` and `SmokeLightAPI`).

    Attributes:
        color: linear RGB.
        intensity: with exposure and colour temperature already in it; may change.
        normalize: whether intensity is divided by the light's area (UsdLux).
        enabled: whether it shines (USD: visibility); may change.
        shadow_enable: whether it casts shadows.
        shadow_bias, shadow_slope_bias: [stage units]; None = the least that is free of acne.
        shadow_map_size: texels along a side of a depth map.
        shadow_near, shadow_far: depth range [stage units]; None = what the scene needs.
        shadow_filter: by depth map hard, pcf_grid, pcf_disk, pcf_disk_view (wider with distance from the camera) or
            pcss (as soft as the light's size asks for); by rays exact (one for each point) or area (many).
        shadow_softness: half-width of the pcf filters [stage units]; None = from the texels of the depth map.
        shadow_cull_front: only faces turned away from the light cast shadows, for closed meshes.
        smoke_shadow: march (samples along the light's rays), a splat of voxels (nearest, bilinear, gaussian,
            footprint), dpd (the paper's) or ray_traced (a ray for each point).
        smoke_shadow_size: texels along the longer side of the smoke's light buffer; None = matches the domain.
        smoke_shadow_layer: slices of the domain in each layer of the buffer, for receivers inside the smoke; None =
            2, or all where no receiver is inside.
        illuminates: paths of the surfaces that it lights; None = all (USD: the collection `lightLink`).
        shadowed_by: paths of the surfaces and domains that cast its shadows; None = all (USD: `shadowLink`).
        smoke_diffusion: r = νΔt/h² of the energy diffusion, h a texel's width.
        smoke_diffuser: paper (one sweep), sweeps or exact.
        smoke_sweeps: Jacobi sweeps (diffuser sweeps); None = ⌈8 r⌉ explicit substeps instead.
        smoke_projection: of dpd: parallel to the line to the smoke's centre, as published, or the true rays.
        smoke_compositing: of dpd: opacity, linear as published, or transmittance e^(−τ).
    """

    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    intensity: float | Samples = 1.0
    normalize: bool = True
    enabled: bool | Samples = True
    illuminates: tuple[str, ...] | None = None
    shadowed_by: tuple[str, ...] | None = None
    shadow_enable: bool = True
    shadow_bias: float | None = None
    shadow_slope_bias: float | None = None
    shadow_map_size: int = 512
    shadow_near: float | None = None
    shadow_far: float | None = None
    shadow_filter: str = "pcss"
    shadow_softness: float | None = None
    shadow_cull_front: bool = False
    smoke_shadow: str = "march"
    smoke_shadow_size: int | None = None
    smoke_shadow_layer: int | None = None
    smoke_diffusion: float = 0.0
    smoke_diffuser: str = "paper"
    smoke_sweeps: int | None = None
    smoke_projection: str = "parallel"
    smoke_compositing: str = "opacity"

    def __post_init__(self):
        super().__post_init__()
        self._check(at_least, "color", shape=(3,))
        self._check(at_least, "intensity", "smoke_diffusion")
        self._check(switch, "enabled")
        for name in ("illuminates", "shadowed_by"):
            if getattr(self, name) is not None:
                self._store(name, tuple(getattr(self, name)))
        self._check(whole, "shadow_map_size", low=1, high=16384)
        self._check(one_of, "shadow_filter", allowed=SHADOW_FILTERS)
        self._check(one_of, "smoke_shadow", allowed=SMOKE_SHADOWS)
        self._check(one_of, "smoke_diffuser", allowed=SMOKE_DIFFUSERS)
        self._check(one_of, "smoke_projection", allowed=SMOKE_PROJECTIONS)
        self._check(one_of, "smoke_compositing", allowed=SMOKE_COMPOSITINGS)
        if self.smoke_diffusion > MAX_DIFFUSION:
            raise FieldError(self.path, "smoke_diffusion", self.smoke_diffusion, f"0 to {MAX_DIFFUSION:g}")
        for name in ("shadow_bias", "shadow_slope_bias", "shadow_near", "shadow_softness"):
            if getattr(self, name) is not None:
                self._check(at_least, name)
        if self.shadow_far is not None:
            self._check(positive, "shadow_far")
            if self.shadow_far <= (self.shadow_near or 0.0):
                raise FieldError(
                    self.path, "shadow_far", self.shadow_far, f"greater than shadow_near {self.shadow_near}"
                )
        if self.smoke_shadow_size is not None:
            self._check(whole, "smoke_shadow_size", low=1, high=16384)
        if self.smoke_shadow_layer is not None:
            self._check(whole, "smoke_shadow_layer", low=1, high=MAX_RESOLUTION)
        if self.smoke_sweeps is not None:
            self._check(whole, "smoke_sweeps", low=1, high=10_000)

    def lights(self, path: str) -> bool:
        """Whether light linking lets it reach the surface at a path."""
        return self.illuminates is None or path in self.illuminates

    def may_be_shadowed_by(self, path: str) -> bool:
        """Whether light linking lets the surface or domain at a path shadow it."""
        return self.shadowed_by is None or path in self.shadowed_by

    def position_at(self, time: float) -> np.ndarray:
        """World position, [3] float64."""
        return self.transform_at(time)[3, :3]

    def direction_at(self, time: float) -> np.ndarray:
        """Unit world direction in which it shines (its −Z axis), [3] float64."""
        axis = -self.transform_at(time)[2, :3]
        return axis / np.linalg.norm(axis)

    @property
    def shines(self) -> bool:
        """Whether it is ever on."""
        return bool(np.any(each_value(self.enabled)) and np.any(each_value(self.intensity)) and any(self.color))


@dataclass(frozen=True, eq=False, kw_only=True)
class PointLight(Light):
    """A light at a point, or a small sphere (USD: `SphereLight`).

    Attributes:
        radius: of the sphere [stage units].
        falloff_model: inverseSquare, linear (from falloff_start to falloff_end) or polynomial (1/(k₀ + k₁ d + k₂ d²)).
        falloff_start, falloff_end: [stage units]; beyond falloff_end there is no light (None = no end).
        attenuation: k₀, k₁, k₂ of the polynomial.
    """

    radius: float = 0.5
    falloff_model: str = "inverseSquare"
    falloff_start: float = 0.0
    falloff_end: float | None = None
    attenuation: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def __post_init__(self):
        super().__post_init__()
        self._check(at_least, "radius", "falloff_start")
        self._check(one_of, "falloff_model", allowed=FALLOFF_MODELS)
        self._check(at_least, "attenuation", shape=(3,))
        if self.falloff_end is not None:
            self._check(positive, "falloff_end")
            if self.falloff_end <= self.falloff_start:
                allowed = f"greater than falloff_start {self.falloff_start}"
                raise FieldError(self.path, "falloff_end", self.falloff_end, allowed)
        elif self.falloff_model == "linear":
            raise FieldError(self.path, "falloff_end", None, "a distance, since falloff_model is linear")
        if self.falloff_model == "polynomial" and not any(self.attenuation):
            raise FieldError(self.path, "attenuation", self.attenuation, "at least one number > 0")


@dataclass(frozen=True, eq=False, kw_only=True)
class SpotLight(PointLight):
    """A point light that shines along its −Z axis (USD: `ShapingAPI`).

    Attributes:
        cone_angle: half angle of the cone [degrees].
        cone_softness: share of the angle over which the edge fades, 0 to 1.
        focus: exponent of cos θ.
    """

    cone_angle: float = 90.0
    cone_softness: float = 0.0
    focus: float = 0.0

    def __post_init__(self):
        super().__post_init__()
        _check_direction(self)
        self._check(positive, "cone_angle")
        self._check(at_least, "cone_softness", "focus")
        if self.cone_angle > 180:
            raise FieldError(self.path, "cone_angle", self.cone_angle, "at most 180 degrees")
        if self.cone_softness > 1:
            raise FieldError(self.path, "cone_softness", self.cone_softness, "0 to 1")


@dataclass(frozen=True, eq=False, kw_only=True)
class DistantLight(Light):
    """A light from one direction, its −Z axis (USD: `DistantLight`).

    Attributes:
        angle: its width in the sky [degrees].
    """

    angle: float = 0.53
    shadow_map_size: int = 1024

    def __post_init__(self):
        super().__post_init__()
        _check_direction(self)
        self._check(at_least, "angle")


def _check_direction(light: Light) -> None:
    for matrix in each_value(light.transform):
        if not np.linalg.norm(matrix[2, :3]) > 0:
            raise FieldError(light.path, "direction", matrix[2, :3].tolist(), "a direction that is not zero")


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera(Prim):
    """A camera looking along its −Z axis (USD: `UsdGeomCamera`); apertures and focal length share one unit."""

    focal_length: float = 50.0
    horizontal_aperture: float = 20.955
    vertical_aperture: float = 15.2908
    horizontal_offset: float = 0.0
    vertical_offset: float = 0.0
    near: float = 1.0
    far: float = 1e6

    def __post_init__(self):
        super().__post_init__()
        self._check(positive, "focal_length", "horizontal_aperture", "vertical_aperture", "far")
        self._check(finite, "horizontal_offset", "vertical_offset", "near")


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene(Record):
    """Everything a stage asks for.

    Attributes:
        start, end: first and last frame (time codes), both simulated.
        time_codes_per_second: frames in a second.
        meters_per_unit: length of a stage unit [m].
        up_axis: X, Y or Z.
        ambient: light from everywhere, linear RGB (USD: `DomeLight`).
        source: the stage's file, or None for a scene made in Python.
        warnings: what on the stage is not supported and was left as it is; not part of equality.
    """

    domains: tuple[SmokeDomain, ...] = ()
    emitters: tuple[Emitter, ...] = ()
    colliders: tuple[Collider, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    lights: tuple[Light, ...] = ()
    camera: Camera | None = None
    ambient: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start: int = 1
    end: int = 48
    time_codes_per_second: float = 24.0
    meters_per_unit: float = 1.0
    up_axis: str = "Y"
    source: Path | None = field(default=None, compare=False)
    warnings: tuple[str, ...] = field(default=(), compare=False)

    def __post_init__(self):
        for name in ("domains", "emitters", "colliders", "surfaces", "lights"):
            records = tuple(getattr(self, name))
            self._store(name, records)
            paths = set()
            for record in records:
                if record.path in paths:
                    raise FieldError(record.path, "path", record.path, f"unique among the scene's {name}")
                paths.add(record.path)
        self._store("ambient", at_least("scene", "ambient", self.ambient, shape=(3,)))
        self._store("start", whole("scene", "start", self.start, -(10**9), 10**9))
        self._store("end", whole("scene", "end", self.end, self.start, 10**9))
        self._store("time_codes_per_second", positive("scene", "time_codes_per_second", self.time_codes_per_second))
        self._store("meters_per_unit", positive("scene", "meters_per_unit", self.meters_per_unit))
        one_of("scene", "up_axis", self.up_axis, AXES)

    @property
    def up(self) -> np.ndarray:
        """Unit vector up, [3]."""
        return np.eye(3)[AXES.index(self.up_axis)]

    @property
    def frames(self) -> range:
        """The frames that are simulated."""
        return range(self.start, self.end + 1)

    @staticmethod
    def open(path: str | Path) -> "Scene":
        """Reads a USD stage; see `warp_smoke.usd.read`."""
        from warp_smoke.usd.read import read_scene

        return read_scene(path)

    def save(self, path: str | Path) -> None:
        """Writes the scene to a USD file; see `warp_smoke.usd.author`."""
        from warp_smoke.usd.author import author_scene

        author_scene(self, path)
