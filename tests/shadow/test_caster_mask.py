"""What is left out around shadows: masks of casters and bounds of umbras change no answer, and leave most out."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import shining

from warp_smoke.geometry import Mesh
from warp_smoke.scene import SHADOW_FILTERS, Camera, SpotLight
from warp_smoke.shadow.cube import CubeShadow
from warp_smoke.shadow.directional import DirectionalShadow
from warp_smoke.shadow.ray_traced import RayTracedShadow
from warp_smoke.shadow.spot import SpotShadow

FLOOR = Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8))
RAYS = ("exact", "area")
BOUNDS = [[-4, 0, -4], [4, 2, 4]]
FIELDS = {"shadow_map_size": 203, "radius": 0.1}  # no multiple of the tiles


def _lights(point_light, distant_light, name):
    spot = shining((0.1, -1, 0.2))
    spot[3, :3] = 0.2, 3, -0.4
    return {
        "point": point_light((0.4, 2.6, 0.3), shadow_filter=name, **FIELDS),
        "spot": SpotLight(path="/light", transform=spot, cone_angle=50.0, shadow_filter=name, **FIELDS),
        "distant": distant_light((0.4, -1, 0.2), shadow_filter=name, shadow_map_size=203, angle=3.0),
    }


def _shadow(launcher, light, casters):
    maps = {"PointLight": CubeShadow, "SpotLight": SpotShadow, "DistantLight": DirectionalShadow}
    kind = RayTracedShadow if light.shadow_filter in RAYS else maps[type(light).__name__]
    shadow = kind(launcher, light, casters, BOUNDS, Camera(path="/camera"))
    shadow.update(1.0)
    return shadow


# A bias of one's own must be large enough for the floor not to shadow itself where it is looked up. Rays have none.
BIASED = [(name, bias) for name in SHADOW_FILTERS for bias in (None, 0.25) if bias is None or name not in RAYS]


@pytest.mark.parametrize(("name", "bias"), BIASED)
@pytest.mark.parametrize("kind", ["point", "spot", "distant"])
def test_nothing_changes(launcher, cast, point_light, distant_light, visibility, sample_surface, kind, name, bias):
    """With every tile in the mask and no bound on umbras, each filter gives every point the same bits."""
    light = replace(_lights(point_light, distant_light, name)[kind], shadow_bias=bias)
    ball, box = Mesh.sphere(0.4, segments=24), Mesh.box(0.7)
    casters = cast((ball, (0, 1, 0)), (box, (-1.2, 0.35, 0.8)), (FLOOR, (0, 0, 0)))
    rng = np.random.default_rng(0)
    count = 500 if name == "area" else 6000
    samples = [sample_surface(m, at, count, rng) for m, at in ((ball, (0, 1, 0)), (FLOOR, (0, 0, 0)))]
    points, normals = (np.concatenate(each) for each in zip(*samples, strict=True))
    shadow = _shadow(launcher, light, casters)
    expected = visibility(shadow, points, normals)
    assert 0.1 < expected.mean() < 0.9
    if isinstance(shadow, RayTracedShadow):
        shadow._tiles.mask.tiles.fill_(1)
    else:
        shadow._mask.mask.tiles.fill_(1)
        shadow.map.deepest.fill_(1.0)
    np.testing.assert_array_equal(visibility(shadow, points, normals), expected)


@pytest.mark.parametrize("name", ["hard", "pcss", "exact"])
@pytest.mark.parametrize("kind", ["point", "spot", "distant"])
def test_most_is_left_out(launcher, cast, point_light, distant_light, kind, name):
    """Around a small box over a floor few tiles may be shadowed; the floor itself, behind which nothing is, not one."""
    light = _lights(point_light, distant_light, name)[kind]
    for mesh, share in ((Mesh.box(0.2), 0.03), (None, 0.0)):
        casters = cast((FLOOR, (0, 0, 0)), *([(mesh, (0, 1, 0))] if mesh else []))
        flat = [[-4, 0, -4], [4, 0, 4]]
        kinds = {"point": CubeShadow, "spot": SpotShadow, "distant": DirectionalShadow}
        shadow = (RayTracedShadow if name == "exact" else kinds[kind])(launcher, light, casters, flat)
        shadow.update(1.0)
        tiles = (shadow._tiles if name == "exact" else shadow._mask).mask.tiles.numpy()
        # A distant light's map is fitted to what casts.
        assert tiles.mean() <= (share if kind != "distant" else np.ceil(share))
        assert bool(tiles.any()) == (mesh is not None)


def test_umbra_is_bounded(launcher, cast, point_light):
    """Under a large roof most of the tiles that it fills are known to be no deeper than it."""
    roof = Mesh.grid((-2, 1, 2), (4, 0, 0), (0, 0, -4))
    light = point_light((0, 3, 0), shadow_map_size=128)
    shadow = CubeShadow(launcher, light, cast((roof, (0, 0, 0)), (FLOOR, (0, 0, 0))), [[-4, 0, -4], [4, 0, 4]])
    shadow.update(1.0)
    deepest = shadow.map.deepest.numpy()
    far = shadow.map.far
    roofed = deepest[3, 1:-1, 1:-1]  # the face −Y, which the roof fills
    assert np.all(roofed * far < 2.0 * 3**0.5 + 1e-3)
    np.testing.assert_array_equal(deepest[2], 1.0)
