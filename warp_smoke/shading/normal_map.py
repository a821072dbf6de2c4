"""Normal maps: computed from heights, stored in pictures, and packed with other maps.

Directions are stored as 127.5 (n + 1) in 8-bit RGB and read back as 2c − 1 (F. Luna, *Introduction to 3D Game
Programming with DirectX 12*, chapter 19); +y is the direction in which v grows, towards the picture's top.
"""

import numpy as np

from warp_smoke.geometry import normalized


def height_normals(heights: np.ndarray, width: float, height: float, wrap: str = "repeat") -> np.ndarray:
    """Computes unit normals along (−∂h/∂x, −∂h/∂y, 1) of a height field, by central differences, [h, w, 3] float64.

    Args:
        heights: [h, w], first row at the top (v = 1), in the unit of length of width and height.
        width: width of the area that the picture covers.
        height: height of that area.
        wrap: repeat, or clamp, which makes differences at the border one-sided.

    Raises:
        ValueError: the heights are not [h, w], or wrap is neither repeat nor clamp.
    """
    heights = np.asarray(heights, np.float64)
    if heights.ndim != 2 or not heights.size:
        raise ValueError(f"heights have shape {list(heights.shape)}; allowed: [h, w]")
    if wrap not in ("repeat", "clamp"):
        raise ValueError(f"wrap is {wrap}; allowed: repeat, clamp")
    rows, columns = heights.shape
    along_x = _slope(heights, 1, wrap) * (columns / width)
    along_y = _slope(heights, 0, wrap) * (-rows / height)
    return normalized(np.stack([-along_x, -along_y, np.ones_like(heights)], axis=2))


def _slope(heights: np.ndarray, axis: int, wrap: str) -> np.ndarray:
    """Returns the difference per texel along an axis, central where there are two neighbours."""
    if wrap == "repeat":
        return 0.5 * (np.roll(heights, -1, axis) - np.roll(heights, 1, axis))
    return np.gradient(heights, axis=axis) if heights.shape[axis] > 1 else np.zeros_like(heights)


def encode_normals(normals: np.ndarray, bits: int = 8) -> np.ndarray:
    """Encodes unit normals as round(127.5 (n + 1)), uint8 of the same shape, or for 16 bits 32767.5 (n + 1), uint16."""
    half = 0.5 * (2**bits - 1)
    return np.rint(half * (np.clip(normals, -1.0, 1.0) + 1.0)).astype(np.uint8 if bits == 8 else np.uint16)


def decode_normals(codes: np.ndarray) -> np.ndarray:
    """Decodes 8-bit codes to directions 2c − 1, normalized, float64."""
    return normalized(2.0 * np.asarray(codes, np.float64) / 255.0 - 1.0)


def pack_channels(rgb: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Packs a three-channel and a one-channel map into one RGBA picture: base and gloss, or normals and height.

    Args:
        rgb: [h, w, 3] uint8 or uint16.
        alpha: [h, w], of the same type.

    Raises:
        ValueError: the maps differ in size or type.
    """
    for pixels in (rgb, alpha):
        if pixels.dtype not in (np.uint8, np.uint16) or pixels.dtype != rgb.dtype:
            raise ValueError(f"pixels are {pixels.dtype}; allowed: uint8 or uint16, the same for both maps")
    if rgb.shape != (*alpha.shape, 3):
        raise ValueError(f"maps have shapes {list(rgb.shape)} and {list(alpha.shape)}; allowed: [h, w, 3] and [h, w]")
    return np.dstack([rgb, alpha])


def unpack_channels(rgba: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the two maps of a packed picture, [h, w, 3] and [h, w].

    Raises:
        ValueError: the picture is not [h, w, 4].
    """
    if rgba.ndim != 3 or rgba.shape[2] != 4:
        raise ValueError(f"picture has shape {list(rgba.shape)}; allowed: [h, w, 4]")
    return rgba[..., :3], rgba[..., 3]
