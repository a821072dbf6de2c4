"""Reader of OpenEXR pictures with one part in scan lines, uncompressed or with the codecs RLE, ZIPS and ZIP.

Source: Academy Software Foundation, *OpenEXR File Layout* and *Technical Introduction to OpenEXR*.
"""

import struct
import zlib
from collections.abc import Iterator

import numpy as np

from warp_smoke.sky.rows import Rows, UnsupportedPicture

SIGNATURE = b"\x76\x2f\x31\x01"
_LONG_NAMES = 0x400
_CODECS = ("NONE", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
_ROWS_OF_A_BLOCK = {"NONE": 1, "RLE": 1, "ZIPS": 1, "ZIP": 16}
_NUMBERS = ("<u4", "<f2", "<f4")


def read_exr(data: bytes) -> Rows:
    """Reads a picture with the channels R, G and B, or only Y, which becomes grey.

    Raises:
        UnsupportedPicture: it has tiles, several parts, deep pixels, another codec or other channels.
        ValueError, IndexError, struct.error, zlib.error: the file is damaged; also raised while blocks are read.
    """
    version, flags = data[4], int.from_bytes(data[5:8], "little") << 8
    if version != 2 or flags & ~_LONG_NAMES:
        raise UnsupportedPicture("an OpenEXR file of tiles, of several parts or with deep pixels")
    header, at = _read_header(data)
    codec = _CODECS[header["compression"][0]]
    if codec not in _ROWS_OF_A_BLOCK:
        raise UnsupportedPicture(f"an OpenEXR file with the codec {codec}; NONE, RLE, ZIPS and ZIP are read")
    left, top, right, bottom = struct.unpack("<4i", header["dataWindow"])
    height, width = bottom - top + 1, right - left + 1
    if height < 1 or width < 1:
        raise ValueError("it has no pixels")
    channels = _read_channels(header["channels"])
    for color in "RGB" if "R" in channels else "Y":
        if color not in channels:
            raise UnsupportedPicture(f"an OpenEXR file with the channels {', '.join(channels)}")
    count = -(-height // _ROWS_OF_A_BLOCK[codec])
    places = struct.unpack_from(f"<{count}Q", data, at)
    return Rows(height, _read_blocks(data, places, codec, top, height, width, channels))


def _read_header(data: bytes) -> tuple[dict[str, bytes], int]:
    """Returns the attributes' bytes by name, and the offset at which the header ends."""
    attributes, at = {}, 8
    while data[at]:
        name, at = _read_name(data, at)
        _, at = _read_name(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    missing = {"channels", "compression", "dataWindow"} - attributes.keys()
    if missing:
        raise ValueError(f"its header has no {min(missing)}")
    return attributes, at + 1


def _read_name(data: bytes, at: int) -> tuple[str, int]:
    end = data.index(0, at)
    return data[at:end].decode("latin-1"), end + 1


def _read_channels(data: bytes) -> dict[str, np.dtype]:
    """Returns the number type of each channel, in their order within a row."""
    channels, at = {}, 0
    while data[at]:
        name, at = _read_name(data, at)
        kind, _, step_x, step_y = struct.unpack_from("<iB3x2i", data, at)
        if (step_x, step_y) != (1, 1):
            raise UnsupportedPicture(f"an OpenEXR file whose channel {name} has fewer pixels")
        channels[name] = np.dtype(_NUMBERS[kind])
        at += 16
    return channels


def _read_blocks(
    data: bytes,
    places: tuple[int, ...],
    codec: str,
    top: int,
    height: int,
    width: int,
    channels: dict[str, np.dtype],
) -> Iterator[tuple[int, np.ndarray]]:
    line = np.dtype([(name, number, width) for name, number in channels.items()])
    names = list("RGB") if "R" in channels else ["Y"] * 3
    for place in places:
        y, size = struct.unpack_from("<2i", data, place)
        first = y - top
        rows = min(_ROWS_OF_A_BLOCK[codec], height - first)
        if not 0 <= first < height:
            raise ValueError(f"it has a row {y}")
        packed = data[place + 8 : place + 8 + size]
        lines = np.frombuffer(_unpack(packed, codec, rows * line.itemsize), line)
        yield first, np.stack([lines[name].astype(np.float32) for name in names], axis=-1)


def _unpack(packed: bytes, codec: str, size: int) -> bytes:
    """Returns the unpacked bytes of a block, which is stored uncompressed if the codec would enlarge it."""
    if len(packed) == size or codec == "NONE":
        plain = packed
    else:
        plain = _join_bytes(_unpack_runs(packed) if codec == "RLE" else zlib.decompress(packed))
    if len(plain) != size:
        raise ValueError(f"a block has {len(plain)} bytes and not {size}")
    return plain


def _unpack_runs(packed: bytes) -> bytes:
    """Undoes run-length encoding: a byte n ≥ 0 repeats the next byte n + 1 times, n < 0 precedes −n literal bytes."""
    parts, at = [], 0
    while at < len(packed):
        count = packed[at] - 256 if packed[at] > 127 else packed[at]
        if count < 0:
            parts.append(packed[at + 1 : at + 1 - count])
            at += 1 - count
        else:
            parts.append(packed[at + 1 : at + 2] * (count + 1))
            at += 2
    return b"".join(parts)


def _join_bytes(packed: bytes) -> bytes:
    """Undoes the predictor (differences plus 128) and the reordering (even bytes before odd ones)."""
    steps = np.frombuffer(packed, np.uint8).copy()
    steps[1:] -= 128  # modulo 256
    values = np.cumsum(steps, dtype=np.uint8)
    half = -(-len(values) // 2)
    joined = np.empty_like(values)
    joined[::2], joined[1::2] = values[:half], values[half:]
    return joined.tobytes()
