"""Smoke, its shadows and baked lighting for USD stages, as NVIDIA Warp kernels on CPU or CUDA.

Reading a stage and planning load neither Warp nor pyvista; simulating and looking do.
"""

from importlib.metadata import version

from warp_smoke.geometry import Mesh
from warp_smoke.plan import Plan, make_plan
from warp_smoke.preview import preview
from warp_smoke.record import Samples
from warp_smoke.run import run
from warp_smoke.scene import (
    Camera,
    Collider,
    DistantLight,
    Emitter,
    Material,
    PointLight,
    Receiver,
    Scene,
    SmokeDomain,
    SpotLight,
    Surface,
    Texture,
)

__version__ = version("warp-smoke")

__all__ = [
    "Camera",
    "Collider",
    "DistantLight",
    "Emitter",
    "Material",
    "Mesh",
    "Plan",
    "PointLight",
    "Receiver",
    "Samples",
    "Scene",
    "Simulation",
    "SmokeDomain",
    "SpotLight",
    "Surface",
    "Texture",
    "make_plan",
    "preview",
    "run",
]


def __getattr__(name: str):
    if name == "Simulation":
        from warp_smoke.simulation import Simulation

        return Simulation
    raise AttributeError(f"module 'warp_smoke' has no attribute '{name}'")
