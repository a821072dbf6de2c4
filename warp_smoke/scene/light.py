"""Lights, and how the shadows of surfaces and of smoke are computed."""

from dataclasses import dataclass

import numpy as np

from warp_smoke.record import (
    VAST,
    FieldError,
    Samples,
    at_least,
    each_value,
    flag,
    one_of,
    paths,
    positive,
    switch,
    whole,
)
from warp_smoke.scene.prim import Prim
from warp_smoke.scene.smoke import MAX_RESOLUTION

FALLOFF_MODELS = ("inverseSquare", "linear", "polynomial")
MAP_FILTERS = ("hard", "pcf_grid", "pcf_disk", "pcf_disk_view", "pcss")
SHADOW_FILTERS = (*MAP_FILTERS, "exact", "area")
SMOKE_SHADOWS = ("march", "nearest", "bilinear", "gaussian", "footprint", "dpd", "ray_traced")
SMOKE_DIFFUSERS = ("paper", "sweeps", "exact")
SMOKE_PROJECTIONS = ("parallel", "rays")
SMOKE_COMPOSITINGS = ("opacity", "transmittance")
MAX_DIFFUSION = 1000.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Light(Prim):
    """The fields that all lights share (USD: `UsdLux` and `SmokeLightAPI`).

    Attributes:
        color: linear RGB.
        intensity: with exposure already included (colour temperature is part of `color`); may change.
        normalize: whether the intensity is divided by the light's area (UsdLux).
        enabled: whether it shines (USD: visibility); may change.
        shadow_enable: whether it casts shadows.
        shadow_bias, shadow_slope_bias: [stage units]; None = the smallest free of shadow acne.
        shadow_map_size: texels along a side of a depth map.
        shadow_near, shadow_far: casters nearer than the one are ignored, and points beyond the other are lit [stage
            units]; not used by distant lights; None = what the scene needs.
        shadow_filter: with a depth map: hard, pcf_grid, pcf_disk, pcf_disk_view (wider with distance from the camera)
            or pcss (penumbra from the light's size); with rays: exact (one for each point) or area (many).
        shadow_softness: half-width of the pcf filters [stage units]; None = from the depth map's texels, or for
            pcf_disk_view from its far distance.
        shadow_cull_front: whether only faces turned away from the light cast shadows; for closed meshes.
        smoke_shadow: march (samples along the light's rays), a splat of voxels (nearest, bilinear, gaussian,
            footprint), dpd (direct projection and diffusion, as published) or ray_traced (a ray for each point).
        smoke_shadow_size: texels along the longer side of the smoke's light buffer; None = matches the domain.
        smoke_shadow_layer: slices of the domain in each layer of the buffer, for receivers inside the smoke; None =
            2, or all where no receiver is inside.
        illuminates: paths of the surfaces that it lights; None = all (USD: the collection `lightLink`).
        shadowed_by: paths of the surfaces and domains that cast its shadows; None = all (USD: `shadowLink`).
        smoke_diffusion: r = νΔt/h² of the energy diffusion, with h the width of a texel.
        smoke_diffuser: paper (one sweep), sweeps or exact.
        smoke_sweeps: number of Jacobi sweeps of the diffuser sweeps; None = ⌈8 r⌉ explicit substeps instead.
        smoke_projection: of dpd: parallel (to the line to the smoke's centre, as published) or rays (the true ones).
        smoke_compositing: of dpd: opacity (linear, as published) or transmittance (e^(−τ)).
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
        self._check(at_least, "intensity", largest=VAST)
        self._check(at_least, "smoke_diffusion")
        self._check(switch, "enabled")
        self._check(flag, "normalize", "shadow_enable", "shadow_cull_front")
        for name in ("illuminates", "shadowed_by"):
            if getattr(self, name) is not None:
                self._check(paths, name)
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
            self._check(positive, "shadow_far", largest=VAST)
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
        """Returns whether light linking lets it illuminate the surface at a path."""
        return self.illuminates is None or path in self.illuminates

    def may_be_shadowed_by(self, path: str) -> bool:
        """Returns whether shadow linking lets the surface or domain at a path block it."""
        return self.shadowed_by is None or path in self.shadowed_by

    def position_at(self, time: float) -> np.ndarray:
        """Returns the world position, [3] float64."""
        return self.transform_at(time)[3, :3]

    def direction_at(self, time: float) -> np.ndarray:
        """Returns the unit world direction in which it shines (its −Z axis), [3] float64."""
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
        radius: radius of the sphere [stage units].
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
            self._check(positive, "falloff_end", largest=VAST)
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
        cone_angle: half-angle of the cone [degrees].
        cone_softness: fraction of the angle over which the edge fades, 0 to 1.
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
    """A light infinitely far away, shining along its −Z axis (USD: `DistantLight`).

    Attributes:
        angle: its angular diameter [degrees].
        shadow_map_size: texels along a side of the depth map, which covers all that both casts and receives shadows.
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
