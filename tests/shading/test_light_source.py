"""Light that arrives: falloff models, cones and UsdLux's radiometry at points where it is known."""

import numpy as np
import pytest
import warp as wp

from warp_smoke.launch import Rows
from warp_smoke.record import Samples
from warp_smoke.scene import DistantLight, PointLight, SpotLight
from warp_smoke.shading.light_source import LightSource, incident_light, light_source

wp.set_module_options({"enable_backward": False})

ORIGIN = np.zeros(3)


@wp.kernel
def _light_points(
    rows: Rows,
    light: LightSource,
    points: wp.array[wp.vec3],
    to_light_out: wp.array[wp.vec3],
    b_out: wp.array[wp.vec3],
):
    s = rows.first + wp.tid()
    to_light, b = incident_light(light, points[s])
    to_light_out[s] = to_light
    b_out[s] = b


def arriving(launcher, light, points, origin=ORIGIN, time=1.0):
    """Direction to the light and B at points in set space, [n, 3] each."""
    points = launcher.array(np.atleast_2d(np.asarray(points, np.float32)), "test", dtype=wp.vec3)
    to_light, b = (launcher.zeros(len(points), "test", dtype=wp.vec3) for _ in range(2))
    launcher.launch_each(_light_points, len(points), light_source(light, origin, time), points, to_light, b)
    return to_light.numpy(), b.numpy()


def at(*position):
    """A transform that moves the origin."""
    matrix = np.eye(4)
    matrix[3, :3] = position
    return matrix


def at_distances(distances):
    """Points along +x."""
    return np.stack([distances, np.zeros(len(distances)), np.zeros(len(distances))], axis=1)


def test_inverse_square(launcher):
    """A normalized point light of intensity 4π gives color/d² and the direction to it."""
    light = PointLight(path="/L", transform=at(0, 3, 0), intensity=4 * np.pi, color=(1, 0.5, 0.25))
    to_light, b = arriving(launcher, light, [[0, 0, 0], [0, 1, 0], [4, 0, 0]])
    np.testing.assert_allclose(b, np.array([[1 / 9], [1 / 4], [1 / 25]]) * (1, 0.5, 0.25), rtol=1e-6)
    np.testing.assert_allclose(to_light, [[0, 1, 0], [0, 1, 0], [-0.8, 0.6, 0]], atol=1e-6)


def test_flux_through_a_sphere(launcher):
    """The power through any sphere around a point light is π · 4π r² B = π I, whatever its radius."""
    light = PointLight(path="/L", intensity=7.0)
    for radius in (0.1, 1.0, 50.0):
        _, b = arriving(launcher, light, [[radius, 0, 0]])
        assert np.pi * 4 * np.pi * radius**2 * b[0, 0] == pytest.approx(np.pi * 7.0, rel=1e-6)


def test_flux_through_a_plane(launcher):
    """A plane catches half the power of a point light above it: the irradiance πB cos θ adds up to π I/2.

    A disk out to 1,000 heights misses 1/1000 of it.
    """
    light = PointLight(path="/L", transform=at(0, 1, 0), intensity=3.0)
    edges = np.geomspace(1e-3, 1000.0, 20_001)
    middle = np.sqrt(edges[1:] * edges[:-1])
    to_light, b = arriving(launcher, light, at_distances(middle))
    power = np.sum(np.pi * b[:, 0] * to_light[:, 1] * np.pi * np.diff(edges**2))
    assert power == pytest.approx(np.pi * 3.0 / 2, rel=1.1e-3)


def test_sphere_light_without_normalize(launcher):
    """Intensity is the sphere's radiance: B = I r²/d², so at its surface B = I; the transform's scale counts."""
    light = PointLight(path="/L", intensity=2.0, normalize=False, radius=0.5)
    _, b = arriving(launcher, light, at_distances([0.5, 1.0, 2.0]))
    np.testing.assert_allclose(b[:, 0], [2.0, 0.5, 0.125], rtol=1e-6)
    scaled = PointLight(path="/L", intensity=2.0, normalize=False, radius=0.5, transform=np.diag([3.0, 3, 3, 1]))
    np.testing.assert_allclose(arriving(launcher, scaled, at_distances([3.0]))[1][0], 0.5, rtol=1e-6)


def test_sphere_light_is_normalized_by_its_area(launcher):
    """Normalized lights do not depend on the radius, and equal a radiance of I over the area 4π r²."""
    area = 4 * np.pi * 0.3**2
    lights = [
        PointLight(path="/L", intensity=5.0, radius=0.3),
        PointLight(path="/L", intensity=5.0, radius=0.9),
        PointLight(path="/L", intensity=5.0 / area, radius=0.3, normalize=False),
        PointLight(path="/L", intensity=5.0, radius=0.0, normalize=False),  # a point counts as normalized
    ]
    answers = [arriving(launcher, light, at_distances([2.0]))[1][0, 0] for light in lights]
    np.testing.assert_allclose(answers, 5.0 / (16 * np.pi), rtol=1e-6)


@pytest.mark.parametrize(
    ("angle", "normalize", "expected"),
    [
        (0.53, True, 2.0 / np.pi),
        (0.0, True, 2.0 / np.pi),
        (0.0, False, 2.0 / np.pi),
        (60.0, False, 0.5),
        (180.0, False, 2.0),
        (300.0, False, 2.0),
    ],
)
def test_distant(launcher, angle, normalize, expected):
    """B = I/π normalized or without width, else I sin²(angle/2), everywhere and from one direction."""
    light = DistantLight(path="/L", intensity=2.0, angle=angle, normalize=normalize, transform=at(5, 5, 5))
    to_light, b = arriving(launcher, light, [[0, 0, 0], [1e6, -3, 2]])
    np.testing.assert_allclose(b, expected, rtol=1e-6)
    np.testing.assert_allclose(to_light, [[0, 0, 1], [0, 0, 1]], atol=1e-7)


def test_a_real_sun():
    """UsdLux's fallbacks, 50,000 over 0.53°, give an irradiance near π · 1.07: a white floor is about 1."""
    source = light_source(DistantLight(path="/L", intensity=50_000.0, normalize=False), ORIGIN, 1.0)
    assert source.strength[0] == pytest.approx(1.0695, rel=1e-4)


def test_linear_falloff(launcher):
    """Full strength to the start, half in the middle, nothing from the end on."""
    light = PointLight(path="/L", intensity=4 * np.pi, falloff_model="linear", falloff_start=1.0, falloff_end=5.0)
    _, b = arriving(launcher, light, at_distances([0.25, 1.0, 2.0, 3.0, 5.0, 6.0]))
    np.testing.assert_allclose(b[:, 0], [1.0, 1.0, 0.75, 0.5, 0.0, 0.0], rtol=1e-6)


def test_polynomial_falloff(launcher):
    """1/(k₀ + k₁ d + k₂ d²); a purely quadratic one is inverseSquare with I/k₂."""
    light = PointLight(path="/L", intensity=4 * np.pi, falloff_model="polynomial", attenuation=(1.0, 0.5, 0.25))
    _, b = arriving(launcher, light, at_distances([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(b[:, 0], [1.0, 1 / 1.75, 1 / 3], rtol=1e-6)
    distances = np.geomspace(0.01, 100, 50)
    quadratic = PointLight(path="/L", intensity=6.0, falloff_model="polynomial", attenuation=(0, 0, 2.0))
    square = PointLight(path="/L", intensity=3.0)
    np.testing.assert_allclose(
        arriving(launcher, quadratic, at_distances(distances))[1],
        arriving(launcher, square, at_distances(distances))[1],
        rtol=1e-6,
    )


@pytest.mark.parametrize("model", ["inverseSquare", "polynomial"])
def test_nothing_beyond_the_end(launcher, model):
    """falloff_end cuts every model off."""
    light = PointLight(path="/L", falloff_model=model, falloff_end=2.0)
    _, b = arriving(launcher, light, at_distances([1.99, 2.01]))
    assert b[0, 0] > 0
    assert b[1, 0] == 0


@pytest.mark.parametrize("model", ["inverseSquare", "linear", "polynomial"])
@pytest.mark.parametrize("record", [PointLight, SpotLight])
def test_finite_at_the_light(launcher, record, model):
    """On the light itself, next to it and for the brightest light, everything is finite."""
    light = record(path="/L", intensity=1e38, falloff_model=model, falloff_end=1e30, attenuation=(0, 0, 1))
    to_light, b = arriving(launcher, light, at_distances([0.0, 1e-30, 1e-6, 1e15]))
    assert np.all(np.isfinite(to_light))
    assert np.all(np.isfinite(b))
    np.testing.assert_array_equal(to_light[0], 0.0)


def on_a_circle(degrees):
    """Points at distance 1 and some angle from −z."""
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), np.zeros_like(angle), -np.cos(angle)], axis=1)


def test_spot_focus(launcher):
    """Without a cone's edge in the way, cos(θ)ᶠ: 1, (½)², and nothing behind; focus 0 changes nothing."""
    light = SpotLight(path="/L", intensity=4 * np.pi, focus=2.0, cone_angle=180.0)
    points = on_a_circle([0.0, 60.0, 89.9, 90.1, 180.0])
    _, b = arriving(launcher, light, points)
    expected = [1.0, 0.25, np.cos(np.radians(89.9)) ** 2, 0.0, 0.0]
    np.testing.assert_allclose(b[:, 0], expected, rtol=1e-5, atol=1e-9)
    flat = SpotLight(path="/L", intensity=4 * np.pi, cone_angle=180.0)
    np.testing.assert_allclose(arriving(launcher, flat, points)[1], 1.0, rtol=1e-6)


def test_spot_cone(launcher):
    """Softness ½ of a 40° cone fades from 20° to 40° by a smoothstep; softness 0 is a hard edge."""
    soft = SpotLight(path="/L", intensity=4 * np.pi, cone_angle=40.0, cone_softness=0.5)
    _, b = arriving(launcher, soft, on_a_circle([0.0, 19.9, 25.0, 30.0, 35.0, 40.0, 90.0]))
    np.testing.assert_allclose(b[:, 0], [1, 1, 1 - 0.15625, 0.5, 0.15625, 0, 0], atol=2e-6)
    hard = SpotLight(path="/L", intensity=4 * np.pi, cone_angle=40.0)
    _, b = arriving(launcher, hard, on_a_circle([39.99, 40.01]))
    np.testing.assert_allclose(b[:, 0], [1.0, 0.0], rtol=1e-6)


def test_narrow_cone(launcher):
    """A beam of 0.01° keeps its edge, where the cosine alone would be 1 to float32's last bit."""
    light = SpotLight(path="/L", intensity=4 * np.pi, cone_angle=0.01)
    _, b = arriving(launcher, light, on_a_circle([0.0, 0.0099, 0.0101]))
    np.testing.assert_allclose(b[:, 0], [1.0, 1.0, 0.0], rtol=1e-6)


def test_follows_the_clock_and_the_origin(launcher):
    """Position, intensity and on/off are those of the time code; positions lose nothing far from the world's origin."""
    far = np.array([1e6, -1e6, 5e5])
    light = PointLight(
        path="/L",
        transform=Samples([1, 3], np.stack([at(*far), at(4, 0, 0) @ at(*far)])),
        intensity=Samples([1, 3], [4 * np.pi, 12 * np.pi]),
        enabled=Samples([1, 4], [True, False]),
    )
    to_light, b = arriving(launcher, light, [[1, 0, 0]], origin=far, time=2.0)
    np.testing.assert_allclose(to_light[0], [1, 0, 0])
    np.testing.assert_allclose(b[0], 2.0, rtol=1e-6)
    np.testing.assert_array_equal(arriving(launcher, light, [[1, 0, 0]], origin=far, time=4.0)[1], 0.0)
