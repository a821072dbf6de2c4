"""sRGB's transfer function (IEC 61966-2-1): from codes to linear light, and back by an exact table.

The table splits [0, 1] into cells narrower than the distance between two codes, so each cell holds at most one
boundary: the code is the one at the cell's start, or the next if the value is past that code's upper boundary.
"""

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher

wp.set_module_options({"enable_backward": False})

# Boundaries lie at least 1/(255 · 12.92) = 1/3295 apart; a power of two makes value · cells exact.
_CELLS = wp.constant(4096)


@wp.struct
class SrgbTable:
    """Codes at the start of each cell, [4097], and the linear value where each code ends, [256]."""

    codes: wp.array[wp.uint8]
    ends: wp.array[float]


def decode_srgb(encoded: np.ndarray) -> np.ndarray:
    """Returns the linear light in [0, 1] of sRGB values in [0, 1], float64."""
    encoded = np.asarray(encoded, np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def srgb_levels() -> np.ndarray:
    """Returns the linear light of each code, [256] float32."""
    return decode_srgb(np.arange(256) / 255.0).astype(np.float32)


def encode_srgb_codes(linear: np.ndarray) -> np.ndarray:
    """Returns the sRGB codes nearest to linear values, uint8; values outside [0, 1] are clipped."""
    ends = decode_srgb((np.arange(255) + 0.5) / 255.0)
    return np.searchsorted(ends, linear, side="right").astype(np.uint8)


def make_srgb_table(launcher: Launcher) -> SrgbTable:
    """Makes the table that `encode_srgb` takes."""
    ends = decode_srgb((np.arange(255) + 0.5) / 255.0).astype(np.float32)
    starts = np.arange(_CELLS + 1, dtype=np.float32) / _CELLS
    table = SrgbTable()
    table.codes = launcher.array(np.searchsorted(ends, starts, side="right").astype(np.uint8), "bake")
    table.ends = launcher.array(np.append(ends, np.float32(2.0)), "bake")
    return table


@wp.func
def encode_srgb(table: SrgbTable, linear: float):
    """The sRGB code 0…255 nearest to a linear value; values outside [0, 1] are clipped, NaN is 0."""
    x = wp.where(linear > 0.0, wp.min(linear, 1.0), 0.0)
    code = int(table.codes[int(x * float(_CELLS))])
    return code + wp.where(x >= table.ends[code], 1, 0)
