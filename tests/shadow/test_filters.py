"""Filters of depth maps: their patterns, soft edges where they belong, no seams, and agreement with area lights."""

import numpy as np
import pytest
from scenes import shining

from warp_smoke.geometry import Mesh
from warp_smoke.launch import Launcher
from warp_smoke.record import Samples
from warp_smoke.scene import SHADOW_FILTERS, Camera, PointLight, SpotLight, Surface
from warp_smoke.shadow import filters
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.cube import CubeShadow
from warp_smoke.shadow.directional import DirectionalShadow
from warp_smoke.shadow.ray_traced import RayTracedShadow
from warp_smoke.shadow.spot import SpotShadow
from warp_smoke.study.light_answers import edge_penumbra

UP = (0, 1, 0)
FLOOR = Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8))
ON_FLOOR = [[-4, 0, -4], [4, 0, 4]]
MAPPED = [name for name in SHADOW_FILTERS if name not in ("exact", "area")]
CAMERA = Camera(path="/camera")


def _shadow(launcher, light, casters, bounds=ON_FLOOR):
    if light.shadow_filter in ("exact", "area"):
        kind = RayTracedShadow
    elif isinstance(light, SpotLight):
        kind = SpotShadow
    else:
        kind = CubeShadow if isinstance(light, PointLight) else DirectionalShadow
    shadow = kind(launcher, light, casters, bounds, CAMERA)
    shadow.update(1.0)
    return shadow


def _spot(position, **fields):
    matrix = shining((0, -1, 0))
    matrix[3, :3] = position
    return SpotLight(path="/light", transform=matrix, cone_angle=50.0, **fields)


def test_patterns():
    """64, 9 and 20 offsets as in the sources, around 0; the spiral's points share the disk evenly."""
    grid, plane, disk = filters.grid_of_cube(), filters.grid_of_plane(), filters.edges_and_corners()
    assert (len(grid), len(plane), len(disk)) == (64, 9, 20)
    for offsets in (grid, plane, disk):
        np.testing.assert_allclose(offsets.mean(axis=0), 0.0, atol=1e-15)
        assert np.abs(offsets).max() == 1.0
    radii = np.linalg.norm(filters.spiral(64), axis=1)
    np.testing.assert_allclose(radii**2, (np.arange(64) + 0.5) / 64)
    assert np.linalg.norm(filters.spiral(64).mean(axis=0)) < 0.02


@pytest.mark.parametrize("name", MAPPED)
@pytest.mark.parametrize("kind", ["point", "spot", "distant"])
def test_filters_only_soften_the_edge(launcher, cast, point_light, distant_light, visibility, name, kind):
    """Well inside and well outside the hard shadow a filter changes nothing; a plane alone is lit at every angle."""
    fields = {"shadow_filter": name, "shadow_map_size": 128}
    light = {
        "point": lambda: point_light((0.3, 3, 0.2), radius=0.05, **fields),
        "spot": lambda: _spot((0.3, 3, 0.2), radius=0.05, **fields),
        "distant": lambda: distant_light((0.2, -1, 0.1), **fields),
    }[kind]()
    casters = cast((Mesh.box(1.0), (0, 1, 0)), (FLOOR, (0, 0, 0)))
    points = np.random.default_rng(0).uniform((-2, 0, -2), (2, 0, 2), (20_000, 3))
    shadow = _shadow(launcher, light, casters)
    filtered = visibility(shadow, points, UP)
    assert np.all((filtered >= 0.0) & (filtered <= 1.0))
    rays = RayTracedShadow(launcher, light, casters, ON_FLOOR)
    rays.update(1.0)
    # The widest filter here, laid on the floor, and a texel's error.
    reach = 0.2
    ring = reach * np.array([[np.cos(a), 0, np.sin(a)] for a in np.linspace(0, 2 * np.pi, 16, endpoint=False)])
    around = np.stack([visibility(rays, points + o, UP) for o in [*ring, *0.5 * ring]])
    np.testing.assert_array_equal(filtered[around.min(axis=0) == 1.0], 1.0)
    np.testing.assert_array_equal(filtered[around.max(axis=0) == 0.0], 0.0)
    if name != "hard":
        assert np.any((filtered > 0.0) & (filtered < 1.0))
    else:
        assert set(np.unique(filtered)) == {0.0, 1.0}
    alone = visibility(_shadow(launcher, light, cast((FLOOR, (0, 0, 0)))), points, UP)
    np.testing.assert_array_equal(alone, 1.0)


@pytest.mark.parametrize("name", MAPPED)
def test_no_acne_on_planes_at_any_angle(launcher, cast, point_light, visibility, name):
    """A plane that also has receivers behind it, so that it is in the map, is lit all over with the `auto` bias."""
    casters = cast((FLOOR, (0, 0, 0)))
    points = np.random.default_rng(1).uniform((-4, 0, -4), (4, 0, 4), (20_000, 3))
    below = [[-4, -1, -4], [4, 1, 4]]
    for size in (64, 512):
        light = point_light((0.7, 0.5, -0.4), shadow_filter=name, shadow_map_size=size, radius=0.05)
        shadow = _shadow(launcher, light, casters, below)
        assert shadow.rays > 0
        np.testing.assert_array_equal(visibility(shadow, points, UP), 1.0)


@pytest.mark.parametrize("name", MAPPED)
def test_no_seam(launcher, cast, point_light, visibility, name):
    """Along a line over a face's edge, through a shadow's edge and beside it, no step is larger than inside a face.

    The shadow's edge is the same everywhere, so each step of visibility inside the faces has its like at the seam.
    """
    wall = Mesh.box((0.5, 0.02, 20.0))  # a bar along z: its shadow crosses the edges of −Y with −Z and +Z
    casters = cast((wall, (0.0, 1.0, 0.0)), (FLOOR, (0, 0, 0)))
    light = point_light((0, 2.0, 0), shadow_filter=name, shadow_map_size=128, radius=0.1)
    shadow = _shadow(launcher, light, casters)
    z = np.linspace(1.6, 2.4, 801)  # the seam is at z = 2, at 45° under the light
    steps = []
    for x in np.linspace(-1.2, 1.2, 49):
        points = np.stack([np.full_like(z, x), np.zeros_like(z), z], axis=1)
        steps.append(np.abs(np.diff(visibility(shadow, points, UP))))
    steps = np.array(steps)
    at_seam = np.abs(0.5 * (z[1:] + z[:-1]) - 2.0) < 0.002
    assert steps[:, at_seam].max() <= steps[:, ~at_seam].max()
    across = steps.mean(axis=0)  # a line through the shadow's edge at each z
    assert across[at_seam].max() <= across[~at_seam].max()


@pytest.mark.parametrize("kind", ["point", "spot", "distant"])
def test_penumbra_matches_area_light(launcher, cast, point_light, distant_light, visibility, kind):
    """`pcss` comes closer to the rays to all of the light than the hard shadow does, and its penumbra is as wide."""
    fields = {"shadow_map_size": 512}
    light = {
        "point": lambda **f: point_light((0, 3, 0), radius=0.3, **fields, **f),
        "spot": lambda **f: _spot((0, 3, 0), radius=0.3, **fields, **f),
        "distant": lambda **f: distant_light((0.2, -1, 0.1), angle=12.0, **fields, **f),
    }[kind]
    casters = cast((Mesh.box((1.0, 0.1, 1.0)), (0, 1, 0)), (FLOOR, (0, 0, 0)))
    points = np.random.default_rng(0).uniform((-2, 0, -2), (2, 0, 2), (20_000, 3))
    lit = {
        name: visibility(_shadow(launcher, light(shadow_filter=name), casters), points, UP)
        for name in ("area", "exact", "hard", "pcss")
    }
    error = {name: np.abs(values - lit["area"]).mean() for name, values in lit.items()}
    assert error["pcss"] < 0.5 * min(error["hard"], error["exact"])
    width = {name: np.mean((lit[name] > 0.02) & (lit[name] < 0.98)) for name in ("area", "pcss")}
    assert width["pcss"] == pytest.approx(width["area"], rel=0.25)


def test_area_light_over_an_edge(launcher, cast, point_light, visibility):
    """Behind a half plane the light's visible share is that of a disk cut by a line."""
    half = Mesh.grid((-50, 1.5, 50), (50, 0, 0), (0, 0, -100))  # covers x < 0, halfway up
    light = point_light((0, 3, 0), radius=0.2, shadow_filter="area")
    x = np.linspace(-0.3, 0.3, 61)
    points = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=1)
    lit = visibility(_shadow(launcher, light, cast((half, (0, 0, 0)))), points, UP)
    share = edge_penumbra(points, np.array([0.0, 3.0, 0.0]), 0.2, 1.5)
    np.testing.assert_allclose(lit, share, atol=0.04)  # of 64 rays two or three


def test_softness_is_a_length(launcher, cast, point_light, visibility):
    """`shadow_softness` widens the edge in stage units, whatever the map's size."""
    edge = Mesh.grid((-4, 1.0, 4), (4, 0, 0), (0, 0, -8))
    casters = cast((edge, (0, 0, 0)), (FLOOR, (0, 0, 0)))
    x = np.linspace(-1.0, 1.0, 2001)
    points = np.stack([x, np.zeros_like(x), np.full_like(x, 0.1)], axis=1)
    for size in (256, 1024):
        light = point_light((0, 2, 0), shadow_filter="pcf_grid", shadow_softness=0.2, shadow_map_size=size)
        lit = visibility(_shadow(launcher, light, casters), points, UP)
        soft = x[(lit > 0.0) & (lit < 1.0)]
        # Taps at ± 0.2 along x, and at ± 0.2 up and down, which the projection from 2 above moves by a tenth of x.
        assert soft.min() == pytest.approx(-0.2, abs=0.05)
        assert soft.max() == pytest.approx(0.2, abs=0.05)


def test_view_filter_widens_with_distance(launcher, cast, point_light, visibility, placed):
    """`pcf_disk_view` has radius (1 + view distance / far) times the softness."""
    edge = Mesh.grid((-4, 1.0, 4), (4, 0, 0), (0, 0, -8))
    casters = cast((edge, (0, 0, 0)), (FLOOR, (0, 0, 0)))
    x = np.linspace(-2.0, 2.0, 4001)
    points = np.stack([x, np.zeros_like(x), np.full_like(x, 0.1)], axis=1)
    light = point_light((0, 2, 0), shadow_filter="pcf_disk_view", shadow_softness=0.1, shadow_far=5.0)
    widths = []
    for distance in (0.0, 20.0):
        camera = Camera(path="/camera", transform=placed((0, distance, 0.1)))
        shadow = CubeShadow(launcher, light, casters, ON_FLOOR, camera)
        shadow.update(1.0)
        lit = visibility(shadow, points, UP)
        widths.append(np.ptp(x[(lit > 0.0) & (lit < 1.0)]))
    assert widths[1] / widths[0] == pytest.approx(5.0, rel=0.1)


def test_front_face_culling(launcher, cast, point_light, visibility, sample_surface):
    """Closed casters are free of acne without a bias, and a sphere's shadow stays where it was; mirrored ones too."""
    for mesh in (Mesh.sphere(0.7, segments=32), Mesh.box(1.0)):
        casters = cast((mesh, (0, 1.2, 0)), (FLOOR, (0, 0, 0)))
        light = point_light((0.3, 3, 0.2), shadow_bias=0.0, shadow_cull_front=True)
        points, normals = sample_surface(mesh, (0, 1.2, 0), 5000, np.random.default_rng(0))
        bounds = [[-4, 0, -4], [4, 2, 4]]
        facing = np.sum((light.position_at(1.0) - points) * normals, axis=1) > 0.05
        lit = visibility(_shadow(launcher, light, casters, bounds), points, normals)
        np.testing.assert_array_equal(lit[facing], 1.0)
        floor = np.random.default_rng(1).uniform((-2, 0, -2), (2, 0, 2), (10_000, 3))
        culled = visibility(_shadow(launcher, light, casters, bounds), floor, UP)
        rays = visibility(_shadow(launcher, point_light((0.3, 3, 0.2), shadow_filter="exact"), casters), floor, UP)
        assert np.mean(culled != rays) < 0.01
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirrored = Casters(launcher, [Surface(path="/s", mesh=Mesh.box(1.0), transform=flip)], np.zeros(3))
    mirrored.update(1.0)
    lit = visibility(_shadow(launcher, light, mirrored, bounds), [[0.2, 0.5, 0.1]], UP)
    np.testing.assert_array_equal(lit, 1.0)


def test_only_tiles_that_matter_are_traced(launcher, cast, point_light, distant_light, visibility):
    """A small box over a floor asks for a few tiles of the faces below it, in one launch; no caster for none at all."""
    launcher = Launcher(launcher.device.alias, 1)
    casters = cast((Mesh.box(0.5), (0.2, 0.5, 0.1)), (FLOOR, (0, 0, 0)))
    for light, texels in ((point_light((0, 3, 0)), 6 * 512**2), (distant_light((0, -1, 0.01)), 1024**2)):
        shadow = _shadow(launcher, light, casters)
        # A flat map is fitted to the casters; a cube's faces are not.
        assert 0 < shadow.rays <= (texels / 10 if isinstance(shadow, CubeShadow) else texels)
        traced = shadow.map.depth.numpy() < 1.0
        assert traced.any()
        if isinstance(shadow, CubeShadow):
            assert traced.any(axis=(1, 2)).tolist() == [False, False, False, True, False, False]
        empty = _shadow(launcher, light, cast((FLOOR, (0, 0, 0))))
        assert empty.rays == 0
    assert launcher.launches["_trace_tiles"] == 2


def test_what_was_traced_before_is_forgotten(launcher, placed, point_light, visibility):
    """Tiles that a caster leaves are empty again; while it moves the hierarchy is refitted, not made anew."""
    path = Samples([1, 2], [placed((-2, 0.5, 0)), placed((2, 0.5, 0))])
    casters = Casters(launcher, [Surface(path="/s", mesh=Mesh.box(0.5), transform=path)], np.zeros(3))
    light = point_light((0, 3, 0))
    casters.update(1.0)
    mesh = casters.mesh
    shadow = CubeShadow(launcher, light, casters, ON_FLOOR)
    lit = []
    for time in (1.0, 2.0):
        casters.update(time)
        shadow.update(time)
        lit.append(visibility(shadow, [[-2.2, 0, 0], [2.2, 0, 0]], UP).tolist())
    assert lit == [[0.0, 1.0], [1.0, 0.0]]
    assert casters.mesh is mesh


@pytest.mark.parametrize("name", SHADOW_FILTERS)
@pytest.mark.parametrize("position", [(0, 2, 0), (-0.5, 2, 0.5), (0, 2.5, 0)])
def test_light_on_or_in_a_mesh(launcher, cast, point_light, visibility, name, position):
    """With a light on a surface, on a vertex or inside a mesh, every answer is between 0 and 1."""
    casters = cast((Mesh.box(1.0), (0, 2.5, 0)), (FLOOR, (0, 0, 0)))
    light = point_light(position, shadow_filter=name, shadow_map_size=64, radius=0.1)
    points = np.random.default_rng(0).uniform((-4, 0, -4), (4, 0, 4), (500, 3))
    lit = visibility(_shadow(launcher, light, casters), [*points, position], UP)
    assert np.all((lit >= 0.0) & (lit <= 1.0))
