"""Pictures made of values at texels: encoded, with charts grown over their borders."""

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.shading.normal_map import encode_normals
from warp_smoke.shading.srgb import SrgbTable, encode_srgb, make_srgb_table

wp.set_module_options({"enable_backward": False})

DILATION = 4  # texels that a chart grows, so that filtered lookups at its border do not see the background


class TexelPicture:
    """Places of a picture that show texels; codes are 0 where there is none.

    Attributes:
        source: the texel that each place shows, −1 for none, [p] int32 on the host.
        bits: of each channel, 8 or 16.
    """

    def __init__(self, launcher: Launcher, source: np.ndarray, bits: int):
        self._launcher, self.source, self.bits = launcher, source, bits
        self._source = launcher.array(source, "bake")
        self._srgb = make_srgb_table(launcher)
        self._codes: dict[tuple[int, type], wp.array] = {}

    def _room(self, width: int, dtype: type) -> wp.array:
        """Room for codes [p, width], kept for the next time."""
        if (width, dtype) not in self._codes:
            self._codes[width, dtype] = self._launcher.zeros((max(len(self.source), 1), width), "bake", dtype=dtype)
        return self._codes[width, dtype]

    def colors(self, values: wp.array) -> np.ndarray:
        """Linear RGB of each texel, vec3, as sRGB codes [p, 3]."""
        if self.bits == 16:
            return self._deep(values, srgb=True)
        codes = self._room(3, wp.uint8)
        self._launcher.launch_each(_encode_colors, len(self.source), self._source, values, self._srgb, codes)
        return codes.numpy()

    def linear(self, values: wp.array) -> np.ndarray:
        """Linear RGB of each texel, vec3, as raw codes [p, 3] uint16."""
        return self._deep(values, srgb=False)

    def _deep(self, values: wp.array, srgb: bool) -> np.ndarray:
        codes = self._room(3, wp.uint16)
        self._launcher.launch_each(_encode_deep, len(self.source), self._source, values, int(srgb), codes)
        return codes.numpy()

    def directions(self, values: wp.array) -> np.ndarray:
        """Unit vectors of each texel, vec3, as codes of ½ (n + 1), [p, 3]."""
        codes = encode_normals(values.numpy(), self.bits)[self.source]
        codes[self.source < 0] = 0
        return codes

    def shares(self, values: wp.array) -> np.ndarray:
        """Shares 0…1 of each texel as raw codes [p]."""
        if self.bits == 16:
            codes = np.rint(65535.0 * np.clip(values.numpy(), 0.0, 1.0)).astype(np.uint16)
            return np.where(self.source >= 0, codes[self.source], np.uint16(0))
        codes = self._room(1, wp.uint8)
        self._launcher.launch_each(_encode_shares, len(self.source), self._source, values, codes)
        return codes.numpy()[:, 0]


def spread_texels(texel: np.ndarray, size: int) -> np.ndarray:
    """Which of the texels each place of a picture shows, [size²] int32: −1 where none is within `DILATION` places.

    Args:
        texel: row · size + column of each texel, [n].
        size: texels along a side.
    """
    source = np.full((size + 2, size + 2), -1, np.int32)  # with a frame, which stays empty
    inner = source[1:-1, 1:-1]
    inner.flat[texel] = np.arange(len(texel), dtype=np.int32)
    for _ in range(DILATION):
        before = source.copy()
        # Side by side first, so that a place takes the nearer neighbour.
        for row, column in ((0, 1), (1, 0), (1, 2), (2, 1), (0, 0), (0, 2), (2, 0), (2, 2)):
            empty = inner < 0
            if not empty.any():
                return inner.ravel()
            inner[empty] = before[row : row + size, column : column + size][empty]
    return inner.ravel()


@wp.kernel
def _encode_deep(
    rows: Rows, source: wp.array[int], colors: wp.array[wp.vec3], srgb: int, codes_out: wp.array2d[wp.uint16]
):
    """codes[p] = round(65535 colors[source[p]]), or of their sRGB values, or 0 without a source."""
    p = rows.first + wp.tid()
    s = source[p]
    for channel in range(3):
        value = wp.float32(0.0)
        if s >= 0 and colors[s][channel] > 0.0:  # not so for NaN
            value = wp.min(colors[s][channel], 1.0)
        if srgb > 0:
            value = wp.where(value <= 0.0031308, 12.92 * value, 1.055 * wp.pow(value, 1.0 / 2.4) - 0.055)
        codes_out[p, channel] = wp.uint16(int(65535.0 * value + 0.5))


@wp.kernel
def _encode_colors(
    rows: Rows,
    source: wp.array[int],
    colors: wp.array[wp.vec3],
    srgb: SrgbTable,
    codes_out: wp.array2d[wp.uint8],
):
    """codes[p] = sRGB(colors[source[p]]), or 0 without a source."""
    p = rows.first + wp.tid()
    s = source[p]
    color = wp.vec3(0.0)
    if s >= 0:
        color = colors[s]
    for channel in range(3):
        codes_out[p, channel] = wp.uint8(encode_srgb(srgb, color[channel]))


@wp.kernel
def _encode_shares(rows: Rows, source: wp.array[int], shares: wp.array[float], codes_out: wp.array2d[wp.uint8]):
    """codes[p] = round(255 shares[source[p]]), or 0 without a source."""
    p = rows.first + wp.tid()
    s = source[p]
    share = 0.0
    if s >= 0 and shares[s] > 0.0:  # not so for NaN
        share = wp.min(shares[s], 1.0)
    codes_out[p, 0] = wp.uint8(int(255.0 * share + 0.5))
