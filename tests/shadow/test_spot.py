"""The spot light's map: known shadows inside its cone, no acne, and light beside it."""

import numpy as np
import pytest
from scenes import shining

from warp_smoke.geometry import Mesh
from warp_smoke.scene import SpotLight
from warp_smoke.shadow.cube import CubeShadow
from warp_smoke.shadow.spot import SpotShadow

BOUNDS = [[-4, -1, -4], [4, 4, 4]]
UP = (0, 1, 0)
FLOOR = Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8))


def _spot(position, direction=(0, -1, 0), **fields):
    matrix = shining(direction)
    matrix[3, :3] = position
    return SpotLight(path="/light", transform=matrix, **{"cone_angle": 40.0, "shadow_filter": "hard"} | fields)


def _shadow(launcher, light, casters):
    shadow = SpotShadow(launcher, light, casters, BOUNDS)
    shadow.update(1.0)
    return shadow


def test_sphere_above_plane(launcher, cast, visibility):
    """The shadow is the disk of radius H R / √(d² − R²); the area wrongly classified falls like 1/N."""
    height, radius, above = 3.0, 0.5, 2.0
    casters = cast((Mesh.sphere(radius, segments=256), (0, height - above, 0)), (FLOOR, (0, 0, 0)))
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1.7, 1.7, 200_000), np.zeros(200_000), rng.uniform(-1.7, 1.7, 200_000)])
    distance = np.hypot(points[:, 0], points[:, 2])
    edge = height * radius / np.sqrt(above**2 - radius**2)
    sizes, wrong = (64, 128, 256, 512), []
    for size in sizes:
        lit = visibility(_shadow(launcher, _spot((0, height, 0), shadow_map_size=size), casters), points, UP)
        mistaken = (lit == 1.0) != (distance > edge)
        wrong.append(mistaken.mean())
        # A texel is 2 H tan(40°) / N wide on the floor.
        assert np.abs(distance - edge)[mistaken].max() < 2.0 * 2 * height * np.tan(np.radians(40)) / size
    assert 0.8 < -np.polyfit(np.log(sizes), np.log(wrong), 1)[0] < 1.3


@pytest.mark.parametrize("size", [33, 512])
@pytest.mark.parametrize("direction", [(0, -1, 0), (0.4, -1, 0.2)])
def test_no_acne_on_flat_and_convex_surfaces(launcher, cast, visibility, sample_surface, size, direction):
    """With `auto` bias no lit point of a plane or a convex mesh is in shadow."""
    light, rng = np.array([0.7, 2.5, -0.4]), np.random.default_rng(1)
    for mesh, position in ((FLOOR, (0, 0, 0)), (Mesh.sphere(segments=24), (0.8, 0.5, 0)), (Mesh.box(), (1, 0, 0))):
        points, normals = sample_surface(mesh, position, 20_000, rng)
        facing = np.sum((light - points) * normals, axis=1) > 0
        shadow = _shadow(launcher, _spot(light, direction, shadow_map_size=size), cast((mesh, position)))
        np.testing.assert_array_equal(visibility(shadow, points, normals), facing)


def test_beside_the_cone_is_lit(launcher, cast, visibility):
    """Beside the map, behind the light and beyond `shadow_far` there is no shadow; inside the cone there is."""
    casters = cast((Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8)), (0, 1, 0)), (FLOOR, (0, 0, 0)))
    shadow = _shadow(launcher, _spot((0, 2, 0)), casters)
    # tan 40° = 0.84: the map covers 1.68 to each side of the floor's middle.
    np.testing.assert_array_equal(visibility(shadow, [[0, 0, 0], [1.6, 0, 0], [1.8, 0, 0]], UP), [0, 0, 1])
    np.testing.assert_array_equal(visibility(shadow, [[0, 3, 0]], (0, -1, 0)), 1)
    near = _shadow(launcher, _spot((0, 2, 0), shadow_far=1.5), casters)
    np.testing.assert_array_equal(visibility(near, [[0, 0, 0]], UP), 1)


def test_own_bias_replaces_auto(launcher, cast, visibility):
    """`shadow_bias` is a constant; `shadow_slope_bias` is max(slope (1 − n·l), bias)."""
    casters = cast((Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2)), (0, 1, 0)), (FLOOR, (0, 0, 0)))
    below, slanted = [[0.01, 0, 0.01]], [[0.6, 0, 0.01]]  # 1 and 1.02 behind the sheet, 1 − n·l = 0 and 0.019
    for fields, at, lit in [
        ({"shadow_bias": 0.9}, below, 0.0),
        ({"shadow_bias": 1.1}, below, 1.0),
        ({"shadow_slope_bias": 100.0}, below, 0.0),
        ({"shadow_slope_bias": 100.0}, slanted, 1.0),
        ({"shadow_slope_bias": 1.0, "shadow_bias": 0.1}, slanted, 0.0),
    ]:
        assert visibility(_shadow(launcher, _spot((0, 3, 0), **fields), casters), at, UP) == lit


def test_depth_is_linear_distance(launcher, cast):
    """Depths are |hit − light| / far along rays through texel centres, 1 for a miss; the picture in 8 bits."""
    shadow = _shadow(launcher, _spot((0, 3, 0), shadow_map_size=32), cast((Mesh.box(1.0), (0, 1, 0))))
    depth = shadow.map.depth.numpy()[0]
    st = ((np.arange(32) + 0.5) / 16 - 1) * np.tan(np.radians(40))
    s, t = np.meshgrid(st, st)
    top = np.maximum(np.abs(s), np.abs(t)) < 0.5 / 1.5  # the box's top is 1.5 below the light
    expected = 1.5 * np.sqrt(1 + s**2 + t**2) / shadow.map.far
    np.testing.assert_allclose(depth[top], expected[top], rtol=1e-6)
    np.testing.assert_array_equal(depth[np.maximum(np.abs(s), np.abs(t)) > 0.35], 1.0)
    np.testing.assert_allclose(shadow.depth_picture(), 255 * depth, atol=0.5)


def test_agrees_with_the_cube(launcher, cast, visibility, sample_surface):
    """Inside the cone a fine map and a fine cube map of the same light differ along edges only."""
    casters = cast((Mesh.box(0.7), (0.2, 0.8, 0.1)), (FLOOR, (0, 0, 0)))
    light = _spot((0.3, 3, -0.2), (0.1, -1, 0.05), shadow_map_size=1024)
    cube = CubeShadow(launcher, light, casters, BOUNDS)
    cube.update(1.0)
    points = np.random.default_rng(0).uniform((-1.2, 0, -1.2), (1.2, 0, 1.2), (20_000, 3))
    found, expected = (visibility(shadow, points, UP) for shadow in (_shadow(launcher, light, casters), cube))
    assert 0.05 < np.mean(expected == 0.0) < 0.95
    assert np.mean(found != expected) < 2e-3
