"""The directional map: known shadows, no acne, a fit that stays put, and the limit of a point light far away."""

import numpy as np
import pytest

from warp_smoke.geometry import Mesh
from warp_smoke.launch import Launcher
from warp_smoke.scene import Surface
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.cube import CubeShadow
from warp_smoke.shadow.directional import DirectionalShadow
from warp_smoke.shadow.ray_traced import RayTracedShadow

BOUNDS = [[-4, -1, -4], [4, 4, 4]]
UP = (0, 1, 0)
FLOOR = Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8))


def _shadow(launcher, light, casters, bounds=BOUNDS):
    shadow = DirectionalShadow(launcher, light, casters, bounds)
    shadow.update(1.0)
    return shadow


def test_sphere_above_plane(launcher, cast, distant_light, visibility):
    """Under slanted light the shadow is an ellipse R by R / cos θ; the area wrongly classified falls like 1/N."""
    radius, above = 0.6, 1.5
    casters = cast((Mesh.sphere(radius, segments=256), (0, above, 0)), (FLOOR, (0, 0, 0)))
    direction = np.array([0.5, -1.0, 0.25]) / np.linalg.norm([0.5, -1.0, 0.25])
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 2.5, 200_000), np.zeros(200_000), rng.uniform(-1.5, 2, 200_000)])
    offset = points - (0, above, 0)
    distance = np.linalg.norm(offset - (offset @ direction)[:, None] * direction, axis=1)
    wrong = []
    for size in (128, 256, 512, 1024):
        shadow = _shadow(launcher, distant_light(direction, shadow_map_size=size), casters)
        mistaken = (visibility(shadow, points, UP) == 1.0) != (distance > radius)
        wrong.append(mistaken.mean())
        assert np.abs(distance - radius)[mistaken].max() < 1.5 * shadow.map.texel
    order = -np.polyfit(np.log([128, 256, 512, 1024]), np.log(wrong), 1)[0]
    assert 0.8 < order < 1.3


@pytest.mark.parametrize("size", [33, 256, 2048])
@pytest.mark.parametrize("direction", [(0, -1, 0), (0.3, -1, 0.2), (1, -0.05, 0.3)])
def test_no_acne_on_flat_and_convex_surfaces(
    launcher, cast, distant_light, visibility, sample_surface, size, direction
):
    """With `auto` bias no lit point of a plane or a convex mesh is in shadow, at any angle."""
    rng = np.random.default_rng(1)
    for mesh, position in ((FLOOR, (0, 0, 0)), (Mesh.sphere(segments=24), (0, 0.5, 0)), (Mesh.box(), (2, 0, 1))):
        casters = cast((mesh, position))
        points, normals = sample_surface(mesh, position, 20_000, rng)
        light = distant_light(direction, shadow_map_size=size)
        facing = normals @ light.direction_at(1.0)
        clear = np.abs(facing) > 1e-6
        lit = visibility(_shadow(launcher, light, casters), points[clear], normals[clear])
        np.testing.assert_array_equal(lit, facing[clear] < 0)


# Measured 0.0041, 0.0016 and 0.0009 in shadow, and 0.0093, 0.0040 and 0.0024 that differ.
@pytest.mark.parametrize(
    ("size", "acne", "differing"), [(256, 0.006, 0.014), (1024, 0.0025, 0.006), (2048, 0.0015, 0.004)]
)
def test_little_acne_on_the_bunny(
    launcher, cast, distant_light, visibility, sample_surface, bunny, size, acne, differing
):
    """On a rough mesh few lit points are in shadow, where a texel straddles a concave edge, and fewer in finer maps."""
    casters = cast((bunny, (0, 0, 0)))
    light = distant_light((-1, -2, -0.8), shadow_map_size=size)
    points, normals = sample_surface(bunny, (0, 0, 0), 50_000, np.random.default_rng(2))
    rays = RayTracedShadow(launcher, light, casters, BOUNDS)
    rays.update(1.0)
    exact = visibility(rays, points, normals)
    lit = visibility(_shadow(launcher, light, casters), points, normals)
    assert np.mean(lit[exact == 1.0] == 0.0) < acne
    assert np.mean(lit != exact) < differing


def test_own_bias_replaces_auto(launcher, cast, distant_light, visibility):
    """`shadow_bias` is a constant; `shadow_slope_bias` is max(slope (1 − n·l), bias)."""
    casters = cast((Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2)), (0, 1, 0)), (FLOOR, (0, 0, 0)))
    straight, slanted = (0, -1, 0), (0.5, -1, 0)  # 1 and 1.118 behind the sheet, 1 − n·l = 0 and 0.106
    for fields, direction, lit in [
        ({"shadow_bias": 0.9}, straight, 0.0),
        ({"shadow_bias": 1.1}, straight, 1.0),
        ({"shadow_bias": 1.1}, slanted, 0.0),
        ({"shadow_slope_bias": 11.0}, straight, 0.0),
        ({"shadow_slope_bias": 11.0}, slanted, 1.0),
        ({"shadow_slope_bias": 1.0, "shadow_bias": 1.1}, straight, 1.0),
        ({"shadow_slope_bias": 1.0, "shadow_bias": 0.1}, slanted, 0.0),
    ]:
        shadow = _shadow(launcher, distant_light(direction, **fields), casters)
        assert visibility(shadow, [[0.01, 0, 0.01]], UP) == lit


def test_shadow_of_a_thin_wall_stays_attached(launcher, cast, distant_light, visibility):
    """Behind a wall without thickness light leaks no further than one texel and a half, as they lie on the floor."""
    wall = Mesh.grid((0, 0, -2), (0, 0, 4), (0, 1, 0))
    casters = cast((FLOOR, (0, 0, 0)), (wall, (0, 0, 0)))
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.3, 0, 50_000), np.zeros(50_000), rng.uniform(-0.2, 0.2, 50_000)])
    shadow = _shadow(launcher, distant_light((-2, -1.5, 0), shadow_map_size=256), casters)
    footprint = shadow.map.texel / 0.6  # 0.6 is the sine of the light's height
    assert np.all(visibility(shadow, points, UP)[points[:, 0] < -1.5 * footprint] == 0.0)


def test_beyond_the_map_is_lit(launcher, cast, distant_light, visibility):
    """Points beside the casters, before them, and all points where there are none, are lit."""
    light = distant_light((0, -1, 0))
    shadow = _shadow(launcher, light, cast((Mesh.box(1.0), (0, 2, 0))))
    points = [[0, 0, 0], [3, 0, 0], [0.0, 3, 0], [0, -1e6, 0]]
    # The last is deeper than any receiver that was announced, so no depth was stored for it.
    np.testing.assert_array_equal(visibility(shadow, points, UP), [0, 1, 1, 1])
    np.testing.assert_array_equal(visibility(_shadow(launcher, light, cast()), points[:3], UP), 1)


def test_texels_stay_while_things_move_a_little(launcher, cast, distant_light):
    """Texels have the same size and lie on the same grid when the casters shift by less than a texel's width."""
    light = distant_light((0.4, -1, 0.3), shadow_map_size=128)
    maps = [
        _shadow(launcher, light, cast((Mesh.sphere(1.0), (x, 1, 0)), (FLOOR, (0, 0, 0)))).map
        for x in (0.0, 0.001, 0.01, 0.1)
    ]
    for m in maps:
        assert m.texel == maps[0].texel
        for corner in (m.s, m.t):
            assert corner / m.texel == pytest.approx(round(corner / m.texel), abs=1e-4)


def test_matches_rays(launcher, cast, distant_light, visibility, sample_surface):
    """On a furnished floor the map differs from exact rays along shadow edges only."""
    casters = cast((Mesh.box(1.0), (-1, 0.5, 1)), (Mesh.sphere(0.7), (1, 1.5, -0.5)), (FLOOR, (0, 0, 0)))
    light = distant_light((0.6, -1, -0.4))
    points, normals = sample_surface(FLOOR, (0, 0, 0), 100_000, np.random.default_rng(0))
    rays = RayTracedShadow(launcher, light, casters, BOUNDS)
    rays.update(1.0)
    wrong = visibility(rays, points, normals) != visibility(_shadow(launcher, light, casters), points, normals)
    assert wrong.mean() < 0.003


def test_is_the_limit_of_a_far_point_light(launcher, cast, distant_light, point_light, visibility, sample_surface):
    """Shadows of a point light at distance D differ from the distant light's on an area that falls with 1/D."""
    casters = cast((Mesh.sphere(0.7), (0, 1.5, 0)), (FLOOR, (0, 0, 0)))
    points, normals = sample_surface(FLOOR, (0, 0, 0), 100_000, np.random.default_rng(0))
    direction = np.array([0.6, -1, -0.4]) / np.linalg.norm([0.6, -1, -0.4])
    rays = RayTracedShadow(launcher, distant_light(direction), casters, BOUNDS)
    rays.update(1.0)
    limit = visibility(rays, points, normals)
    differ = []
    for distance in (10.0, 100.0, 1000.0, 1e7):
        far = RayTracedShadow(launcher, point_light(-distance * direction), casters, BOUNDS)
        far.update(1.0)
        differ.append(np.mean(visibility(far, points, normals) != limit))
    assert differ[0] > 5 * differ[1] > 25 * differ[2]
    assert differ[3] < 1e-4
    # A cube map that far away still sees the casters: its rays begin at their bounds.
    cube = CubeShadow(launcher, point_light(-1e4 * direction, shadow_map_size=16384 // 8), casters, BOUNDS)
    cube.update(1.0)
    assert np.all(np.isfinite(cube.map.depth.numpy()))


def test_far_from_the_origin_nothing_changes(launcher, placed, distant_light, visibility):
    """A million units away shadows are where they are at the origin."""
    points = np.random.default_rng(0).uniform((-2, 0, -2), (2, 0, 2), (5000, 3))
    results = []
    for shift in (np.zeros(3), np.array([1e6, -1e6, 1e6])):
        surfaces = [
            Surface(path="/s", mesh=Mesh.sphere(0.5), transform=placed(np.add(shift, (0, 1, 0)))),
            Surface(path="/floor", mesh=FLOOR, transform=placed(shift)),
        ]
        casters = Casters(launcher, surfaces, shift)
        casters.update(1.0)
        results.append(visibility(_shadow(launcher, distant_light((0.3, -1, 0.1)), casters), points, UP))
    # Coordinates that differ by one rounding may move a texel's edge across a point.
    assert np.mean(results[0] != results[1]) < 1e-3


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads(cast, distant_light, bunny):
    """1, 2 and 7 threads trace bit-equal maps; a size that is no multiple of the tiles is covered whole."""
    maps = []
    for threads in (1, 2, 7):
        light = distant_light((1, -2, 1), shadow_map_size=131)
        shadow = _shadow(Launcher("cpu", threads), light, cast((bunny, (0, 0, 0))))
        maps.append(shadow.map.depth.numpy().copy())
    np.testing.assert_array_equal(maps[1], maps[0])
    np.testing.assert_array_equal(maps[2], maps[0])
    assert maps[0].min() > 0.0


def test_depth_picture(launcher, cast, distant_light):
    """The picture holds the stored depth in 8 bits, white where there is nothing."""
    shadow = _shadow(launcher, distant_light((0, -1, 0), shadow_map_size=64), cast((Mesh.sphere(1.0), (0, 2, 0))))
    picture = shadow.depth_picture()
    assert picture.dtype == np.uint8
    np.testing.assert_allclose(picture, 255 * shadow.map.depth.numpy()[0], atol=0.5)
    assert picture[0, 0] == 255
    assert picture[32, 32] < 5
