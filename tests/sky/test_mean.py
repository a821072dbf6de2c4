import struct
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from warp_smoke.sky import UnsupportedPicture, mean_radiance
from warp_smoke.sky.exr import read_exr
from warp_smoke.sky.radiance_hdr import read_radiance_hdr

WRITTEN = Path(__file__).parent / "written_by_blender"
HEIGHT, WIDTH = 18, 9


def known_picture():
    """What the files of `written_by_blender` hold, [18, 9, 3]: each channel varies in its own way."""
    row, column = np.mgrid[:HEIGHT, :WIDTH]
    return np.stack([column / 8, row / 4, np.where(column < 5, 0.5, 20.0)], axis=-1)


def whole(picture):
    """The rows of a picture, put together."""
    found = np.full((picture.height, WIDTH, 3), np.nan)
    for first, block in picture.blocks:
        found[first : first + len(block)] = block
    return found


def file_of(pixels):
    """A PNG file."""
    file = BytesIO()
    Image.fromarray(np.uint8(pixels)).save(file, "PNG")
    return file.getvalue()


@pytest.mark.parametrize("name", ["none16", "rle32", "zips16", "zip16"])
def test_openexr_by_another_program(name):
    """Each codec, in half and single precision, gives the numbers that Blender was given, to its precision."""
    seen = whole(read_exr((WRITTEN / f"{name}.exr").read_bytes()))
    np.testing.assert_allclose(seen, known_picture(), rtol=2**-10)  # of half precision; the display adds no more


def test_radiance_by_another_program():
    """Rows in runs and in plain bytes give Blender's numbers, to the 8 bits of a shared exponent."""
    seen = whole(read_radiance_hdr((WRITTEN / "sky.hdr").read_bytes()))
    brightest = known_picture().max(axis=-1, keepdims=True)
    assert np.all(np.abs(seen - known_picture()) <= brightest / 128)


def test_plain_radiance():
    """Without runs, four bytes a pixel: mantissa · 2^(exponent − 136)."""
    data = b"#?RADIANCE\n\n-Y 1 +X 2\n" + bytes([128, 64, 0, 129, 1, 2, 3, 136])
    ((first, block),) = read_radiance_hdr(data).blocks
    assert first == 0
    assert block.tolist() == [[[1.0, 0.5, 0.0], [1.0, 2.0, 3.0]]]


def test_even_sky():
    """One colour everywhere is its own mean, and said to be even."""
    mean, even = mean_radiance(file_of(np.full((7, 5, 3), (255, 0, 255))))
    np.testing.assert_allclose(mean, (1, 0, 1), atol=1e-15)
    assert even


@pytest.mark.parametrize("rows", [2, 6, 180])
def test_share_of_a_cap(rows):
    """A white cap down to the polar angle θ covers (1 − cos θ)/2 of all directions."""
    pixels = np.zeros((rows, 4, 3))
    pixels[: rows // 2] = 255
    assert mean_radiance(file_of(pixels))[0] == pytest.approx(0.5)
    pixels[rows // 3 :] = 0  # θ = 60°, but a single row cannot be halved
    if rows > 2:
        mean, even = mean_radiance(file_of(pixels))
        assert mean == pytest.approx(0.25)
        assert not even


def test_infinite_suns_count_as_the_most_that_half_precision_holds():
    """A sun that was too bright for the file does not make the light from everywhere infinite."""
    data = bytearray((WRITTEN / "none16.exr").read_bytes())
    plain = mean_radiance(bytes(data))[0]
    data[-2:] = struct.pack("<e", np.inf)  # red of the last pixel, which was 1
    share = (np.cos(np.pi / HEIGHT * (HEIGHT - 1)) + 1) / 2 / WIDTH
    np.testing.assert_allclose(mean_radiance(bytes(data))[0] - plain, (65503 * share, 0, 0), rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda data: (WRITTEN / "piz16.exr").read_bytes(), "the codec PIZ"),
        (lambda data: data[:5] + b"\x02" + data[6:], "tiles"),
        (lambda data: data.replace(b"B\0\1", b"A\0\1").replace(b"R\0\1", b"Z\0\1"), "the channels A, G, Z"),
        (lambda data: b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n", "32-bit_rle_xyze"),
        (lambda data: b"#?RADIANCE\n\n+X 1 -Y 1\n", "top left"),
        (lambda data: b"no picture", "nor what Pillow reads"),
    ],
)
def test_what_is_not_read_says_why(change, reason):
    """Kinds of files that are not read are told apart from damaged ones."""
    with pytest.raises(UnsupportedPicture, match=reason):
        mean_radiance(change((WRITTEN / "zip16.exr").read_bytes()))


@given(st.sampled_from(sorted(each.name for each in WRITTEN.iterdir())), st.data())
def test_damage(name, data):
    """Files that are cut or changed anywhere give a picture, or one of the two errors."""
    content = bytearray((WRITTEN / name).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    del content[data.draw(st.integers(0, len(content))) :]
    try:
        mean, _ = mean_radiance(bytes(content))
    except (OSError, UnsupportedPicture):
        return
    assert np.isfinite(mean).all()
