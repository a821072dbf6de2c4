"""16-bit PNG: every filter and interlacing, against pixels filtered by the specification's formulas one by one."""

import struct
import zlib
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from warp_smoke.deep_png import decode_deep_png, encode_deep_png

PASSES = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))


def chunk(name, data):
    """A chunk with its length and checksum."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def paeth(a, b, c):
    """The predictor as the specification writes it."""
    p = a + b - c
    pa, pb, pc = abs(p - a), abs(p - b), abs(p - c)
    if pa <= pb and pa <= pc:
        return a
    return b if pb <= pc else c


def filtered(pixels, filters):
    """Rows of bytes, each with its filter's number, byte by byte."""
    h, w, channels = pixels.shape
    step = 2 * channels
    rows = pixels.astype(">u2").reshape(h, -1).view(np.uint8).astype(int)
    data = bytearray()
    for r, kind in zip(range(h), filters, strict=False):
        data.append(kind)
        for x in range(w * step):
            a = rows[r, x - step] if x >= step else 0
            b = rows[r - 1, x] if r else 0
            c = rows[r - 1, x - step] if r and x >= step else 0
            predicted = (0, a, b, (a + b) // 2, paeth(a, b, c))[kind]
            data.append((rows[r, x] - predicted) % 256)
    return bytes(data)


def file_of(pixels, filters, interlaced=False, parts=1):
    """A PNG file with a filter for each row of the picture or of the first passes, its data in several chunks."""
    h, w, channels = pixels.shape
    data = b""
    for i, j, di, dj in PASSES if interlaced else ((0, 0, 1, 1),):
        one = pixels[i::di, j::dj]
        data += filtered(one, filters) if one.size else b""
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    header = struct.pack(">IIBBBBB", w, h, 16, kind, 0, 0, interlaced)
    packed = zlib.compress(data)
    cuts = np.linspace(0, len(packed), parts + 1).astype(int)
    body = b"".join(chunk(b"IDAT", packed[a:b]) for a, b in pairwise(cuts))
    text = chunk(b"tEXt", b"Title\0deep")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + text + body + chunk(b"IEND", b"")


@given(st.integers(1, 9), st.integers(1, 9), st.integers(1, 4), st.booleans(), st.integers(0, 2**32 - 1))
def test_every_filter_is_undone(height, width, channels, interlaced, seed):
    """Any mix of filters over the rows, interlaced or not, in one chunk or three."""
    rng = np.random.default_rng(seed)
    pixels = rng.integers(0, 65536, (height, width, channels), np.uint16)
    data = file_of(pixels, rng.integers(0, 5, height).tolist(), interlaced, parts=3)
    np.testing.assert_array_equal(decode_deep_png(data), pixels)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_what_is_encoded_is_decoded(channels):
    """Grey, grey with alpha, RGB and RGBA come back as they were."""
    pixels = np.random.default_rng(1).integers(0, 65536, (5, 7, channels), np.uint16)
    np.testing.assert_array_equal(decode_deep_png(encode_deep_png(pixels, 3)), pixels)


@given(st.data())
def test_damage_is_an_os_error(data):
    """Cut anywhere, or with a byte changed: an OSError, or the same pixels where the byte does not matter."""
    whole = encode_deep_png(np.arange(24, dtype=np.uint16).reshape(2, 4, 3), 3)
    place = data.draw(st.integers(0, len(whole) - 1))
    broken = (
        whole[:place] if data.draw(st.booleans()) else whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :]
    )
    try:
        pixels = decode_deep_png(broken)
    except OSError:
        return
    np.testing.assert_array_equal(pixels, decode_deep_png(whole))
