"""PNG with 16 bits per channel, which Pillow cannot write in colour and reads in colour only at 8 bits.

Source: W3C, *Portable Network Graphics (PNG) Specification*, third edition: chapters 5 (chunks), 8 (interlacing), 9
(filters) and 10 (compression).
"""

import struct
import zlib
from collections.abc import Iterator

import numpy as np

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# Channels of each colour type: grey, RGB, grey with alpha, RGBA.
_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}
_SUB, _UP, _AVERAGE, _PAETH = 1, 2, 3, 4
# First row and column, and steps between rows and columns, of each pass of an interlaced picture (Adam7).
_PASSES = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))


def encode_deep_png(pixels: np.ndarray, compress_level: int) -> bytes:
    """Encodes a PNG file; each row is stored as its difference from the one above.

    Args:
        pixels: uint16 [h, w, c] with 1 to 4 channels: grey, grey with alpha, RGB, RGBA; first row at the top.
        compress_level: zlib's compression level, 0 to 9.
    """
    height, width, channels = pixels.shape
    kind = next(kind for kind, count in _CHANNELS.items() if count == channels)
    rows = np.zeros((height, 1 + 2 * channels * width), np.uint8)
    rows[:, 0] = _UP
    codes = pixels.astype(">u2").reshape(height, -1).view(np.uint8)
    rows[:, 1:] = np.diff(codes, axis=0, prepend=np.uint8(0))  # modulo 256

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0)
    data = zlib.compress(rows.tobytes(), compress_level)
    return _SIGNATURE + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def decode_deep_png(data: bytes) -> np.ndarray:
    """Decodes a 16-bit PNG file to pixels, uint16 [h, w, c], first row at the top.

    Raises:
        OSError: the data is damaged or not a 16-bit PNG file.
    """
    chunks = list(_chunks(data))
    if not chunks or chunks[0][0] != b"IHDR" or len(chunks[0][1]) != 13:
        raise OSError("no PNG header")
    width, height, bits, kind, _, _, interlaced = struct.unpack(">IIBBBBB", chunks[0][1])
    if bits != 16 or kind not in _CHANNELS or not (width and height):
        raise OSError(f"a PNG of {bits} bits and colour type {kind}")
    depth = 2 * _CHANNELS[kind]
    passes = _PASSES if interlaced else ((0, 0, 1, 1),)
    sizes = [(len(range(i, height, di)), len(range(j, width, dj))) for i, j, di, dj in passes]
    sizes = [(h, w) if w else (0, 0) for h, w in sizes]  # a pass without columns has no rows either
    needed = sum(h * (1 + w * depth) for h, w in sizes)
    try:
        stream = zlib.decompressobj()
        packed = b"".join(content for name, content in chunks if name == b"IDAT")
        raw = np.frombuffer(stream.decompress(packed, needed), np.uint8)
    except zlib.error as error:
        raise OSError(str(error)) from None
    if len(raw) < needed:
        raise OSError("cut short")
    pixels = np.empty((height, width, depth), np.uint8)
    start = 0
    for (i, j, di, dj), (h, w) in zip(passes, sizes, strict=True):
        lines = raw[start : start + h * (1 + w * depth)].reshape(h, 1 + w * depth)
        start += lines.size
        if lines.size:
            pixels[i::di, j::dj] = _unfilter(lines[:, 0], lines[:, 1:].reshape(h, w, depth))
    return pixels.view(">u2").astype(np.uint16)


def _chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    if not data.startswith(_SIGNATURE):
        raise OSError("no PNG signature")
    place = len(_SIGNATURE)
    while place + 12 <= len(data):
        (length,) = struct.unpack(">I", data[place : place + 4])
        name, content = data[place + 4 : place + 8], data[place + 8 : place + 8 + length]
        check = data[place + 8 + length : place + 12 + length]
        if len(check) < 4 or struct.unpack(">I", check)[0] != zlib.crc32(name + content):
            raise OSError(f"damaged in {name.decode('latin-1')}")
        yield name, content
        place += 12 + length


def _unfilter(filters: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Undoes the filters [h] of rows of bytes [h, w, d]: each byte was stored minus a prediction from its neighbours.

    The neighbours are the left, upper and upper left pixels, so all pixels on a diagonal r + x = n are decoded at once.
    """
    if filters.max(initial=0) > _PAETH:
        raise OSError(f"filter {filters.max()}")
    height, width, depth = rows.shape
    pixels = np.empty_like(rows)
    filters = filters[:, None]
    # Row r of a diagonal is at index r + 1; pixels left of and above the picture stay 0.
    diagonals = [np.zeros((height + 1, depth), np.int16) for _ in range(3)]
    for n in range(height + width - 1):
        first, last = max(0, n - width + 1), min(height, n + 1)
        found, before, earlier = (diagonals[(n - k) % 3] for k in range(3))
        left, up, corner = before[first + 1 : last + 1], before[first:last], earlier[first:last]
        here = np.arange(first, last)
        kind = filters[first:last]
        predicted = np.where(kind == _SUB, left, 0)
        np.copyto(predicted, up, where=kind == _UP)
        np.copyto(predicted, (left + up) >> 1, where=kind == _AVERAGE)
        np.copyto(predicted, _paeth(left, up, corner), where=kind == _PAETH)
        values = (rows[here, n - here] + predicted) & 255
        found[first + 1 : last + 1] = values
        pixels[here, n - here] = values
    return pixels


def _paeth(left: np.ndarray, up: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """Returns the neighbour nearest to left + up − corner; ties go to left, then up."""
    to_left, to_up, to_corner = np.abs(up - corner), np.abs(left - corner), np.abs(left + up - 2 * corner)
    nearest = np.where(to_up <= to_corner, up, corner)
    return np.where((to_left <= to_up) & (to_left <= to_corner), left, nearest)
