"""The depth cube map: OpenGL's layout, known shadows, no acne, no seams, and what it does at the extremes."""

import numpy as np
import pytest

from warp_smoke.geometry import Mesh
from warp_smoke.launch import Launcher
from warp_smoke.record import Samples
from warp_smoke.scene import SpotLight, Surface
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.cube import CubeShadow
from warp_smoke.shadow.ray_traced import RayTracedShadow

BOUNDS = [[-4, -4, -4], [4, 4, 4]]
UP = (0, 1, 0)
FLOOR = Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8))


def _shadow(launcher, light, casters, bounds=BOUNDS):
    shadow = CubeShadow(launcher, light, casters, bounds)
    shadow.update(1.0)
    return shadow


def _opengl_texel(r, size):
    """Face, row and column of a direction by the table in the OpenGL specification (cube map texture selection)."""
    x, y, z = r
    table = [(x, -z, -y), (-x, z, -y), (y, x, z), (-y, x, -z), (z, x, -y), (-z, -x, -y)]
    face = int(np.argmax([major for major, _, _ in table]))
    major, s, t = table[face]
    return face, int(size * (t / major + 1) / 2), int(size * (s / major + 1) / 2)


def test_faces_follow_opengl(launcher, cast, point_light):
    """A small box in any direction shows up at the texel that OpenGL's table names."""
    rng = np.random.default_rng(0)
    size = 64
    for r in [*np.eye(3), *-np.eye(3), *rng.standard_normal((20, 3))]:
        casters = cast((Mesh.box(0.3), 3 * r / np.linalg.norm(r)))
        shadow = _shadow(launcher, point_light((0, 0, 0), shadow_map_size=size), casters)
        face, row, column = _opengl_texel(r + 1e-9, size)
        assert shadow.map.depth.numpy()[face, row, column] < 1.0


def test_depth_is_linear_distance(launcher, cast, point_light):
    """In a box-shaped room every texel holds |hit − light| / far, and a miss is 1."""
    size, light, half = 32, np.array([0.3, -0.2, 0.5]), 2.0
    shadow = _shadow(launcher, point_light(light, shadow_map_size=size), cast((Mesh.box(2 * half), (0, 0, 0))))
    a = (np.arange(size) + 0.5) / size * 2 - 1
    t, s = np.meshgrid(a, a, indexing="ij")
    one = np.ones_like(s)
    directions = np.array(
        [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    )  # [face, xyz, row, column]
    distance = np.min((half * np.sign(directions) - light[:, None, None]) / directions, axis=1)
    expected = distance * np.linalg.norm(directions, axis=1)
    far = shadow.map.far
    np.testing.assert_allclose(shadow.map.depth.numpy() * far, expected, rtol=3e-6)
    empty = _shadow(launcher, point_light(light, shadow_map_size=size), cast())
    np.testing.assert_array_equal(empty.map.depth.numpy(), 1.0)


def test_sphere_above_plane(launcher, cast, point_light, visibility):
    """The shadow is the disk of radius H R / √(d² − R²); the area wrongly classified falls like 1/N."""
    height, radius, above = 3.0, 0.5, 2.0
    casters = cast((Mesh.sphere(radius, segments=256), (0, height - above, 0)), (FLOOR, (0, 0, 0)))
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 2, 200_000), np.zeros(200_000), rng.uniform(-2, 2, 200_000)])
    distance = np.hypot(points[:, 0], points[:, 2])
    edge = height * radius / np.sqrt(above**2 - radius**2)
    wrong = []
    for size in (64, 128, 256, 512):
        lit = visibility(_shadow(launcher, point_light((0, height, 0), shadow_map_size=size), casters), points, UP)
        mistaken = (lit == 1.0) != (distance > edge)
        wrong.append(16.0 * mistaken.mean())
        # Only along the edge: within a texel's diagonal (the floor's texels are 2 H / N wide) and the bias behind it.
        assert np.abs(distance - edge)[mistaken].max() < 2.0 * 2 * height / size
    order = -np.polyfit(np.log([64, 128, 256, 512]), np.log(wrong), 1)[0]
    assert 0.8 < order < 1.3
    assert wrong[-1] < 0.02  # of a disk of 2.15


@pytest.mark.parametrize("size", [33, 256, 1024])
def test_no_acne_on_flat_and_convex_surfaces(launcher, cast, point_light, visibility, sample_surface, size):
    """With `auto` bias no lit point of a plane or a convex mesh is in shadow, at any angle; without it many are."""
    rng = np.random.default_rng(1)
    light = np.array([0.7, 2.5, -0.4])
    for mesh, position in ((FLOOR, (0, 0, 0)), (Mesh.sphere(segments=24), (0, 0.5, 0)), (Mesh.box(), (3, 0, 1))):
        casters = cast((mesh, position))
        points, normals = sample_surface(mesh, position, 20_000, rng)
        facing = np.sum((light - points) * normals, axis=1) > 0
        lit = visibility(_shadow(launcher, point_light(light, shadow_map_size=size), casters), points, normals)
        np.testing.assert_array_equal(lit, facing)
        bare = point_light(light, shadow_map_size=size, shadow_bias=0.0)
        lit = visibility(_shadow(launcher, bare, casters), points[facing], normals[facing])
        assert lit.mean() < 0.9


# Measured 0.0052, 0.0032 and 0.0017 in shadow, and 0.0111, 0.0079 and 0.0036 that differ.
@pytest.mark.parametrize(
    ("size", "acne", "differing"), [(256, 0.008, 0.015), (512, 0.005, 0.01), (2048, 0.0025, 0.005)]
)
def test_little_acne_on_the_bunny(
    launcher, cast, point_light, visibility, sample_surface, bunny, size, acne, differing
):
    """On a rough mesh few lit points are in shadow, where a texel straddles a concave edge, and fewer in finer maps."""
    casters = cast((bunny, (0, 0, 0)))
    light = point_light((1.5, 3, 1.2), shadow_map_size=size)
    points, normals = sample_surface(bunny, (0, 0, 0), 50_000, np.random.default_rng(2))
    rays = RayTracedShadow(launcher, light, casters, BOUNDS)
    rays.update(1.0)
    exact = visibility(rays, points, normals)
    lit = visibility(_shadow(launcher, light, casters), points, normals)
    assert np.mean(lit[exact == 1.0] == 0.0) < acne
    assert np.mean(lit != exact) < differing  # most of it along grazing edges


def test_shadow_of_a_thin_wall_stays_attached(launcher, cast, point_light, visibility):
    """Behind a wall without thickness light leaks no further than one texel and a half, as they lie on the floor."""
    size, light = 256, np.array([2.0, 1.5, 0.0])
    wall = Mesh.grid((0, 0, -2), (0, 0, 4), (0, 1, 0))
    casters = cast((FLOOR, (0, 0, 0)), (wall, (0, 0, 0)))
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.3, 0, 50_000), np.zeros(50_000), rng.uniform(-0.2, 0.2, 50_000)])
    lit = visibility(_shadow(launcher, point_light(light, shadow_map_size=size), casters), points, UP)
    distance = np.linalg.norm(light)
    footprint = (2 * distance / size) / (light[1] / distance)  # a texel's width across the ray, laid on the floor
    assert np.all(lit[points[:, 0] < -1.5 * footprint] == 0.0)


def test_room_matches_rays_also_at_seams(launcher, cast, point_light, visibility, sample_surface, record_property):
    """Inside a furnished room the map differs from exact rays along edges only, at face edges no more than inside."""
    cubes = [(Mesh.box(1.0), (-2, -3.5, 1)), (Mesh.box(1.2), (1.5, -3.4, -2)), (Mesh.box(0.8), (0, 1, 2.5))]
    room = Mesh.box(8.0)
    inward = Mesh(room.points, room.triangles[:, ::-1])
    casters = cast((inward, (0, 0, 0)), *cubes)
    light = point_light((0.4, 2.2, -0.3), shadow_map_size=512)
    points, normals = sample_surface(inward, (0, 0, 0), 150_000, np.random.default_rng(0))
    rays = RayTracedShadow(launcher, light, casters, BOUNDS)
    rays.update(1.0)
    wrong = visibility(rays, points, normals) != visibility(_shadow(launcher, light, casters), points, normals)
    assert wrong.mean() < 0.004  # the cubes' shadow edges; 0.0019 measured
    r = np.sort(np.abs(points - light.position_at(1.0)), axis=1)
    near_seam = r[:, 1] / r[:, 2] > 0.95
    record_property("share of points that differ near seams", float(wrong[near_seam].mean()))
    assert wrong[near_seam].mean() <= wrong[~near_seam].mean() + 0.002


def test_step_across_a_seam(launcher, cast, point_light, record_property):
    """A smooth surface's stored depth steps no more across face edges than it does inside a face, and meets corners."""
    size = 64
    shadow = _shadow(launcher, point_light((0.1, 0.2, -0.1), shadow_map_size=size), cast((Mesh.sphere(2.0), (0, 0, 0))))
    depth = shadow.map.depth.numpy()
    inside = max(np.abs(np.diff(depth, axis=axis)).max() for axis in (1, 2))
    px, nx, py, ny, pz, nz = depth
    seams = [
        (pz[:, -1], px[:, 0]), (px[:, -1], nz[:, 0]), (nz[:, -1], nx[:, 0]), (nx[:, -1], pz[:, 0]),
        (py[-1], pz[0]), (pz[-1], ny[0]), (py[0], nz[0, ::-1]), (ny[-1], nz[-1, ::-1]),
        (py[:, -1], px[0, ::-1]), (py[:, 0], nx[0]), (ny[:, -1], px[-1]), (ny[:, 0], nx[-1, ::-1]),
    ]  # fmt: skip
    across = max(np.abs(a - b).max() for a, b in seams)
    record_property("step across a seam, of the largest inside a face", float(across / inside))
    assert across <= inside


def test_near_and_far(launcher, cast, point_light, visibility):
    """What is nearer than `shadow_near` casts no shadow, and points beyond `shadow_far` are lit."""
    casters = cast((Mesh.box(1.0), (0, 2, 0)), (FLOOR, (0, 0, 0)))
    points = [[0.01, 0, 0.02]]
    expected = {(None, None): 0.0, (0.6, None): 0.0, (2.6, None): 1.0, (None, 3.9): 1.0, (None, 4.1): 0.0}
    for (near, far), lit in expected.items():
        light = point_light((0, 4, 0), shadow_near=near, shadow_far=far)
        assert visibility(_shadow(launcher, light, casters), points, UP) == lit


def test_own_bias_replaces_auto(launcher, cast, point_light, visibility):
    """`shadow_bias` is a constant; `shadow_slope_bias` is max(slope (1 − n·l), bias)."""
    casters = cast((Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2)), (0, 1, 0)), (FLOOR, (0, 0, 0)))
    points = [[0.01, 0, 0.01]]  # one unit under the sheet, lit from straight above
    slanted = [[0.6, 0, 0.01]]  # cos θ = 0.981, 1.02 behind the sheet
    for fields, at, lit in [
        ({"shadow_bias": 0.9}, points, 0.0),
        ({"shadow_bias": 1.1}, points, 1.0),
        ({"shadow_slope_bias": 100.0}, points, 0.0),
        ({"shadow_slope_bias": 100.0}, slanted, 1.0),
        ({"shadow_slope_bias": 1.0, "shadow_bias": 1.1}, points, 1.0),
        ({"shadow_slope_bias": 1.0, "shadow_bias": 0.1}, slanted, 0.0),
    ]:
        assert visibility(_shadow(launcher, point_light((0, 3, 0), **fields), casters), at, UP) == lit


def test_spot_light_traces_the_faces_it_needs(launcher, cast, visibility, sample_surface):
    """A spot light's map agrees with the whole cube inside its cone, and leaves out faces the cone cannot touch."""
    casters = cast((Mesh.box(1.0), (0.2, 0, -2)), (Mesh.box(8.0), (0, 0, 0)))
    points, normals = sample_surface(Mesh.box(8.0), (0, 0, 0), 20_000, np.random.default_rng(0))
    normals = -normals
    spot = SpotLight(path="/light", cone_angle=30.0, shadow_filter="hard")
    narrow = _shadow(launcher, spot, casters)
    whole = _shadow(launcher, SpotLight(path="/light", cone_angle=180.0, shadow_filter="hard"), casters)
    traced = [bool(np.any(face < 1.0)) for face in narrow.map.depth.numpy()]
    assert traced == [False, False, False, False, False, True]  # −Z alone: its edge is 45° from the axis
    inside = -points[:, 2] > np.cos(np.radians(30)) * np.linalg.norm(points, axis=1)
    np.testing.assert_array_equal(
        visibility(narrow, points[inside], normals[inside]), visibility(whole, points[inside], normals[inside])
    )


@pytest.mark.parametrize(
    ("position", "expected"),
    [((0, 2, 0), 1.0), ((-0.5, 2, 0.5), 1.0), ((0, 2.5, 0), 0.0), ((0, 0, 0), 1.0)],
    ids=["on a surface", "on a vertex", "inside a closed mesh", "in the floor"],
)
def test_light_on_or_in_a_mesh(launcher, cast, point_light, visibility, position, expected):
    """A surface that the light lies on casts no shadow; a closed mesh around the light shadows all outside it."""
    casters = cast((Mesh.box(1.0), (0, 2.5, 0)), (FLOOR, (0, 0, 0)))
    light = point_light(position, shadow_map_size=64)
    points = [[0.3, -1.0, 0.2], [-2.0, -1.0, 1.0]] if position[1] == 0 else [[0.3, 0, 0.2], [-2.0, 0, 1.0]]
    shadow = _shadow(launcher, light, casters)
    assert np.all(np.isfinite(shadow.map.depth.numpy()))
    np.testing.assert_array_equal(visibility(shadow, points, UP if position[1] else (0, 1, 0)), expected)
    at_light = visibility(shadow, [position], UP)
    assert at_light[0] in (0.0, 1.0)


def test_points_that_face_away_are_dark(launcher, cast, point_light, visibility):
    """The back of a surface is in its own shadow, also where nothing else is."""
    shadow = _shadow(launcher, point_light((0, 3, 0)), cast())
    np.testing.assert_array_equal(visibility(shadow, [[0, 0, 0]] * 3, [[0, 1, 0], [0, -1, 0], [1, 0, 0]]), [1, 0, 0])


def test_far_from_the_origin_nothing_changes(launcher, placed, point_light, visibility):
    """A million units away, and with a far light, shadows are where they are at the origin."""
    points = np.random.default_rng(0).uniform((-2, 0, -2), (2, 0, 2), (5000, 3))
    results = []
    for shift in (np.zeros(3), np.array([1e6, -1e6, 1e6])):
        surfaces = [
            Surface(path="/s", mesh=Mesh.sphere(0.5), transform=placed(np.add(shift, (0, 1, 0)))),
            Surface(path="/floor", mesh=FLOOR, transform=placed(shift)),
        ]
        casters = Casters(launcher, surfaces, shift)
        casters.update(1.0)
        results.append(visibility(_shadow(launcher, point_light(np.add(shift, (0, 3, 0))), casters), points, UP))
    # Coordinates that differ by one rounding may move a texel's edge across a point.
    assert np.mean(results[0] != results[1]) < 1e-3


def test_follows_light_and_casters(launcher, placed, visibility, point_light):
    """The map is traced again when the light or the casters move, and only then."""
    launcher = Launcher(launcher.device.alias, 1)
    ball = Samples([1, 2], [placed((0, 1, 0)), placed((2, 1, 0))])
    surfaces = (Surface(path="/ball", mesh=Mesh.sphere(0.4), transform=ball),)
    casters = Casters(launcher, surfaces, np.zeros(3))
    moving = point_light((0, 3, 0))
    object.__setattr__(moving, "transform", Samples([2, 3], [placed((0, 3, 0)), placed((2, 3, 0))]))
    shadow = CubeShadow(launcher, moving, casters, BOUNDS)
    lit = {}
    for time in (1.0, 1.0, 2.0, 3.0):
        casters.update(time)
        shadow.update(time)
        lit[time] = visibility(shadow, [[0, 0, 0], [2, 0, 0]], UP).tolist()
    assert lit == {1.0: [0.0, 1.0], 2.0: [1.0, 1.0], 3.0: [1.0, 0.0]}
    assert launcher.launches["_trace_tiles"] == 3


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads(cast, point_light, bunny):
    """1, 2 and 7 threads trace bit-equal maps; a size that is no multiple of the tiles is covered whole."""
    maps = []
    for threads in (1, 2, 7):
        shadow = _shadow(Launcher("cpu", threads), point_light((1, 2, 1), shadow_map_size=67), cast((bunny, (0, 0, 0))))
        maps.append(shadow.map.depth.numpy().copy())
    np.testing.assert_array_equal(maps[1], maps[0])
    np.testing.assert_array_equal(maps[2], maps[0])
    assert maps[0].min() > 0.0


def test_depth_picture_is_a_cross(launcher, cast, point_light):
    """Each face is where a cross puts it, grey by depth; the corners stay black."""
    size = 16
    behind = [[-6, -6, -6], [6, 6, 6]]  # receivers, so that every wall casts
    casters = cast((Mesh.box(8.0), (1, 0.5, 0.25)))
    shadow = _shadow(launcher, point_light((0, 0, 0), shadow_map_size=size), casters, behind)
    picture = shadow.depth_picture()
    assert picture.shape == (3 * size, 4 * size)
    assert picture.dtype == np.uint8
    middle = {
        face: picture[row * size + size // 2, column * size + size // 2]
        for face, row, column in [("+x", 1, 2), ("-x", 1, 0), ("+y", 0, 1), ("-y", 2, 1), ("+z", 1, 1), ("-z", 1, 3)]
    }
    walls = {"+x": 5, "-x": 3, "+y": 4.5, "-y": 3.5, "+z": 4.25, "-z": 3.75}
    for face, distance in walls.items():
        # The middle four texels' rays are 1/16 off the axis on both sides.
        assert middle[face] == pytest.approx(255 * distance * np.sqrt(1 + 2 / 16**2) / shadow.map.far, abs=0.51)
    assert not picture[:size, :size].any()
