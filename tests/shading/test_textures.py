"""Textures: what files hold in linear light, bilinear sampling, what lies outside, and files that cannot be read."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from warp_smoke.record import FieldError
from warp_smoke.scene import WRAP_MODES, Material, Texture
from warp_smoke.shading.textures import Picture, diffuse_colors


def save(path, codes):
    """Writes a picture file of codes."""
    Image.fromarray(codes).save(path)
    return str(path)


def linear(code):
    """IEC 61966-2-1 of an 8-bit code."""
    c = code / 255
    return c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4


def sample_slowly(values, u, v, wrap_s, wrap_t):
    """Bilinear sampling of linear RGB [h, w, 3] at one place, as it is written in textbooks."""

    def fetch(row, column):
        place = []
        for index, count, mode in ((row, values.shape[0], wrap_t), (column, values.shape[1], wrap_s)):
            if mode == "black" and not 0 <= index < count:
                return np.zeros(3)
            if mode == "repeat":
                index = index % count
            elif mode == "mirror":
                while not 0 <= index < count:
                    index = -1 - index if index < 0 else 2 * count - 1 - index
            place.append(min(max(index, 0), count - 1))
        return values[tuple(place)]

    x, y = u * values.shape[1] - 0.5, (1 - v) * values.shape[0] - 0.5
    column, row = int(np.floor(x)), int(np.floor(y))
    s, t = x - column, y - row
    top = (1 - s) * fetch(row, column) + s * fetch(row, column + 1)
    bottom = (1 - s) * fetch(row + 1, column) + s * fetch(row + 1, column + 1)
    return (1 - t) * top + t * bottom


@pytest.mark.parametrize("wrap_s", WRAP_MODES)
@pytest.mark.parametrize("wrap_t", WRAP_MODES)
@pytest.mark.parametrize("shape", [(5, 3), (1, 1), (1, 4)])
def test_sampling(wrap_s, wrap_t, shape):
    """Inside and up to three periods outside, samples equal a plain scalar sampler, in every pair of wrap modes."""
    rng = np.random.default_rng(7)
    picture = Picture(rng.integers(0, 256, (*shape, 3)).astype(np.uint8), np.linspace(0, 1, 256, dtype=np.float32))
    uvs = rng.uniform(-3, 4, (300, 2)).astype(np.float32)
    uvs[:4] = [[0, 0], [1, 1], [0.5, 0.5], [-1, 2]]
    values = picture.codes / 255
    expected = [sample_slowly(values, float(u), float(v), wrap_s, wrap_t) for u, v in uvs]
    np.testing.assert_allclose(picture.sample(uvs, wrap_s, wrap_t), expected, atol=1e-6)


def test_rows_run_from_the_top():
    """The first row is v = 1, the first column u = 0; texel centres return their own values."""
    codes = np.arange(6, dtype=np.uint8).reshape(2, 3, 1)
    picture = Picture(codes, np.arange(256, dtype=np.float32))
    uvs = np.array([[1 / 6, 0.75], [5 / 6, 0.75], [1 / 6, 0.25], [0.5, 0.5]], np.float32)
    np.testing.assert_allclose(picture.sample(uvs, "clamp", "clamp")[:, 0], [0, 2, 3, 2.5], atol=1e-5)


@pytest.mark.parametrize(
    ("mode", "color_space", "expected"),
    [
        ("RGB", "auto", linear(204)),
        ("RGB", "sRGB", linear(204)),
        ("RGB", "raw", 204 / 255),
        ("RGBA", "auto", linear(204)),
        ("P", "auto", linear(204)),
        ("L", "auto", 204 / 255),
        ("LA", "auto", 204 / 255),
        ("L", "sRGB", linear(204)),
    ],
)
def test_color_spaces(tmp_path, mode, color_space, expected):
    """8-bit colour is sRGB unless it is said to be raw, grey is raw unless it is said to be sRGB."""
    file = tmp_path / "flat.png"
    Image.new("RGB", (1, 1), (204, 204, 204)).convert(mode).save(file)
    value = Picture.read(str(file), color_space).sample(np.array([[0.3, 0.9]]), "repeat", "repeat")
    np.testing.assert_allclose(value, np.full((1, 3), expected), rtol=1e-6)


def test_sixteen_bits(tmp_path):
    """16-bit grey keeps all its bits and is raw; marked sRGB it is decoded."""
    file = save(tmp_path / "deep.png", np.array([[300, 65535]], np.uint16))
    uvs = np.array([[0.25, 0.5], [0.75, 0.5]])
    raw = Picture.read(file, "auto").sample(uvs, "clamp", "clamp")
    np.testing.assert_allclose(raw, np.repeat([[300 / 65535], [1.0]], 3, axis=1), rtol=1e-6)
    decoded = Picture.read(file, "sRGB").sample(uvs, "clamp", "clamp")
    np.testing.assert_allclose(decoded[0], 300 / 65535 / 12.92, rtol=1e-6)


def test_sixteen_bit_color(tmp_path):
    """16-bit colour is raw, and good to 1/255: Pillow keeps the upper 8 bits."""
    header = struct.pack(">IIBBBBB", 1, 1, 16, 2, 0, 0, 0)
    pixel = struct.pack(">B3H", 0, 0, 32768, 65535)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(pixel)), (b"IEND", b""))
    parts = [struct.pack(">I", len(d)) + name + d + struct.pack(">I", zlib.crc32(name + d)) for name, d in chunks]
    file = tmp_path / "deep.png"
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))
    value = Picture.read(str(file), "auto").sample(np.array([[0.5, 0.5]]), "clamp", "clamp")
    np.testing.assert_allclose(value, [[0.0, 0.5, 1.0]], atol=1 / 255)


def test_black_and_white_picture(tmp_path):
    """One bit a texel is 0 and 1."""
    file = tmp_path / "bits.png"
    Image.fromarray(np.array([[True, False]])).save(file)
    value = Picture.read(str(file), "auto").sample(np.array([[0.25, 0.5], [0.75, 0.5]]), "clamp", "clamp")
    np.testing.assert_array_equal(value[:, 0], [1, 0])


def test_scale_and_bias(tmp_path):
    """Diffuse colour is scale · texture + bias, black texels outside the picture included, and never below 0."""
    file = save(tmp_path / "white.png", np.full((2, 2, 3), 255, np.uint8))
    texture = Texture(file=file, wrap_s="black", scale=(0.5, 1, 1, 1), bias=(0.25, 0, -2.0, 0))
    colors = diffuse_colors(Material(diffuse_texture=texture), np.array([[0.5, 0.5], [9.0, 0.5]], np.float32), 2)
    np.testing.assert_allclose(colors, [[0.75, 1, 0], [0.25, 0, 0]], atol=1e-7)


def test_fallback_colors():
    """Without a texture the material's colour; with one but no coordinates also."""
    plain = Material(diffuse_color=(0.1, 0.2, 0.3))
    textured = Material(diffuse_color=(0.1, 0.2, 0.3), diffuse_texture=Texture(file="/nowhere.png"))
    for material, uvs in ((plain, np.zeros((4, 2))), (plain, None), (textured, None)):
        np.testing.assert_allclose(diffuse_colors(material, uvs, 4), np.tile([0.1, 0.2, 0.3], (4, 1)), rtol=1e-6)


@pytest.mark.parametrize("damage", ["missing", "text", "cut", "folder", "float"])
def test_unreadable_files(tmp_path, damage):
    """A file that is missing, not a picture, cut short, a folder or of 32-bit numbers: material and file are named."""
    file = tmp_path / "picture.png"
    if damage == "text":
        file.write_text("not a picture")
    elif damage == "cut":
        noise = np.random.default_rng(1).integers(0, 256, (64, 64, 3)).astype(np.uint8)
        whole = (tmp_path / "whole.png", save(tmp_path / "whole.png", noise))[0].read_bytes()
        file.write_bytes(whole[: len(whole) // 2])
    elif damage == "folder":
        file.mkdir()
    elif damage == "float":
        file = tmp_path / "picture.tif"
        save(file, np.ones((2, 2), np.float32))
    material = Material(path="/Looks/Wood", diffuse_texture=Texture(file=str(file)))
    with pytest.raises(
        FieldError, match=r"^/Looks/Wood: diffuse_texture is .*picture\.(png|tif) \(.*; allowed: "
    ) as info:
        diffuse_colors(material, np.zeros((1, 2)), 1)
    assert "\n" not in str(info.value)
