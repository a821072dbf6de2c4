"""Blinn-Phong and Schlick against hand-computed values, a float64 reference and the closed form of the albedo."""

import numpy as np
import pytest
import warp as wp

from warp_smoke.geometry import normalized
from warp_smoke.launch import Rows
from warp_smoke.material import REFLECTIONS
from warp_smoke.shading.blinn_phong import blinn_phong_exponent, reflect_diffuse
from warp_smoke.shading.blinn_phong import reflect as reflect_light
from warp_smoke.study.light_answers import blinn_phong, blinn_phong_albedo

wp.set_module_options({"enable_backward": False})

VECTOR = wp.vec3


@wp.kernel
def _reflect_samples(
    rows: Rows,
    to_light: wp.array[wp.vec3],
    to_eye: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    light: wp.vec3,
    diffuse: wp.vec3,
    r0: wp.vec3,
    gloss: wp.vec2,
    model: int,
    full_out: wp.array[wp.vec3],
    diffuse_out: wp.array[wp.vec3],
):
    s = rows.first + wp.tid()
    full_out[s] = reflect_light(light, to_light[s], to_eye[s], normal[s], diffuse, r0, gloss, model)
    diffuse_out[s] = reflect_diffuse(light, to_light[s], normal[s], diffuse)


def reflect(
    launcher,
    to_light,
    to_eye,
    normal,
    *,
    light=(1, 1, 1),
    diffuse=(0, 0, 0),
    r0=(1, 1, 1),
    m=0.0,
    gloss=1.0,
    model="blinnPhong",
):
    """Reflected radiance of each sample, with highlights and without, [n, 3] each."""
    vectors = [np.atleast_2d(np.asarray(v, np.float32)) for v in (to_light, to_eye, normal)]
    vectors = [launcher.array(np.ascontiguousarray(v), "test", dtype=VECTOR) for v in np.broadcast_arrays(*vectors)]
    count = len(vectors[0])
    full, matte = (launcher.zeros(count, "test", dtype=VECTOR) for _ in range(2))
    colors = (VECTOR(*map(float, color)) for color in (light, diffuse, r0))
    gloss = wp.vec2(float(gloss), float(m))
    launcher.launch_each(_reflect_samples, count, *vectors, *colors, gloss, REFLECTIONS.index(model), full, matte)
    return full.numpy(), matte.numpy()


@pytest.mark.parametrize("m", [0.0, 8.0, 64.0, 256.0])
def test_head_on(launcher, m):
    """Light, eye and normal in one line: m_d + R₀ (m + 8)/8."""
    up = (0, 1, 0)
    full, matte = reflect(launcher, up, up, up, light=(1, 2, 3), diffuse=(0.5, 0.25, 0.1), r0=(0.01, 0.04, 1.0), m=m)
    expected = np.array([1, 2, 3]) * (np.array([0.5, 0.25, 0.1]) + np.array([0.01, 0.04, 1.0]) * (m + 8) / 8)
    np.testing.assert_allclose(full[0], expected, rtol=1e-6)
    np.testing.assert_allclose(matte[0], [0.5, 0.5, 0.3], rtol=1e-6)


def test_mirror_direction(launcher):
    """Light 60° from the normal, eye on its mirror: h = n, h·l = ½, F = R₀ + (1 − R₀)/32, times cos 60°."""
    s = np.sqrt(0.75)
    full, _ = reflect(launcher, (s, 0.5, 0), (-s, 0.5, 0), (0, 1, 0), r0=(0.04, 0.5, 0), m=64)
    fresnel = np.array([0.04, 0.5, 0]) + (1 - np.array([0.04, 0.5, 0])) / 32
    np.testing.assert_allclose(full[0], fresnel * 9 * 0.5, rtol=1e-6)


def test_lobe_off_the_mirror(launcher):
    """Light along the normal, eye 60° off: n·h = cos 30°, so m = 2 gives (10/8)(3/4)."""
    full, _ = reflect(launcher, (0, 1, 0), (np.sqrt(0.75), 0.5, 0), (0, 1, 0), m=2)
    np.testing.assert_allclose(full[0], 0.9375, rtol=1e-6)


def test_light_behind_the_surface(launcher):
    """No light from below, not even at the horizon, and finite where light and eye are opposite (h = 0)."""
    down, side = (0, -1, 0), (1, 0, 0)
    for to_light, to_eye in ((down, down), (side, (0, 1, 0)), (down, (0, 1, 0)), (side, (-1, 0, 0))):
        full, matte = reflect(launcher, to_light, to_eye, (0, 1, 0), diffuse=(1, 1, 1), m=128)
        np.testing.assert_array_equal(full, 0.0)
        np.testing.assert_array_equal(matte, 0.0)
    full, _ = reflect(launcher, (0, 1, 0), down, (0, 1, 0), diffuse=(1, 1, 1), m=128)
    np.testing.assert_array_equal(full, 1.0)


@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_against_float64(launcher, roughness):
    """10,000 random directions agree with the formula in float64.

    (n·h)²⁵⁶ magnifies the 1e-7 of a float32 cosine 256 times, and the lobe's peak is 33.
    """
    rng = np.random.default_rng(3)
    to_light, to_eye, normal = (normalized(rng.standard_normal((10_000, 3))) for _ in range(3))
    light, diffuse, r0 = np.array([1.0, 0.5, 2.0]), np.array([0.2, 0.6, 0.0]), np.array([0.01, 0.3, 0.9])
    m = blinn_phong_exponent(roughness)
    full, matte = reflect(launcher, to_light, to_eye, normal, light=light, diffuse=diffuse, r0=r0, m=m)
    np.testing.assert_allclose(full, blinn_phong(to_light, to_eye, normal, light, diffuse, r0, m), rtol=1e-4, atol=1e-5)
    lambert = light * diffuse * np.maximum(np.sum(normal * to_light, axis=1), 0)[:, None]
    np.testing.assert_allclose(matte, lambert, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("model", ["blinnPhong", "energyConserving"])
@pytest.mark.parametrize("m", [0.0, 9.0, 64.0, 256.0])
def test_albedo_at_normal_incidence(launcher, m, model):
    """A perfect mirror colour reflects (m + 8)(m + 2^(−m/2))/((m + 2)(m + 4)) of the light in all; conserving, all.

    The midpoint rule over 4,000 angles is exact to 1e-6 here; float32 cosines add about m · 1e-7.
    """
    steps = 4000
    angle = (np.arange(steps) + 0.5) * (np.pi / 2 / steps)
    to_eye = np.stack([np.sin(angle), np.cos(angle), np.zeros(steps)], axis=1)
    full, _ = reflect(launcher, (0, 1, 0), to_eye, (0, 1, 0), m=m, model=model)
    # B = 1 is an irradiance of π; radiance goes out through 2π sin θ cos θ dθ.
    reflected = np.sum(full[:, 0] * 2 * np.pi * np.sin(angle) * np.cos(angle)) * (np.pi / 2 / steps) / np.pi
    expected = blinn_phong_albedo(m) if model == "blinnPhong" else 1.0
    assert reflected == pytest.approx(expected, rel=2e-5)


def test_conserving_base_and_highlight_share_the_light(launcher):
    """Head on with m = 0: (1 − R₀) m_d + R₀: a white surface reflects white, whatever R₀ is."""
    up = (0, 1, 0)
    options = {"diffuse": (1, 1, 0.5), "r0": (0.04, 0.5, 0.2), "model": "energyConserving"}
    full, _ = reflect(launcher, up, up, up, **options)
    np.testing.assert_allclose(full[0], [1.0, 1.0, 0.8 * 0.5 + 0.2], rtol=1e-6)


def test_ldr_highlights(launcher):
    """The highlight s becomes s/(s + 1): R₀ = (0.04, 0.5, 1) and m = 64 give s = (0.36, 4.5, 9)."""
    up = (0, 1, 0)
    full, _ = reflect(launcher, up, up, up, diffuse=(0.1, 0.1, 0.1), r0=(0.04, 0.5, 1), m=64, model="blinnPhongLdr")
    np.testing.assert_allclose(full[0], 0.1 + np.array([0.36 / 1.36, 4.5 / 5.5, 0.9]), rtol=1e-6)


def test_classic_highlights(launcher):
    """R₀ (n·h)⁶⁴ with neither Fresnel term nor factor: light 60° off its mirror direction gives cos⁶⁴ 30° / 2."""
    s = np.sqrt(0.75)
    full, _ = reflect(launcher, (s, 0.5, 0), (s, 0.5, 0), (0, 1, 0), r0=(0.5, 0.5, 1), m=64, model="classic")
    np.testing.assert_allclose(full[0], np.array([0.5, 0.5, 1]) * 0.5**64 * 0.5, rtol=1e-4)
    full, _ = reflect(launcher, (s, 0.5, 0), (-s, 0.5, 0), (0, 1, 0), r0=(0.5, 0.5, 1), m=64, model="classic")
    np.testing.assert_allclose(full[0], np.array([0.5, 0.5, 1]) * 0.5, rtol=1e-6)


@pytest.mark.parametrize("model", REFLECTIONS)
def test_gloss_multiplies_highlights_alone(launcher, model):
    """With gloss ½ every model's highlight is half as bright and its base the same."""
    up = (0, 1, 0)
    options = {"diffuse": (0.25, 0.25, 0.25), "r0": (0.04, 0.2, 0.5), "m": 16, "model": model}
    none, half, whole = (reflect(launcher, up, up, up, gloss=gloss, **options)[0][0] for gloss in (0.0, 0.5, 1.0))
    np.testing.assert_allclose(half, (none + whole) / 2, rtol=1e-6)
    assert np.all(whole > none)


def test_albedo_values():
    """What the closed form says of the (m + 8)/8 factor: 1 at m = 0, 1.075 near m = 9, 1.0075 at m = 256."""
    np.testing.assert_allclose([blinn_phong_albedo(m) for m in (0.0, 9.0, 256.0)], [1.0, 1.075, 1.0075], atol=6e-4)


def test_exponent():
    """Roughness 0 is an exponent of 256, roughness 1 none."""
    assert [blinn_phong_exponent(r) for r in (0.0, 0.75, 1.0)] == [256.0, 64.0, 0.0]
