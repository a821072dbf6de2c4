"""How much a material hides of what lies behind it, as VTK can draw it: one number, or the alpha of a texture."""

import numpy as np
from PIL import Image

from warp_smoke.scene import Material, Texture
from warp_smoke.shading.textures import Picture


def plain_opacity(material: Material) -> float:
    """Returns the opacity of a material without its textures."""
    return float(_cut(np.float32(material.opacity), material.opacity_threshold))


def read_opacity(material: Material) -> tuple[np.ndarray, tuple[int, int]]:
    """Reads a material's opacity texture, [h, w] float32 in 0 to 1, top row first; and its tiles along u and v.

    Raises:
        OSError: the texture cannot be read.
    """
    texture = material.opacity_texture
    channel = {"r": 0, "g": 1, "b": 2, "a": 3}.get(texture.channel, 0)
    picture = Picture.read(texture.file, texture.color_space)
    numbers = np.clip(picture.linear()[..., channel] * texture.scale[channel] + texture.bias[channel], 0.0, 1.0)
    return _cut(numbers, material.opacity_threshold), picture.tiles


def lie_alike(a: Texture, b: Texture) -> bool:
    """Returns whether two textures are placed on a surface in the same way."""
    return all(
        getattr(a, name) == getattr(b, name)
        for name in ("wrap_s", "wrap_t", "uv_scale", "uv_rotation", "uv_translation")
    )


def with_alpha(pixels: np.ndarray, opacity: np.ndarray) -> np.ndarray:
    """Returns colours [h, w, 3] uint8 with an opacity [m, n], resized to them, as alpha: [h, w, 4] uint8."""
    height, width = pixels.shape[:2]
    alpha = Image.fromarray((255 * opacity + 0.5).astype(np.uint8))
    return np.dstack([pixels, np.asarray(alpha.resize((width, height), Image.Resampling.BILINEAR))])


def _cut(opacity: np.ndarray, threshold: float) -> np.ndarray:
    """Makes the opacity 0 or 1 where there is a threshold."""
    return np.where(opacity >= threshold, np.float32(1.0), np.float32(0.0)) if threshold else opacity
