"""Reader of Radiance pictures (`.hdr`): three mantissas with a common exponent.

Source: G. Ward, *Real Pixels*, Graphics Gems II (1991), and Radiance's *Picture File Format*.
"""

import re
from collections.abc import Iterator

import numpy as np

from warp_smoke.sky.rows import Rows, UnsupportedPicture

SIGNATURE = b"#?"
_BIAS = 128 + 8  # of the exponent, and 8 bits for mantissas of 0 to 255


def read_radiance_hdr(data: bytes) -> Rows:
    """Reads a picture of RGBE pixels in rows from the top.

    Raises:
        UnsupportedPicture: it has another colour format, or rows in another order.
        ValueError, IndexError: the file is damaged; also raised while blocks are read.
    """
    end = data.index(b"\n\n") + 2
    kind = re.search(rb"^FORMAT=(.*)$", data[:end], re.MULTILINE)
    if kind and kind[1].strip() != b"32-bit_rle_rgbe":
        raise UnsupportedPicture(f"a Radiance file of the format {kind[1].decode('latin-1')}")
    size_end = data.index(b"\n", end) + 1
    size = re.fullmatch(rb"-Y (\d+) \+X (\d+)\s*", data[end:size_end])
    if not size:
        raise UnsupportedPicture("a Radiance file whose rows do not run from the top left")
    height, width = map(int, size.groups())
    if not 0 < height * width <= 32 * len(data):  # 2 bytes for a run of 127, 4 to a pixel: at most 16 pixels a byte
        raise ValueError(f"{len(data)} bytes cannot hold {width} × {height} pixels")
    return Rows(height, _read_blocks(data, size_end, height, width))


def _read_blocks(data: bytes, at: int, height: int, width: int) -> Iterator[tuple[int, np.ndarray]]:
    in_runs = b"\x02\x02" + width.to_bytes(2, "big")
    for row in range(height):
        if data[at : at + 4] == in_runs:
            pixels, at = _unpack_runs(data, at + 4, width)
        else:
            pixels = np.frombuffer(data, np.uint8, 4 * width, at).reshape(width, 4)
            at += 4 * width
        yield row, np.ldexp(pixels[None, :, :3].astype(np.float32), pixels[None, :, 3:].astype(np.int32) - _BIAS)


def _unpack_runs(data: bytes, at: int, width: int) -> tuple[np.ndarray, int]:
    """Returns one row, [width, 4] uint8, and its end offset; a byte n > 128 repeats the next byte n − 128 times."""
    parts, count = [], 0
    while count < 4 * width:
        n = data[at]
        if n > 128:
            n -= 128
            parts.append(data[at + 1 : at + 2] * n)
            at += 2
        else:
            parts.append(data[at + 1 : at + 1 + n])
            at += 1 + n
        count += n
    return np.frombuffer(b"".join(parts), np.uint8).reshape(4, width).T, at
