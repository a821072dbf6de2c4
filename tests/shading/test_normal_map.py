"""Normal maps against the analytic normals of sin · sin, their codes, and packed maps."""

import numpy as np
import pytest

from warp_smoke.shading.normal_map import (
    decode_normals,
    encode_normals,
    height_normals,
    pack_channels,
    unpack_channels,
)
from warp_smoke.study.light_answers import wave_heights, wave_normals

AMPLITUDE = 0.05


def waves(size):
    """Heights A sin 2πx sin 2πy at texel centres of a unit square, and their exact normals, y up."""
    along = (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(along, along[::-1])
    return wave_heights(x, y, AMPLITUDE), wave_normals(x, y, AMPLITUDE)


def largest_angle(a, b):
    """Between two fields of unit vectors [rad]; arcsin of half the chord is exact for small angles."""
    return 2 * np.arcsin(np.linalg.norm(a - b, axis=2).max() / 2)


def test_angular_error_is_of_second_order():
    """Doubling the texels divides the largest angle to the exact normals by four."""
    errors = [largest_angle(height_normals(waves(n)[0], 1.0, 1.0), waves(n)[1]) for n in (16, 32, 64, 128)]
    slope = np.polyfit(np.log([16, 32, 64, 128]), np.log(errors), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.05)


def test_a_plane_is_exact_when_clamped():
    """A slope of ½ along x and −¼ along y, in real units of a picture 3 wide and 2 high, also at the border."""
    y, x = np.mgrid[7:0:-1, 0:12]
    heights = 0.5 * x * (3 / 12) - 0.25 * y * (2 / 7)
    normal = np.array([-0.5, 0.25, 1.0]) / np.sqrt(1.3125)
    np.testing.assert_allclose(height_normals(heights, 3.0, 2.0, "clamp"), np.broadcast_to(normal, (7, 12, 3)))


def test_repeated_maps_have_no_seam():
    """Shifting the heights around the border shifts the normals."""
    heights = np.random.default_rng(1).random((8, 6))
    shifted = height_normals(np.roll(heights, (3, 2), (0, 1)), 1, 1)
    np.testing.assert_array_equal(shifted, np.roll(height_normals(heights, 1, 1), (3, 2), (0, 1)))


@pytest.mark.parametrize("wrap", ["repeat", "clamp"])
def test_one_texel_is_flat(wrap):
    """A picture of one texel has no slope."""
    np.testing.assert_array_equal(height_normals([[3.0]], 1, 1, wrap), [[[0, 0, 1]]])


def test_codes():
    """127.5 (n + 1): −1 is 0, 1 is 255, and straight up is (128, 128, 255), half a code off."""
    codes = encode_normals(np.array([[-1.0, 0.0, 1.0]]))
    np.testing.assert_array_equal(codes, [[0, 128, 255]])
    normals = waves(32)[1]
    # Half a code in each of three components: √3 · ½ · 2/255 at most.
    assert largest_angle(decode_normals(encode_normals(normals)), normals) < np.sqrt(3) / 255 * 1.01


def test_packed_maps_come_apart():
    """What is packed is what is unpacked."""
    rng = np.random.default_rng(3)
    rgb, alpha = rng.integers(0, 256, (4, 5, 3), np.uint8), rng.integers(0, 256, (4, 5), np.uint8)
    packed = pack_channels(rgb, alpha)
    assert packed.shape == (4, 5, 4)
    for found, given in zip(unpack_channels(packed), (rgb, alpha), strict=True):
        np.testing.assert_array_equal(found, given)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: height_normals(np.zeros((2, 2, 3)), 1, 1), r"heights have shape \[2, 2, 3\]; allowed: \[h, w\]"),
        (lambda: height_normals(np.zeros((0, 2)), 1, 1), r"heights have shape \[0, 2\]"),
        (lambda: height_normals(np.zeros((2, 2)), 1, 1, "mirror"), "wrap is mirror; allowed: repeat, clamp"),
        (
            lambda: pack_channels(np.zeros((2, 2, 3), np.uint8), np.zeros((4, 4), np.uint8)),
            r"maps have shapes \[2, 2, 3\] and \[4, 4\]",
        ),
        (lambda: pack_channels(np.zeros((2, 2, 3)), np.zeros((2, 2))), "pixels are float64; allowed: uint8"),
        (lambda: unpack_channels(np.zeros((2, 2, 3), np.uint8)), r"shape \[2, 2, 3\]; allowed: \[h, w, 4\]"),
    ],
)
def test_what_is_no_map_is_refused(call, message):
    """Wrong sizes, kinds and wraps are named."""
    with pytest.raises(ValueError, match=message):
        call()
