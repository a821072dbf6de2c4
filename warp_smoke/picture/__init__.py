"""The ray-cast picture of a scene: surfaces by the bakes' own shading, shadows by rays, smoke marched along rays.

It is what baked textures are checked against: at the same point it has the same value.
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
