"""Ray-cast pictures of a scene: surfaces with the same shading as bakes, ray-traced shadows, ray-marched smoke.

Baked textures are checked against them: at the same point both have the same value.
"""

from warp_smoke.picture.render import render, render_kernels, render_picture, simulate_smoke
from warp_smoke.picture.renderer import MAX_PIXELS, SHADINGS, PictureRenderer
from warp_smoke.picture.smoke_volume import SmokeVolume

__all__ = [
    "MAX_PIXELS",
    "SHADINGS",
    "PictureRenderer",
    "SmokeVolume",
    "render",
    "render_kernels",
    "render_picture",
    "simulate_smoke",
]
