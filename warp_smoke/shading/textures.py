"""Pictures on surfaces: read from files as codes, with the linear value of each code."""

from dataclasses import dataclass
from typing import BinaryIO

import numpy as np
from PIL import Image

from warp_smoke.deep_png import decode_deep_png
from warp_smoke.material import COLOR_TEXTURES
from warp_smoke.picture_file import open_picture_file, tile_files
from warp_smoke.record import FieldError
from warp_smoke.scene import Material
from warp_smoke.shading.srgb import decode_srgb

# Of tiles that are joined: 4 GiB as linear RGBA.
_MOST_TEXELS = 2**28


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture as it is stored, and the linear values of its codes.

    Attributes:
        codes: [h, w, 3], or [h, w, 1] for grey; uint8 or uint16; first row at the top (v = 1).
        levels: linear value of each code, [256] or [65536] float32.
        alpha: [h, w] uint8 or uint16, always raw, or None.
        tiles: how many unit squares of texture coordinates it covers along u and along v, from the origin.
    """

    codes: np.ndarray
    levels: np.ndarray
    alpha: np.ndarray | None = None
    tiles: tuple[int, int] = (1, 1)

    @classmethod
    def read(cls, file: str, color_space: str) -> "Picture":
        """Reads an 8-bit picture, a 16-bit grey one, or a PNG with 16-bit colour.

        Args:
            file: in any format that Pillow reads; may lie in a `.usdz` package: `PACKAGE[FILE]`; with `<UDIM>` all of
                its tiles are read as one picture.
            color_space: sRGB, raw, or auto: sRGB for 8-bit colour, raw for grey and for 16 bits.

        Raises:
            OSError: the file is missing, damaged, or not such a picture.
        """
        tiles = {place: _read_file(tile) for place, tile in tile_files(file).items()}
        codes, alpha = next(iter(tiles.values())) if len(tiles) == 1 and (0, 0) in tiles else _join_tiles(tiles)
        deep = codes.dtype == np.uint16
        levels = np.linspace(0.0, 1.0, 65536 if deep else 256)
        if color_space == "sRGB" or (color_space == "auto" and codes.shape[2] == 3 and not deep):
            levels = decode_srgb(levels)
        columns, rows = (max(numbers) + 1 for numbers in zip(*tiles, strict=True))
        return cls(codes, levels.astype(np.float32), alpha, (columns, rows))

    def linear(self) -> np.ndarray:
        """Returns the linear RGBA of each texel, [h, w, 4] float32; alpha is 1 where the file has none."""
        pixels = np.ones((*self.codes.shape[:2], 4), np.float32)
        pixels[..., :3] = self.levels[self.codes]
        if self.alpha is not None:
            pixels[..., 3] = self.alpha / np.float32(np.iinfo(self.alpha.dtype).max)
        return pixels


def _read_file(file: str) -> tuple[np.ndarray, np.ndarray | None]:
    """Reads the codes of one file [h, w, 1 or 3], and its alpha [h, w]."""
    try:
        with open_picture_file(file) as opened, Image.open(opened) as image:
            deep = image.mode.startswith("I;16") or any(";16" in str(tile.args) for tile in image.tile)
            return _read_deep(image, opened) if deep else _read_codes(image)
    except (SyntaxError, ValueError, Image.DecompressionBombError) as error:  # some damaged files; too large ones
        raise OSError(str(error)) from None


def _join_tiles(
    tiles: dict[tuple[int, int], tuple[np.ndarray, np.ndarray | None]],
) -> tuple[np.ndarray, np.ndarray | None]:
    """Joins codes and alpha of tiles, given by column and row; black and opaque where there is no tile.

    Smaller tiles are stretched to the size of the largest by repeating texels.
    """
    codes = [codes for codes, _ in tiles.values()]
    if len({each.dtype for each in codes}) > 1:
        raise OSError("some of its tiles have 8 bits and others 16")
    height, width, channels = np.max([each.shape for each in codes], axis=0).tolist()
    columns, rows = (max(numbers) + 1 for numbers in zip(*tiles, strict=True))
    if columns * width * rows * height > _MOST_TEXELS:
        size = f"{columns * width} × {rows * height} texels"
        raise OSError(f"its tiles, up to column {columns} and row {rows}, make {size}; allowed: {_MOST_TEXELS}")
    joined = np.zeros((rows * height, columns * width, channels), codes[0].dtype)
    alpha = np.full(joined.shape[:2], np.iinfo(joined.dtype).max, joined.dtype)
    for (column, row), (tile, tile_alpha) in tiles.items():
        top, left = (rows - 1 - row) * height, column * width  # the first row of texels is at the top
        place = np.s_[top : top + height, left : left + width]
        nearest = np.ix_(np.arange(height) * tile.shape[0] // height, np.arange(width) * tile.shape[1] // width)
        joined[place] = tile[nearest]
        if tile_alpha is not None:
            alpha[place] = tile_alpha[nearest]
    return joined, alpha if any(each is not None for _, each in tiles.values()) else None


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
