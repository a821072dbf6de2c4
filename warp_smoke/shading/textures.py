"""Pictures on surfaces: read from files, sampled bilinearly in linear light."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from warp_smoke.record import FieldError
from warp_smoke.scene import Material
from warp_smoke.shading.srgb import decode_srgb


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture as it is stored, and what its codes mean.

    Attributes:
        codes: [h, w, 3], or [h, w, 1] for grey; uint8 or uint16; first row at the top (v = 1).
        levels: linear value of each code, [256] or [65536] float32.
    """

    codes: np.ndarray
    levels: np.ndarray

    @classmethod
    def read(cls, file: str, color_space: str) -> "Picture":
        """Reads an 8-bit picture, or 16-bit grey; of 16-bit colour Pillow keeps the upper 8 bits. Alpha is left out.

        Args:
            file: in any format that Pillow reads.
            color_space: sRGB, raw, or auto: sRGB for 8-bit colour, raw for grey and for 16 bits.

        Raises:
            OSError: the file is missing, damaged, or not such a picture.
        """
        try:
            with Image.open(file) as image:
                sixteen_bits = any(";16" in str(tile.args) for tile in image.tile)
                if image.mode.startswith("I;16"):
                    codes = np.asarray(image).astype(np.uint16)
                elif image.mode in ("1", "L", "LA"):
                    codes = np.asarray(image.convert("L"))
                elif image.mode in ("I", "F"):
                    raise OSError("numbers of 32 bits")
                else:
                    codes = np.asarray(image.convert("RGB"))
        except (SyntaxError, Image.DecompressionBombError) as error:  # some damaged files; too large ones
            raise OSError(str(error)) from None
        if codes.ndim == 2:
            codes = codes[..., None]
        levels = np.linspace(0.0, 1.0, 65536 if codes.dtype == np.uint16 else 256)
        if color_space == "sRGB" or (color_space == "auto" and codes.shape[2] == 3 and not sixteen_bits):
            levels = decode_srgb(levels)
        return cls(codes, levels.astype(np.float32))

    def sample(self, uvs: np.ndarray, wrap_s: str, wrap_t: str) -> np.ndarray:
        """Linear RGB at texture coordinates [n, 2], bilinear between the four nearest texels, [n, 3] float32.

        Texel (row, column) has its centre at u = (column + ½)/w, v = 1 − (row + ½)/h.
        """
        h, w, _ = self.codes.shape
        x, y = uvs[:, 0] * np.float64(w) - 0.5, (1.0 - uvs[:, 1]) * np.float64(h) - 0.5
        column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        s, t = ((a - b).astype(np.float32)[:, None] for a, b in ((x, column), (y, row)))
        (left, in_left), (right, in_right) = (_wrap(column + k, w, wrap_s) for k in (0, 1))
        (upper, in_upper), (lower, in_lower) = (_wrap(row + k, h, wrap_t) for k in (0, 1))

        def tap(row, column, inside):
            return self.levels[self.codes[row, column]] * inside[:, None]

        top = (1 - s) * tap(upper, left, in_upper & in_left) + s * tap(upper, right, in_upper & in_right)
        bottom = (1 - s) * tap(lower, left, in_lower & in_left) + s * tap(lower, right, in_lower & in_right)
        return np.broadcast_to((1 - t) * top + t * bottom, (len(uvs), 3))


def _wrap(index: np.ndarray, count: int, mode: str) -> tuple[np.ndarray, np.ndarray]:
    """The texel that stands for one outside the picture, and whether it is not black."""
    if mode == "repeat":
        return index % count, np.ones(len(index), bool)
    if mode == "mirror":
        index = index % (2 * count)
        return np.minimum(index, 2 * count - 1 - index), np.ones(len(index), bool)
    inside = (index >= 0) & (index < count)
    return np.clip(index, 0, count - 1), inside | (mode != "black")


def diffuse_colors(material: Material, uvs: np.ndarray | None, count: int) -> np.ndarray:
    """Diffuse colour of a surface at texture coordinates [n, 2], linear RGB ≥ 0, [n, 3] float32.

    Where there is no texture, or no texture coordinates (None), it is the material's colour at all `count` places.

    Raises:
        FieldError: the texture's file cannot be read.
    """
    texture = material.diffuse_texture
    if texture is None or uvs is None:
        return np.broadcast_to(np.asarray(material.diffuse_color, np.float32), (count, 3))
    try:
        picture = Picture.read(texture.file, texture.color_space)
    except OSError as error:
        reason = f"{texture.file} ({error.strerror or error})"
        raise FieldError(material.path, "diffuse_texture", reason, "a picture file that can be read") from None
    value = picture.sample(uvs, texture.wrap_s, texture.wrap_t)
    scale, bias = (np.asarray(rgba[:3], np.float32) for rgba in (texture.scale, texture.bias))
    return np.maximum(value * scale + bias, np.float32(0.0))
