"""Computed pictures: the Mandelbrot set's known numbers, checker squares, and noise."""

import numpy as np
import pytest

from warp_smoke.scene import Procedural
from warp_smoke.shading.procedural import gradient_noise, make_picture, mandelbrot_iterations


@pytest.mark.parametrize(("c", "steps"), [(2, 1), (-2, 1), (1, 2), (0.5, 5), (0, 51), (-1, 51), (0.25, 51), (1j, 51)])
def test_known_numbers(c, steps):
    """From 0: 2 and −2 are on |z| = 2 at once, 1 goes 1, 2; ½ goes ½, ¾, 1.06, 1.63, 3.15; the rest never leave."""
    assert mandelbrot_iterations(np.array([complex(c)]), 50)[0] == steps


def test_mandelbrot_picture():
    """The middle is inside and black; the corner leaves at the first step: a twentieth of the way from red to green."""
    picture = make_picture(Procedural(kind="mandelbrot", size=64))
    linear = picture.linear()[..., :3]
    np.testing.assert_array_equal(linear[32, 32], 0)
    np.testing.assert_allclose(linear[0, 0], [0.95, 0.05, 0.0], atol=0.004)  # half a code of sRGB


def test_mandelbrot_is_symmetric():
    """The set is its own mirror image in the real axis, which is the picture's middle row."""
    codes = make_picture(Procedural(kind="mandelbrot", size=64, center=(-0.5, 0.0), zoom=1.5)).codes
    np.testing.assert_array_equal(codes, codes[::-1])


def test_zoom_and_center():
    """A picture at twice the zoom around a point is the middle of a larger one."""
    wide = make_picture(Procedural(kind="mandelbrot", size=128, center=(-0.5, 0.25), zoom=2.0)).codes
    near = make_picture(Procedural(kind="mandelbrot", size=64, center=(-0.5, 0.25), zoom=4.0)).codes
    np.testing.assert_array_equal(near, wide[32:96, 32:96])


def test_more_iterations_leave_less_inside():
    """What has left once stays out."""
    black = [
        ~make_picture(Procedural(kind="mandelbrot", size=64, max_iterations=n)).codes.any(axis=2) for n in (1, 20, 128)
    ]
    assert np.all(black[0] >= black[1])
    assert np.all(black[1] >= black[2])
    assert black[2].any()


def test_checker():
    """Squares of the first colour at the picture's lower left corner and on its diagonal."""
    picture = make_picture(Procedural(kind="checker", size=8, repeats=4, color1=(1, 1, 1), color2=(0, 0, 0)))
    rows, columns = np.mgrid[0:8, 0:8]
    expected = np.where(((7 - rows) // 2 + columns // 2) % 2 == 0, 255, 0)
    np.testing.assert_array_equal(picture.codes, np.repeat(expected[..., None], 3, axis=2))


def test_noise_is_zero_at_whole_numbers_and_repeats():
    """Gradient noise vanishes on its lattice, stays within −1…1, and repeats after its period."""
    x, y = np.random.default_rng(4).uniform(0, 5, (2, 2000))
    values = gradient_noise(x, y, 5)
    assert np.abs(values).max() <= 1
    assert values.std() > 0.1
    np.testing.assert_allclose(gradient_noise(x + 5, y - 10, 5), values, atol=1e-9)
    np.testing.assert_array_equal(gradient_noise(np.arange(5.0), np.arange(5.0), 5), 0)


def test_noise_lies_between_its_colors():
    """Every texel is a blend of the two colours, and both ends of the range are used."""
    linear = make_picture(Procedural(kind="noise", size=128, color1=(0, 0, 0), color2=(1, 1, 1))).linear()[..., 0]
    assert linear.min() < 0.3
    assert linear.max() > 0.7


def test_same_picture_each_time():
    """A picture is made of its settings alone."""
    procedural = Procedural(kind="noise", size=32, repeats=3)
    np.testing.assert_array_equal(make_picture(procedural).codes, make_picture(procedural).codes)
