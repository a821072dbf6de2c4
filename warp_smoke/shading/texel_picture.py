"""Pictures made from values at texels: encoded, with charts dilated until they meet."""

from typing import Any

import numpy as np
import warp as wp
from scipy.ndimage import distance_transform_edt

from warp_smoke.launch import Launcher, Rows
from warp_smoke.shading.normal_map import encode_normals
from warp_smoke.shading.srgb import SrgbTable, encode_srgb, make_srgb_table

wp.set_module_options({"enable_backward": False})


class TexelPicture:
    """The pictures of one receiver, each under a name: codes [p, channels], 0 at places that show no texel.

    Attributes:
        source: the texel that each place shows, −1 for none, [p] int32 on the host.
    """

    def __init__(self, launcher: Launcher, source: np.ndarray, bits: int):
        self._launcher, self.source, self._bits = launcher, source, bits
        self._srgb = make_srgb_table(launcher)
        self._codes: dict[str, wp.array] = {}
        self.whole = Change(launcher, source)

    def _room(self, name: str, channels: int, dtype: type) -> wp.array:
        if name not in self._codes:
            self._codes[name] = self._launcher.zeros((len(self.source), channels), "bake", dtype=dtype)
        return self._codes[name]

    def colors(self, name: str, values: wp.array, change: "Change") -> np.ndarray:
        """Encodes linear RGB of the texels in `change`, vec3, as sRGB codes [p, 3]."""
        if self._bits == 16:
            return self._deep(name, values, change, srgb=True)
        codes = self._room(name, 3, wp.uint8)
        args = (change.source, change.flags, values, self._srgb, codes)
        self._launcher.launch_each(_encode_colors, len(self.source), *args)
        return codes.numpy()

    def linear(self, name: str, values: wp.array, change: "Change") -> np.ndarray:
        """Encodes linear RGB of texels, vec3, as raw codes [p, 3] uint16."""
        return self._deep(name, values, change, srgb=False)

    def _deep(self, name: str, values: wp.array, change: "Change", srgb: bool) -> np.ndarray:
        codes = self._room(name, 3, wp.uint16)
        args = (change.source, change.flags, values, int(srgb), codes)
        self._launcher.launch_each(_encode_deep, len(self.source), *args)
        return codes.numpy()

    def shares(self, name: str, values: wp.array, change: "Change") -> np.ndarray:
        """Encodes shares 0…1 of texels as raw codes [p]."""
        deep = self._bits == 16
        codes = self._room(name, 1, wp.uint16 if deep else wp.uint8)
        kernel, last = (_encode_shares_16, 65535.0) if deep else (_encode_shares_8, 255.0)
        self._launcher.launch_each(kernel, len(self.source), change.source, change.flags, values, last, codes)
        return codes.numpy()[:, 0]

    def directions(self, values: wp.array) -> np.ndarray:
        """Encodes unit vectors of all texels, vec3, as codes of ½ (n + 1), [p, 3]."""
        codes = encode_normals(values.numpy(), self._bits)[self.source]
        codes[self.source < 0] = 0
        return codes


class Change:
    """Which texels of a picture get new values, as a list of k.

    Attributes:
        source: index into the list for each place of the picture, −1 where it keeps its codes, [p].
        flags: 1 for the texels of the list that actually change, [k].
    """

    def __init__(self, launcher: Launcher, source: np.ndarray):
        self.source = launcher.array(source, "bake")
        self.flags = launcher.array(np.ones(source.max(initial=0) + 1, np.uint8), "bake")


def spread_texels(texel: np.ndarray, size: int) -> np.ndarray:
    """Returns the texel that each place of a picture shows, [size²] int32: the nearest one, or −1 if there are none.

    So charts grow until they meet: lookups at their borders, and coarser mip levels, see no background.

    Args:
        texel: row · size + column of each texel, [n].
        size: texels along a side.
    """
    source = np.full(size**2, -1, np.int32)
    source[texel] = np.arange(len(texel), dtype=np.int32)
    empty = source < 0
    if not len(texel) or not empty.any():
        return source
    shape = (size, size)
    row, column = distance_transform_edt(empty.reshape(shape), return_distances=False, return_indices=True)
    return source.reshape(shape)[row, column].ravel()


@wp.func
def is_kept(source: wp.array[int], flags: wp.array[wp.uint8], p: int):
    """Whether a place of a picture keeps its codes."""
    s = source[p]
    if s < 0:
        return True
    return flags[s] == wp.uint8(0)


@wp.func
def within_unit(x: float):
    """A number clipped to 0…1; 0 for NaN."""
    return wp.where(x > 0.0, wp.min(x, 1.0), 0.0)


@wp.kernel
def _encode_colors(
    rows: Rows,
    source: wp.array[int],
    flags: wp.array[wp.uint8],
    colors: wp.array[wp.vec3],
    srgb: SrgbTable,
    codes_inout: wp.array2d[wp.uint8],
):
    """codes[p] = sRGB(colors[source[p]])."""
    p = rows.first + wp.tid()
    if is_kept(source, flags, p):
        return
    color = colors[source[p]]
    for channel in range(3):
        codes_inout[p, channel] = wp.uint8(encode_srgb(srgb, color[channel]))


@wp.kernel
def _encode_deep(
    rows: Rows,
    source: wp.array[int],
    flags: wp.array[wp.uint8],
    colors: wp.array[wp.vec3],
    srgb: int,
    codes_inout: wp.array2d[wp.uint16],
):
    """codes[p] = round(65535 colors[source[p]]), or of their sRGB values."""
    p = rows.first + wp.tid()
    if is_kept(source, flags, p):
        return
    color = colors[source[p]]
    for channel in range(3):
        value = within_unit(color[channel])
        if srgb > 0:
            value = wp.where(value <= 0.0031308, 12.92 * value, 1.055 * wp.pow(value, 1.0 / 2.4) - 0.055)
        codes_inout[p, channel] = wp.uint16(int(65535.0 * value + 0.5))


@wp.kernel
def _encode_shares(
    rows: Rows,
    source: wp.array[int],
    flags: wp.array[wp.uint8],
    shares: wp.array[float],
    last: float,
    codes_inout: wp.array2d[Any],
):
    """codes[p] = round(last · shares[source[p]])."""
    p = rows.first + wp.tid()
    if not is_kept(source, flags, p):
        codes_inout[p, 0] = codes_inout.dtype(int(last * within_unit(shares[source[p]]) + 0.5))


_encode_shares_8, _encode_shares_16 = (
    wp.overload(_encode_shares, {"codes_inout": wp.array2d[code]}) for code in (wp.uint8, wp.uint16)
)
