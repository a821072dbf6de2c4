"""Textures: what files hold in linear light, bilinear sampling, what lies outside, and files that cannot be read."""

import numpy as np
import pytest
import warp as wp
from PIL import Image

from warp_smoke.deep_png import encode_deep_png
from warp_smoke.launch import Rows
from warp_smoke.record import FieldError
from warp_smoke.scene import WRAP_MODES, Material, Texture
from warp_smoke.shading.looks import Looks, make_looks, sample_number, sample_texture
from warp_smoke.shading.textures import Picture, read_texture

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _sample(rows: Rows, looks: Looks, uvs: wp.array[wp.vec2], rgba_out: wp.array[wp.vec4], red_out: wp.array[float]):
    s = rows.first + wp.tid()
    rgba_out[s] = sample_texture(looks, 0, uvs[s])
    red_out[s] = sample_number(looks, 0, uvs[s])


def sample(launcher, texture, uvs, field="diffuse_texture"):
    """What a texture says at texture coordinates [n, 2]: linear RGBA [n, 4], and its one channel [n]."""
    looks = make_looks(launcher, [Material(**{field: texture})])
    uvs = launcher.array(np.asarray(uvs, np.float32), "test", dtype=wp.vec2)
    rgba, number = launcher.zeros(len(uvs), "test", dtype=wp.vec4), launcher.zeros(len(uvs), "test")
    launcher.launch_each(_sample, len(uvs), looks, uvs, rgba, number)
    return rgba.numpy(), number.numpy()


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
def test_sampling(launcher, tmp_path, wrap_s, wrap_t, shape):
    """Inside and up to three periods outside, samples equal a plain scalar sampler, in every pair of wrap modes."""
    rng = np.random.default_rng(7)
    codes = rng.integers(0, 256, (*shape, 3)).astype(np.uint8)
    texture = Texture(file=save(tmp_path / "a.png", codes), wrap_s=wrap_s, wrap_t=wrap_t, color_space="raw")
    uvs = rng.uniform(-3, 4, (300, 2)).astype(np.float32)
    uvs[:4] = [[0, 0], [1, 1], [0.5, 0.5], [-1, 2]]
    expected = [sample_slowly(codes / 255, float(u), float(v), wrap_s, wrap_t) for u, v in uvs]
    # Texel coordinates up to 20 have 2e-6 of rounding in float32.
    np.testing.assert_allclose(sample(launcher, texture, uvs)[0][:, :3], expected, atol=1e-5)


def test_rows_run_from_the_top(launcher, tmp_path):
    """The first row is v = 1, the first column u = 0; texel centres return their own values."""
    texture = Texture(file=save(tmp_path / "a.png", 10 * np.arange(6, dtype=np.uint8).reshape(2, 3)))
    uvs = [[1 / 6, 0.75], [5 / 6, 0.75], [1 / 6, 0.25], [0.5, 0.5]]
    np.testing.assert_allclose(25.5 * sample(launcher, texture, uvs)[1], [0, 2, 3, 2.5], atol=1e-5)


def test_coordinates_are_scaled_then_turned_then_moved(launcher, tmp_path):
    """UsdTransform2d: (u, v) = (0.1, 0.2) scaled by (4, 2), turned by 90° and moved by (0.5, 0.25) is (0.1, 0.65)."""
    rng = np.random.default_rng(2)
    file = save(tmp_path / "a.png", rng.integers(0, 256, (7, 5), np.uint8))
    options = {"uv_scale": (4, 2), "uv_rotation": 90, "uv_translation": (0.5, 0.25)}
    moved = sample(launcher, Texture(file=file, **options), [(0.1, 0.2)])[1]
    plain = sample(launcher, Texture(file=file), [(0.1, 0.65)])[1]
    np.testing.assert_allclose(moved, plain, atol=1e-5)


def test_packed_texture_comes_apart(launcher, tmp_path):
    """Base and gloss in one RGBA picture: colour is decoded, alpha is raw, and each is read alone."""
    file = save(tmp_path / "packed.png", np.array([[[204, 204, 204, 51]]], np.uint8))
    rgba, _ = sample(launcher, Texture(file=file), [(0.5, 0.5)])
    np.testing.assert_allclose(rgba, [[linear(204)] * 3 + [0.2]], rtol=1e-6)
    gloss = Texture(file=file, channel="a", scale=(1, 1, 1, -1), bias=(0, 0, 0, 1))
    np.testing.assert_allclose(sample(launcher, gloss, [(0.5, 0.5)], "roughness_texture")[1], 0.8, rtol=1e-6)


@pytest.mark.parametrize(("channel", "value"), [("r", 0.0), ("g", 0.2), ("b", 0.4), ("a", 1.0), ("rgb", 0.0)])
def test_channels(launcher, tmp_path, channel, value):
    """Numbers are taken from the channel named, red where all are; what is no colour is raw; alpha is 1 without one."""
    file = save(tmp_path / "data.png", np.array([[[0, 51, 102]]], np.uint8))
    found = sample(launcher, Texture(file=file, channel=channel), [(0.5, 0.5)], "height_texture")[1]
    np.testing.assert_allclose(found, value, atol=1e-6)


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
    value = Picture.read(str(file), color_space).linear()[0, 0]
    np.testing.assert_allclose(value, [expected] * 3 + [1.0], rtol=1e-6)


def test_sixteen_bits(tmp_path):
    """16-bit grey keeps all its bits and is raw; marked sRGB it is decoded."""
    file = save(tmp_path / "deep.png", np.array([[300, 65535]], np.uint16))
    raw = Picture.read(file, "auto").linear()[0, :, :3]
    np.testing.assert_allclose(raw, np.repeat([[300 / 65535], [1.0]], 3, axis=1), rtol=1e-6)
    decoded = Picture.read(file, "sRGB").linear()[0, 0, :3]
    np.testing.assert_allclose(decoded, 300 / 65535 / 12.92, rtol=1e-6)


@pytest.mark.parametrize("channels", [2, 3, 4])
def test_sixteen_bit_color(tmp_path, channels):
    """16-bit colour is raw and keeps all its bits, and so does its alpha; marked sRGB it is decoded."""
    codes = np.array([[[300, 40000, 65535, 12345][:channels]]], np.uint16)
    file = tmp_path / "deep.png"
    file.write_bytes(encode_deep_png(codes, 3))
    expected = codes[0, 0] / 65535
    expected = np.array([*np.repeat(expected[:1], 3), expected[1]] if channels == 2 else [*expected, 1.0][:4])
    np.testing.assert_allclose(Picture.read(str(file), "auto").linear()[0, 0], expected, rtol=1e-6)
    decoded = Picture.read(str(file), "sRGB").linear()[0, 0]
    np.testing.assert_allclose(decoded[[0, 3]], [300 / 65535 / 12.92, expected[3]], rtol=1e-6)


def test_black_and_white_picture(tmp_path):
    """One bit a texel is 0 and 1."""
    file = tmp_path / "bits.png"
    Image.fromarray(np.array([[True, False]])).save(file)
    np.testing.assert_array_equal(Picture.read(str(file), "auto").linear()[0, :, 0], [1, 0])


def test_scale_and_bias(launcher, tmp_path):
    """A sample is scale · texture + bias, black texels outside the picture included."""
    file = save(tmp_path / "white.png", np.full((2, 2, 3), 255, np.uint8))
    texture = Texture(file=file, wrap_s="black", scale=(0.5, 1, 1, 1), bias=(0.25, 0, -2.0, 0))
    colors = sample(launcher, texture, [[0.5, 0.5], [9.0, 0.5]])[0]
    np.testing.assert_allclose(colors, [[0.75, 1, -1, 1], [0.25, 0, -2, 0]], atol=1e-7)


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
        read_texture(material, "diffuse_texture")
    assert "\n" not in str(info.value)
