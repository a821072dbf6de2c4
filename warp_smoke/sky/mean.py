"""The mean of a sky picture over all directions: the uniform light that carries as much."""

import struct
import zlib
from io import BytesIO

import numpy as np
from PIL import Image

from warp_smoke.shading.srgb import decode_srgb
from warp_smoke.sky import exr, radiance_hdr
from warp_smoke.sky.rows import Rows, UnsupportedPicture

__all__ = ["UnsupportedPicture", "mean_radiance"]

# The largest number in half precision; brighter suns are stored as infinity.
_BRIGHTEST = 65504.0


def mean_radiance(data: bytes) -> tuple[np.ndarray, bool]:
    """Computes the mean colour of a latitude-longitude picture over all directions, and whether it is uniform.

    Each row of the picture is a circle of latitude: between polar angles θ₀ and θ₁ it covers (cos θ₀ − cos θ₁)/2 of
    the sphere.

    Args:
        data: content of an OpenEXR or Radiance file (linear), or of an 8-bit file that Pillow reads (sRGB).

    Returns:
        Linear RGB [3] float64, and whether all pixels are equal.

    Raises:
        UnsupportedPicture: this kind of file is not supported.
        OSError: the file is damaged.
    """
    try:
        return _mean(_read(data))
    except UnsupportedPicture:
        raise
    except (ValueError, IndexError, SyntaxError, struct.error, zlib.error, Image.DecompressionBombError) as error:
        raise OSError(f"damaged: {error}") from None


def _read(data: bytes) -> Rows:
    if data.startswith(exr.SIGNATURE):
        return exr.read_exr(data)
    if data.startswith(radiance_hdr.SIGNATURE):
        return radiance_hdr.read_radiance_hdr(data)
    try:
        opened = Image.open(BytesIO(data))
    except Image.UnidentifiedImageError:
        raise UnsupportedPicture("neither OpenEXR nor Radiance nor what Pillow reads") from None
    with opened as image:
        if image.mode in ("I", "F") or image.mode.startswith("I;16"):
            raise UnsupportedPicture(f"a {image.format} file of more than 8 bits")
        codes = np.asarray(image.convert("RGB"))
    return Rows(len(codes), ((row, decode_srgb(line[None] / 255.0)) for row, line in enumerate(codes)))


def _mean(picture: Rows) -> tuple[np.ndarray, bool]:
    edges = np.cos(np.linspace(0.0, np.pi, picture.height + 1))
    total, least, most = np.zeros(3), np.full(3, np.inf), np.full(3, -np.inf)
    for first, block in picture.blocks:
        colors = np.minimum(block, _BRIGHTEST)
        shares = (edges[first : first + len(block)] - edges[first + 1 : first + 1 + len(block)]) / 2.0
        total += shares @ colors.mean(axis=1, dtype=np.float64)
        least, most = np.minimum(least, colors.min(axis=(0, 1))), np.maximum(most, colors.max(axis=(0, 1)))
    if not np.isfinite(total).all():
        raise ValueError("it holds numbers that are not finite")
    return total, bool(np.array_equal(least, most))
