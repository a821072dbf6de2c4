"""Makes the pictures that the example stages use: `stages/textures/checker.png`."""

from pathlib import Path

import numpy as np

from warp_smoke.files import write_png

SIZE, SQUARES = 256, 8
LIGHT, DARK = (214, 208, 196), (96, 104, 112)  # sRGB


def make_checker() -> np.ndarray:
    """A checkerboard, uint8 [SIZE, SIZE, 3] sRGB."""
    row, column = np.indices((SIZE, SIZE)) * SQUARES // SIZE
    return np.where(((row + column) % 2 == 0)[..., None], LIGHT, DARK).astype(np.uint8)


if __name__ == "__main__":
    write_png(Path(__file__).parents[1] / "stages" / "textures" / "checker.png", make_checker())
