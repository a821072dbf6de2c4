"""Makes the pictures that the example stages use, in `stages/textures/`.

`checker.png`; for columns.usda the packed pair of bricks (base colour with gloss in alpha, normals with heights in
alpha), stone (normals only), and `polish.png`, the roughness of a sphere with dull bands.
"""

from pathlib import Path

import numpy as np

from warp_smoke.files import write_png
from warp_smoke.shading.normal_map import encode_normals, height_normals, pack_channels
from warp_smoke.shading.procedural import gradient_noise
from warp_smoke.shading.srgb import encode_srgb_codes

FOLDER = Path(__file__).parents[1] / "stages" / "textures"
SIZE, SQUARES = 256, 8
LIGHT, DARK = (214, 208, 196), (96, 104, 112)  # sRGB
BRICKS_ACROSS, BRICKS_DOWN, JOINT, BEVEL = 2, 4, 0.05, 0.05
BRICK, MORTAR = (0.42, 0.11, 0.06), (0.38, 0.36, 0.33)  # linear


def make_checker() -> np.ndarray:
    """Makes a checkerboard, uint8 [SIZE, SIZE, 3] sRGB."""
    row, column = np.indices((SIZE, SIZE)) * SQUARES // SIZE
    return np.where(((row + column) % 2 == 0)[..., None], LIGHT, DARK).astype(np.uint8)


def places() -> tuple[np.ndarray, np.ndarray]:
    """Returns texture coordinates of the texels' centres, [SIZE, SIZE] each, first row at the top."""
    along = (np.arange(SIZE) + 0.5) / SIZE
    return tuple(np.meshgrid(along, along[::-1]))


def rough_noise(u: np.ndarray, v: np.ndarray, period: int) -> np.ndarray:
    """Returns noise of three octaves, about −1…1."""
    return sum(0.5**k * gradient_noise(u * period * 2**k, v * period * 2**k, period * 2**k) for k in range(3))


def make_bricks() -> tuple[np.ndarray, np.ndarray]:
    """Makes base colour with gloss and normals with heights of a tileable brick wall, uint8 [SIZE, SIZE, 4] each."""
    u, v = places()
    row = np.floor(v * BRICKS_DOWN)
    x = (u * BRICKS_ACROSS + 0.5 * (row % 2)) % 1.0
    y = (v * BRICKS_DOWN) % 1.0
    # Distance to the brick's edge, in brick heights.
    inside = np.minimum(np.minimum(x, 1 - x) * BRICKS_DOWN / BRICKS_ACROSS, np.minimum(y, 1 - y)) - JOINT
    raised = np.clip(inside / BEVEL, 0.0, 1.0)
    grain = rough_noise(u, v, 16)
    heights = np.clip(raised * (0.9 + 0.1 * grain), 0.0, 1.0)
    shade = 1.0 + 0.25 * rough_noise(u, v, 5)[..., None] + 0.1 * grain[..., None]
    base = (np.array(MORTAR) + raised[..., None] * np.subtract(BRICK, MORTAR)) * shade
    gloss = np.clip(0.15 + 0.5 * raised + 0.2 * grain, 0.0, 1.0)
    normals = height_normals(heights, 1.0 / 0.025, 1.0 / 0.025)
    codes = [np.rint(255 * values).astype(np.uint8) for values in (gloss, heights)]
    return pack_channels(encode_srgb_codes(base), codes[0]), pack_channels(encode_normals(normals), codes[1])


def make_stone() -> np.ndarray:
    """Makes tileable normals of flutes in rough stone, uint8 [SIZE, SIZE, 3]."""
    u, v = places()
    flutes = np.sqrt(np.abs(np.sin(np.pi * u * 4)))
    return encode_normals(height_normals(0.02 * flutes + 0.006 * rough_noise(u, v, 12), 1.0, 1.0))


def make_polish() -> np.ndarray:
    """Makes the roughness of polished bands between dull ones, uint8 [SIZE, SIZE]."""
    u, v = places()
    dull = np.clip(4 * np.sin(2 * np.pi * (6 * v + 0.15 * rough_noise(u, v, 4))), -1.0, 1.0)
    return np.rint(255 * (0.55 + 0.35 * dull)).astype(np.uint8)


if __name__ == "__main__":
    bricks_base, bricks_relief = make_bricks()
    for name, pixels in (
        ("checker", make_checker()),
        ("bricks_base", bricks_base),
        ("bricks_relief", bricks_relief),
        ("stone_normal", make_stone()),
        ("polish", make_polish()),
    ):
        write_png(FOLDER / f"{name}.png", pixels)
