"""sRGB: the standard's values, and codes that are exact for every boundary between two of them."""

import numpy as np
import warp as wp

from warp_smoke.launch import Rows
from warp_smoke.shading.srgb import SrgbTable, decode_srgb, encode_srgb, make_srgb_table

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _encode_values(rows: Rows, table: SrgbTable, values: wp.array[float], codes_out: wp.array[int]):
    s = rows.first + wp.tid()
    codes_out[s] = encode_srgb(table, values[s])


def encode(launcher, values):
    """Codes of linear values."""
    values = launcher.array(np.asarray(values, np.float32), "test")
    codes = launcher.zeros(len(values), "test", dtype=int)
    launcher.launch_each(_encode_values, len(values), make_srgb_table(launcher), values, codes)
    return codes.numpy()


def formula(linear):
    """IEC 61966-2-1 in float64, 0…255, not rounded."""
    linear = np.asarray(linear, np.float64)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def test_known_values(launcher):
    """Middle grey 0.18 is 118, a half 188, the ends 0 and 255; decoding 0.5 gives 0.214."""
    np.testing.assert_array_equal(encode(launcher, [0.0, 0.18, 0.5, 1.0]), [0, 118, 188, 255])
    # The standard rounds its 0.0031308 to five digits.
    np.testing.assert_allclose(decode_srgb([0.0, 0.04045, 0.5, 1.0]), [0, 0.0031308, 0.21404114, 1.0], rtol=2e-6)


def test_codes_come_back(launcher):
    """Decoding a code and encoding it again gives the same code, for all 256."""
    np.testing.assert_array_equal(encode(launcher, decode_srgb(np.arange(256) / 255)), np.arange(256))


def test_boundaries(launcher):
    """A value 1e-6 below or above each of the 255 boundaries gets the code below or above it.

    At the boundary itself float32 may fall either way; 1e-6 is 8 of its steps or less.
    """
    boundary = decode_srgb((np.arange(255) + 0.5) / 255)
    np.testing.assert_array_equal(encode(launcher, boundary * (1 - 1e-6)), np.arange(255))
    np.testing.assert_array_equal(encode(launcher, boundary * (1 + 1e-6)), np.arange(1, 256))


def test_every_code_is_the_nearest(launcher):
    """A million values: none is further than half a code from the formula.

    The margin is one step of float32 (6e-8) times the steepest slope, 255 · 12.92.
    """
    values = np.concatenate([np.linspace(0, 1, 600_001), np.geomspace(1e-6, 1, 400_000)]).astype(np.float32)
    assert np.abs(encode(launcher, values) - formula(values)).max() <= 0.5 + 2e-4


def test_outside_the_range(launcher):
    """Values outside [0, 1] are clipped, infinities too; NaN is black."""
    values = [-np.inf, -1.0, -1e-30, 1.0000001, 1e30, np.inf, np.nan]
    np.testing.assert_array_equal(encode(launcher, values), [0, 0, 0, 255, 255, 255, 0])
