"""Lights as parallel rays through smoke: as strong as at the smoke's middle, from the light's direction."""

import numpy as np
import pytest
from scenes import at, shining

import warp_smoke as ws
from warp_smoke.preview.lights import beam_on

CENTER = np.array([0.0, 1.0, 0.0])


def _spot(degrees, **shape):
    """A spot light 4 units above the centre, turned away from it by an angle."""
    angle = np.radians(degrees)
    place = shining((np.sin(angle), -np.cos(angle), 0)) @ at(0, 5, 0)
    return ws.SpotLight(path="/Spot", transform=place, intensity=30.0, color=(1.0, 0.5, 0.25), **shape)


def _share(light):
    """Of what a light that shines everywhere gives."""
    everywhere = ws.PointLight(path="/Lamp", transform=at(0, 5, 0), intensity=30.0, color=(1.0, 0.5, 0.25))
    beam, plain = (beam_on(each, CENTER, 1.0, 1.0) for each in (light, everywhere))
    np.testing.assert_allclose(beam.direction, (0, -1, 0), atol=1e-12)
    np.testing.assert_allclose(plain.radiance, 30 / (4 * np.pi * 16) * np.array([1.0, 0.5, 0.25]), rtol=1e-6)
    shares = beam.radiance / plain.radiance
    assert np.ptp(shares) < 1e-6
    return shares[0]


@pytest.mark.parametrize(
    ("degrees", "shape", "expected"),
    [
        (0, {"cone_angle": 20.0}, 1.0),
        (19, {"cone_angle": 20.0}, 1.0),
        (21, {"cone_angle": 20.0}, 0.0),
        (60, {"focus": 1.0}, 0.5),
        (60, {"focus": 3.0}, 0.125),
        (120, {"focus": 1.0, "cone_angle": 180.0}, 0.0),
        (30, {"cone_angle": 40.0, "cone_softness": 0.5}, 0.5),  # half way between 20° and 40°
        (25, {"cone_angle": 40.0, "cone_softness": 0.5}, 0.84375),  # 1 − 3/16 + 2/64
    ],
)
def test_spot_lights_keep_to_their_cone(degrees, shape, expected):
    """cosᶠ θ times the cone's edge, as surfaces are lit."""
    assert _share(_spot(degrees, **shape)) == pytest.approx(expected, abs=1e-5)
