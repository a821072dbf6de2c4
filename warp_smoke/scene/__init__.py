"""The scene that a user asks for, as frozen records that are checked on construction.

Lengths are in stage units; points and transforms follow USD's row-vector convention (p' = p M). A field marked "may
change" takes a plain value or `Samples`.
"""

from warp_smoke.material import WRAP_MODES, Material, Procedural, Texture
from warp_smoke.scene.arrays import ArrayCollider, ArrayEmitter
from warp_smoke.scene.camera import Camera
from warp_smoke.scene.light import (
    FALLOFF_MODELS,
    MAP_FILTERS,
    MAX_DIFFUSION,
    SHADOW_FILTERS,
    SMOKE_COMPOSITINGS,
    SMOKE_DIFFUSERS,
    SMOKE_PROJECTIONS,
    SMOKE_SHADOWS,
    DistantLight,
    Light,
    PointLight,
    SpotLight,
)
from warp_smoke.scene.prim import Prim
from warp_smoke.scene.scene import AXES, Scene
from warp_smoke.scene.smoke import (
    ADVECTION_SCHEMES,
    BOUNDARIES,
    DIFFUSION_SOLVERS,
    GRIDS,
    MAX_RESOLUTION,
    PRESSURE_SOLVERS,
    SIDES,
    SOURCES,
    Collider,
    Emitter,
    SmokeDomain,
)
from warp_smoke.scene.surface import BAKES, SURFACE_BAKES, MaterialSubset, Receiver, Surface

__all__ = [
    "ADVECTION_SCHEMES",
    "AXES",
    "BAKES",
    "BOUNDARIES",
    "DIFFUSION_SOLVERS",
    "FALLOFF_MODELS",
    "GRIDS",
    "MAP_FILTERS",
    "MAX_DIFFUSION",
    "MAX_RESOLUTION",
    "PRESSURE_SOLVERS",
    "SHADOW_FILTERS",
    "SIDES",
    "SMOKE_COMPOSITINGS",
    "SMOKE_DIFFUSERS",
    "SMOKE_PROJECTIONS",
    "SMOKE_SHADOWS",
    "SOURCES",
    "SURFACE_BAKES",
    "WRAP_MODES",
    "ArrayCollider",
    "ArrayEmitter",
    "Camera",
    "Collider",
    "DistantLight",
    "Emitter",
    "Light",
    "Material",
    "MaterialSubset",
    "PointLight",
    "Prim",
    "Procedural",
    "Receiver",
    "Scene",
    "SmokeDomain",
    "SpotLight",
    "Surface",
    "Texture",
]
