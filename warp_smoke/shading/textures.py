"""Pictures on surfaces: read from files as codes, with the linear value of each code."""

from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
from PIL import Image

from warp_smoke.deep_png import decode_deep_png
from warp_smoke.material import COLOR_TEXTURES
from warp_smoke.picture_file import open_picture_file
from warp_smoke.record import FieldError
from warp_smoke.scene import Material
from warp_smoke.shading.srgb import decode_srgb


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture as it is stored, and the linear values of its codes.

    Attributes:
        codes: [h, w, 3], or [h, w, 1] for grey; uint8 or uint16; first row at the top (v = 1).
        levels: linear value of each code, [256] or [65536] float32.
        alpha: [h, w] uint8 or uint16, always raw, or None.
    """

    codes: np.ndarray
    levels: np.ndarray
    alpha: np.ndarray | None = None

    @classmethod
    def read(cls, file: str, color_space: str) -> "Picture":
        """Reads an 8-bit picture, a 16-bit grey one, or a PNG with 16-bit colour.

        Args:
            file: in any format that Pillow reads; may lie in a `.usdz` package: `PACKAGE[FILE]`.
            color_space: sRGB, raw, or auto: sRGB for 8-bit colour, raw for grey and for 16 bits.

        Raises:
            OSError: the file is missing, damaged, or not such a picture.
        """
        try:
            with open_picture_file(file) as opened, Image.open(opened) as image:
                deep = image.mode.startswith("I;16") or any(";16" in str(tile.args) for tile in image.tile)
                codes, alpha = _read_deep(image, opened) if deep else _read_codes(image)
        except (SyntaxError, ValueError, Image.DecompressionBombError) as error:  # some damaged files; too large ones
            raise OSError(str(error)) from None
        levels = np.linspace(0.0, 1.0, 65536 if codes.dtype == np.uint16 else 256)
        if color_space == "sRGB" or (color_space == "auto" and codes.shape[2] == 3 and not deep):
            levels = decode_srgb(levels)
        return cls(codes, levels.astype(np.float32), alpha)

    def linear(self) -> np.ndarray:
        """Returns the linear RGBA of each texel, [h, w, 4] float32; alpha is 1 where the file has none."""
        pixels = np.ones((*self.codes.shape[:2], 4), np.float32)
        pixels[..., :3] = self.levels[self.codes]
        if self.alpha is not None:
            pixels[..., 3] = self.alpha / np.float32(np.iinfo(self.alpha.dtype).max)
        return pixels


def _read_codes(image: Image.Image) -> tuple[np.ndarray, np.ndarray | None]:
    """Reads 8-bit codes [h, w, 1 or 3], and alpha [h, w] or None."""
    if image.mode in ("I", "F"):
        raise OSError("numbers of 32 bits")
    codes = np.asarray(image.convert("L" if image.mode in ("1", "L", "LA") else "RGB"))
    alpha = None
    if "A" in image.getbands() or "transparency" in image.info:
        alpha = np.asarray(image.convert("RGBA"))[..., 3]
    return codes.reshape(*codes.shape[:2], -1), alpha


def _read_deep(image: Image.Image, file: BinaryIO) -> tuple[np.ndarray, np.ndarray | None]:
    """Reads 16-bit codes [h, w, 1 or 3], and alpha [h, w] or None; Pillow keeps only the upper 8 bits of colour."""
    if image.mode.startswith("I;16"):
        return np.asarray(image).astype(np.uint16)[..., None], None
    if image.format != "PNG":
        raise OSError(f"16-bit colour in {image.format}; it is read from PNG")
    file.seek(0)
    pixels = decode_deep_png(file.read())
    colors = pixels.shape[2] - 1 + pixels.shape[2] % 2
    return pixels[..., :colors], pixels[..., colors] if colors < pixels.shape[2] else None


def read_texture(material: Material, field: str) -> Picture:
    """Reads the picture of one of a material's textures; `auto` means raw for textures that are not colours.

    Raises:
        FieldError: the texture's file cannot be read.
    """
    texture = getattr(material, field)
    color_space = texture.color_space
    if color_space == "auto" and field not in COLOR_TEXTURES:
        color_space = "raw"
    try:
        return Picture.read(texture.file, color_space)
    except OSError as error:
        reason = f"{texture.file} ({error.strerror or error})"
        raise FieldError(material.path, field, reason, "a picture file that can be read") from None
