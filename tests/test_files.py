import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from warp_smoke.files import replacing, write_png, write_text


def test_a_finished_block_replaces_the_file(tmp_path):
    """The new content takes the place of the old, and no other file stays."""
    path = tmp_path / "a.txt"
    write_text(path, "old\n")
    write_text(path, "σ\n")
    assert path.read_bytes() == "σ\n".encode()
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_leaves_the_old_file_alone(tmp_path):
    """An error halfway through writing leaves what was there before, and nothing else."""
    path = tmp_path / "a.txt"
    write_text(path, "old")

    def write_half():
        with replacing(path) as partial:
            partial.write_text("half of the n")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("shape", [(7, 5), (7, 5, 3), (7, 5, 4)])
def test_a_picture_comes_back_as_it_was(tmp_path, shape):
    """PNG is lossless, top row first, and equal pixels give equal bytes."""
    pixels = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    for name in ("a.png", "b.png"):
        write_png(tmp_path / name, pixels)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), pixels)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_sixteen_bit_pixels_come_back_as_they_were(tmp_path):
    """Undone by hand: header, rows with filter 2 (differences to the row above, modulo 256), big-endian codes.

    Pillow reads the upper 8 bits of them.
    """
    pixels = np.random.default_rng(0).integers(0, 65536, (7, 5, 3), np.uint16)
    write_png(tmp_path / "a.png", pixels)
    data = (tmp_path / "a.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">IIBB", data[16:26]) == (5, 7, 16, 2)
    start = data.index(b"IDAT")
    (length,) = struct.unpack(">I", data[start - 4 : start])
    rows = np.frombuffer(zlib.decompress(data[start + 4 : start + 4 + length]), np.uint8).reshape(7, 31)
    assert np.all(rows[:, 0] == 2)
    codes = np.cumsum(rows[:, 1:], axis=0, dtype=np.uint8).view(">u2")
    assert np.array_equal(codes.reshape(7, 5, 3), pixels)
    assert np.array_equal(np.asarray(Image.open(tmp_path / "a.png")), pixels >> 8)


@pytest.mark.parametrize(
    "pixels", [np.zeros((2, 2)), np.zeros((2, 2, 2), np.uint8), np.zeros((2, 2), np.int32), np.zeros(4, np.uint8)]
)
def test_other_arrays_are_refused(tmp_path, pixels):
    """Floats, two channels, 32-bit numbers and rows without columns are no pictures here, and leave no file."""
    with pytest.raises(ValueError, match="uint8"):
        write_png(tmp_path / "a.png", pixels)
    assert not list(tmp_path.iterdir())
