"""Computed pictures: the Mandelbrot set, a checkerboard, and noise.

Sources: the TyphoonLabs GLSL course (Mandelbrot set and its colours); K. Perlin, "Improving Noise", 2002 (gradient
noise with a quintic fade, here periodic over the picture).
"""

import numpy as np

from warp_smoke.material import Procedural
from warp_smoke.shading.srgb import encode_srgb_codes, srgb_levels
from warp_smoke.shading.textures import Picture

# Step of the blend between the two outer colours per iteration.
_BLEND = 0.05
_OCTAVES = 5


def make_picture(procedural: Procedural) -> Picture:
    """Computes the picture as it is written to a file: sRGB codes [size, size, 3], first row at the top."""
    along = (np.arange(procedural.size) + 0.5) / procedural.size
    share, black = _SHARES[procedural.kind](procedural, along, along[::-1, None])
    first, second = np.array(procedural.color1), np.array(procedural.color2)
    colors = np.where(np.expand_dims(black, -1), 0.0, first + share[..., None] * (second - first))
    return Picture(encode_srgb_codes(colors), srgb_levels())


def mandelbrot_iterations(c: np.ndarray, most: int) -> np.ndarray:
    """Counts steps z ← z² + c from 0 until |z|² ≥ 4; `most` + 1 if it takes more; int, in the shape of c (complex)."""
    count = np.full(c.shape, most + 1)
    z, place, start = np.zeros(c.size, complex), np.arange(c.size), c.ravel()
    for step in range(1, most + 1):
        z = z * z + start
        gone = z.real**2 + z.imag**2 >= 4.0
        count.flat[place[gone]] = step
        z, place, start = z[~gone], place[~gone], start[~gone]
    return count


def _mandelbrot(procedural: Procedural, u: np.ndarray, v: np.ndarray):
    """Mandelbrot set of c = 5 (uv − ½)/zoom + center: black inside, fract(0.05 · iterations) of a blend outside."""
    scale = 5.0 / procedural.zoom
    x, y = procedural.center
    c = (u - 0.5) * scale + x + 1j * ((v - 0.5) * scale + y)
    iterations = mandelbrot_iterations(c, procedural.max_iterations)
    return (_BLEND * iterations) % 1.0, iterations > procedural.max_iterations


def _checker(procedural: Procedural, u: np.ndarray, v: np.ndarray):
    squares = np.floor(u * procedural.repeats) + np.floor(v * procedural.repeats)
    return squares % 2.0, False


def _noise(procedural: Procedural, u: np.ndarray, v: np.ndarray):
    """Returns ½ + ½ Σ 2⁻ᵏ noise(2ᵏ repeats · uv), within 0…1."""
    total = 0.0
    for octave in range(_OCTAVES):
        period = procedural.repeats * 2**octave
        total += 0.5**octave * gradient_noise(u * period, v * period, period)
    return np.clip(0.5 + 0.5 * total, 0.0, 1.0), False


def gradient_noise(x: np.ndarray, y: np.ndarray, period: int) -> np.ndarray:
    """Computes two-dimensional Perlin noise, −1…1, zero at integers, periodic in `period`.

    Coordinates are broadcast against each other: for a picture, a row and a column are fastest.
    """
    i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    f, g = x - i, y - j

    # A table of the directions at all integers, unless these outnumber the samples.
    table = _directions(*np.indices((period, period))) if period * period < np.broadcast(x, y).size else None

    def corner(a: int, b: int) -> np.ndarray:
        place = (i + a) % period, (j + b) % period
        along_x, along_y = (each[place] for each in table) if table else _directions(*place)
        return along_x * (f - a) + along_y * (g - b)

    s, t = (w * w * w * (w * (6.0 * w - 15.0) + 10.0) for w in (f, g))
    low = corner(0, 0) + s * (corner(1, 0) - corner(0, 0))
    high = corner(0, 1) + s * (corner(1, 1) - corner(0, 1))
    return np.sqrt(2.0) * (low + t * (high - low))


def _directions(i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the cosine and sine of a random angle for each pair of integers."""
    angle = _hash(i, j) * (2.0 * np.pi / 2**32)
    return np.cos(angle), np.sin(angle)


def _hash(i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Hashes two integers to 32 bits (C. Wellons, lowbias32)."""
    h = (i * 73856093 ^ j * 19349663).astype(np.uint32)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        h = (h ^ (h >> np.uint32(shift))) * np.uint32(factor)
    return h ^ (h >> np.uint32(16))


_SHARES = {"mandelbrot": _mandelbrot, "checker": _checker, "noise": _noise}
