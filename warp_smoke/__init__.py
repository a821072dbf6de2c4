"""Smoke, its shadows and baked lighting for USD stages, as NVIDIA Warp kernels on CPU or CUDA.

Reading a stage and planning load neither Warp nor pyvista; simulating and previewing do.
"""

from importlib import import_module
from importlib.metadata import version

from warp_smoke.geometry import Mesh, Points
from warp_smoke.plan import Plan, make_plan
from warp_smoke.preview import live_preview, preview
from warp_smoke.record import Samples
from warp_smoke.run import run
from warp_smoke.scene import (
    ArrayCollider,
    ArrayEmitter,
    Camera,
    Collider,
    DistantLight,
    Emitter,
    Light,
    Material,
    MaterialSubset,
    PointLight,
    Procedural,
    Receiver,
    Scene,
    SmokeDomain,
    SpotLight,
    Surface,
    Texture,
)
from warp_smoke.study import study

__version__ = version("warp-smoke")

__all__ = [
    "ArrayCollider",
    "ArrayEmitter",
    "Camera",
    "Collider",
    "DistantLight",
    "Emitter",
    "Frame",
    "Light",
    "Material",
    "MaterialSubset",
    "Mesh",
    "Plan",
    "PointLight",
    "Points",
    "Procedural",
    "Receiver",
    "Result",
    "Samples",
    "Scene",
    "Simulation",
    "Smoke",
    "SmokeDomain",
    "SpotLight",
    "Surface",
    "Texture",
    "live_preview",
    "make_plan",
    "preview",
    "render",
    "run",
    "study",
]


# These need Warp, which takes a moment to load.
_ON_USE = {
    "Simulation": "simulation",
    "Frame": "simulation",
    "Smoke": "simulation",
    "Result": "output",
    "render": "picture",
}


def __getattr__(name: str):
    if name in _ON_USE:
        return getattr(import_module(f"warp_smoke.{_ON_USE[name]}"), name)
    raise AttributeError(f"module 'warp_smoke' has no attribute '{name}'")
