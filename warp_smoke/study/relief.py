"""Textured relief against formulas: normal maps of waves, and parallax, where a line of sight meets them."""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from warp_smoke.launch import Launcher
from warp_smoke.material import Material, Texture
from warp_smoke.shading.normal_map import decode_normals, encode_normals, height_normals
from warp_smoke.study.case import Measured, time_repeats
from warp_smoke.study.light_answers import difference, wave_heights, wave_normals
from warp_smoke.study.shaded_points import POINTS, on_square, place_points

_AMPLITUDE = 0.05
_RAW = {"color_space": "raw"}
_DIRECTIONS = _RAW | {"scale": (2.0, 2.0, 2.0, 1.0), "bias": (-1.0, -1.0, -1.0, 0.0)}
# The relief's depth, and the texels along a side of its heights.
_DEPTH, HEIGHT_TEXELS = 0.06, 256


def _waves(texels: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the heights at the centres of texels, first row at the top, and their exact normals."""
    along = (np.arange(texels) + 0.5) / texels
    x, y = np.meshgrid(along, along[::-1])
    return wave_heights(x, y, _AMPLITUDE), wave_normals(x, y, _AMPLITUDE)


def measure_heights(texels: int, launcher: Launcher, repeats: int) -> Measured:
    """Measures normals of the waves by finite differences of their heights, at the texels."""
    heights, truth = _waves(texels)
    seconds = time_repeats(launcher, lambda: height_normals(heights, 1.0, 1.0), repeats)
    return Measured(difference(height_normals(heights, 1.0, 1.0), truth, 1.0), seconds, texels**2)


def measure_stored(texels: int, launcher: Launcher, repeats: int) -> Measured:
    """Measures normals of the waves as stored in an 8-bit picture, at the texels."""
    heights, truth = _waves(texels)

    def store() -> np.ndarray:
        return decode_normals(encode_normals(height_normals(heights, 1.0, 1.0)))

    return Measured(difference(store(), truth, 1.0), time_repeats(launcher, store, repeats), texels**2)


def measure_looked_up(texels: int, launcher: Launcher, repeats: int) -> Measured:
    """Measures normals of the waves as shading looks them up in a picture, between the texels."""
    uvs = np.random.default_rng(0).random((POINTS, 2)).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "normals.png")
        Image.fromarray(encode_normals(height_normals(_waves(texels)[0], 1.0, 1.0))).save(file)
        material = Material(normal_texture=Texture(file=str(file), **_DIRECTIONS))
        points = place_points(launcher, material, np.array([0.5, 10.0, -0.5]), on_square(uvs))
    seconds = time_repeats(launcher, points.look_up, repeats)
    x, y, z = points.detail.normals.numpy().T  # the map's z is the square's y, and its y −z
    truth = wave_normals(*uvs.T.astype(np.float64), _AMPLITUDE)
    return Measured(difference(np.stack([x, -z, y], axis=1), truth, 1.0), seconds, POINTS)


def _relief_height(uv: np.ndarray) -> np.ndarray:
    """Returns the heights of the relief, 0 to 1, at texture coordinates [n, 2]."""
    return 0.5 + wave_heights(2.0 * uv[:, 0], 2.0 * uv[:, 1], 0.5)


@cache
def _relief_uvs(degrees: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the direction to the eye, texture coordinates, and those where the view ray first meets the relief."""
    angle, turn = np.radians(degrees), np.radians(30.0)
    to_eye = np.array([np.sin(angle) * np.cos(turn), np.cos(angle), -np.sin(angle) * np.sin(turn)])
    slope = np.tan(angle) * np.array([np.cos(turn), np.sin(turn)])
    uv = np.random.default_rng(0).uniform(0.3, 0.7, (POINTS // 4, 2))

    def gap(z: np.ndarray) -> np.ndarray:
        return z - _DEPTH * (_relief_height(uv + z[:, None] * slope) - 1.0)

    above, below = np.zeros(len(uv)), np.full(len(uv), -_DEPTH)
    met = np.zeros(len(uv), bool)
    for z in np.linspace(0.0, -_DEPTH, 500):
        here = np.full(len(uv), z)
        under = gap(here) <= 0.0
        below = np.where(under & ~met, z, below)
        met |= under
        above = np.where(met, above, z)
    for _ in range(40):
        middle = 0.5 * (above + below)
        free = gap(middle) > 0.0
        above, below = np.where(free, middle, above), np.where(free, below, middle)
    return to_eye, uv, uv + below[:, None] * slope


def measure_parallax(parallax: str, degrees: int, launcher: Launcher, repeats: int) -> Measured:
    """Measures where lines of sight at an angle to the normal meet the relief."""
    to_eye, uv, truth = _relief_uvs(degrees)
    along = (np.arange(HEIGHT_TEXELS) + 0.5) / HEIGHT_TEXELS
    u, v = np.meshgrid(along, along[::-1])
    heights = _relief_height(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(u.shape)
    # 256 codes in 256 texels: interpolated, the picture holds the texture coordinates exactly.
    ramp = np.dstack([np.rint(256.0 * a - 0.5) for a in (u, v, 0.5 / 256.0 + 0.0 * u)]).astype(np.uint8)
    with tempfile.TemporaryDirectory() as folder:
        Image.fromarray(np.rint(65535.0 * heights).astype(np.uint16)).save(Path(folder, "heights.png"))
        Image.fromarray(ramp).save(Path(folder, "ramp.png"))
        material = Material(
            diffuse_texture=Texture(file=str(Path(folder, "ramp.png")), wrap_s="clamp", wrap_t="clamp", **_RAW),
            height_texture=Texture(file=str(Path(folder, "heights.png")), **_RAW),
            parallax=parallax,
            parallax_scale=_DEPTH,
            parallax_bias=-_DEPTH,
        )
        points = place_points(launcher, material, 1e4 * to_eye, on_square(uv))
    seconds = time_repeats(launcher, points.look_up, repeats)
    found = (255.0 * points.detail.diffuse.numpy()[:, :2] + 0.5) / 256.0
    shift = float(np.sqrt(np.mean((truth - uv) ** 2)))
    return Measured(difference(found, truth, shift), seconds, points.count)
