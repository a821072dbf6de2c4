"""Shadow rays: the known disk, no self-shadow at any angle, and where they end."""

import numpy as np
import pytest

from warp_smoke.geometry import Mesh
from warp_smoke.launch import Launcher
from warp_smoke.scene import PointLight
from warp_smoke.shadow.ray_traced import RayTracedShadow

BOUNDS = [[-4, -4, -4], [4, 4, 4]]
UP = (0, 1, 0)
FLOOR = Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8))


def _shadow(launcher, light, casters, bounds=BOUNDS):
    shadow = RayTracedShadow(launcher, light, casters, bounds)
    shadow.update(1.0)
    return shadow


def test_sphere_above_plane(launcher, cast, point_light, visibility):
    """The shadow is the disk of radius H R / √(d² − R²), but for the facets of the sphere."""
    height, radius, above = 3.0, 0.5, 2.0
    casters = cast((Mesh.sphere(radius, segments=256), (0, height - above, 0)), (FLOOR, (0, 0, 0)))
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 2, 100_000), np.zeros(100_000), rng.uniform(-2, 2, 100_000)])
    distance = np.hypot(points[:, 0], points[:, 2])
    edge = height * radius / np.sqrt(above**2 - radius**2)
    lit = visibility(_shadow(launcher, point_light((0, height, 0)), casters), points, UP)
    mistaken = (lit == 1.0) != (distance > edge)
    sag = edge * (1 - np.cos(np.pi / 256) ** 2)  # of chords along both of the sphere's directions
    assert np.abs(distance - edge)[mistaken].max(initial=0.0) < 1.1 * sag


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_no_self_shadow(launcher, visibility, sample_surface, cast, point_light, distant_light, scale):
    """No lit point of a plane or a convex mesh is in shadow, at any angle and size, near or far light."""
    rng = np.random.default_rng(1)
    meshes = [
        Mesh(np.asarray(mesh.points) * np.float32(scale), mesh.triangles)
        for mesh in (FLOOR, Mesh.sphere(segments=24), Mesh.box())
    ]
    lights = [point_light(scale * np.array([0.7, 2.5, -0.4])), point_light(scale * np.array([900.0, 40, -300]))]
    lights += [distant_light((1, -0.02, 0.3)), distant_light((0, -1, 0))]
    for mesh in meshes:
        casters = cast((mesh, (0, 0, 0)))
        points, normals = sample_surface(mesh, (0, 0, 0), 20_000, rng)
        for light in lights:
            if isinstance(light, PointLight):
                towards = light.position_at(1.0) - points
            else:
                towards = np.broadcast_to(-light.direction_at(1.0), points.shape)
            cosine = np.sum(towards * normals, axis=1) / np.linalg.norm(towards, axis=1)
            clear = np.abs(cosine) > 1e-5
            shadow = _shadow(launcher, light, casters, scale * np.array(BOUNDS))
            np.testing.assert_array_equal(visibility(shadow, points[clear], normals[clear]), cosine[clear] > 0)


def test_near_and_far(launcher, cast, point_light, visibility):
    """What is nearer to the light than `shadow_near` casts no shadow, and points beyond `shadow_far` are lit."""
    casters = cast((Mesh.box(1.0), (0, 2, 0)), (FLOOR, (0, 0, 0)))
    points = [[0.01, 0, 0.02]]
    expected = {(None, None): 0.0, (0.6, None): 0.0, (2.6, None): 1.0, (None, 3.9): 1.0, (None, 4.1): 0.0}
    for (near, far), lit in expected.items():
        light = point_light((0, 4, 0), shadow_near=near, shadow_far=far)
        assert visibility(_shadow(launcher, light, casters), points, UP) == lit


@pytest.mark.parametrize(
    ("position", "expected"),
    [((0, 2, 0), 1.0), ((-0.5, 2, 0.5), 1.0), ((0, 2.5, 0), 0.0)],
    ids=["on a surface", "on a vertex", "inside a closed mesh"],
)
def test_light_on_or_in_a_mesh(launcher, cast, point_light, visibility, position, expected):
    """A surface that the light lies on casts no shadow; a closed mesh around the light shadows all outside it."""
    casters = cast((Mesh.box(1.0), (0, 2.5, 0)), (FLOOR, (0, 0, 0)))
    shadow = _shadow(launcher, point_light(position), casters)
    lit = visibility(shadow, [[0.3, 0, 0.2], [-2.0, 0, 1.0], position], UP)
    np.testing.assert_array_equal(lit[:2], expected)
    assert lit[2] in (0.0, 1.0)


def test_distant_light_is_blocked_from_any_distance(launcher, cast, distant_light, visibility):
    """A roof casts its shadow along the light, however high or small it is; no casters, no shadow."""
    roof = Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2))
    points = [[0, 0, 0], [2.5, 0, 0], [4, 0, 0]]
    for height in (0.01, 1.0, 1e3):
        direction = np.array([2.5, -height, 0.0])  # from the roof's middle to x = 2.5
        for scale in (1e-3, 1.0):
            small = Mesh(np.asarray(roof.points) * np.float32(scale), roof.triangles)
            casters = cast((small, (0, scale * height, 0)))
            shadow = _shadow(launcher, distant_light(direction), casters, scale * np.array(BOUNDS))
            np.testing.assert_array_equal(visibility(shadow, scale * np.array(points), UP), [1, 0, 1])
    np.testing.assert_array_equal(visibility(_shadow(launcher, distant_light((0, -1, 0)), cast()), points, UP), 1)


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads(cast, point_light, visibility, sample_surface, bunny):
    """1, 2 and 7 threads give the same answer for every point."""
    points, normals = sample_surface(bunny, (0, 0, 0), 5000, np.random.default_rng(0))
    results = [
        visibility(_shadow(Launcher("cpu", n), point_light((1, 2, 1)), cast((bunny, (0, 0, 0)))), points, normals)
        for n in (1, 2, 7)
    ]
    np.testing.assert_array_equal(results[1], results[0])
    np.testing.assert_array_equal(results[2], results[0])
    assert 0.1 < results[0].mean() < 0.9


@pytest.mark.parametrize("name", ["exact", "area"])
def test_rays_from_anywhere(launcher, cast, point_light, distant_light, visibility, sample_surface, name):
    """Without bounds every point is traced, to the bits that points within bounds have, where few of them are."""
    ball = Mesh.sphere(0.4, segments=24)
    casters = cast((ball, (0, 1, 0)), (FLOOR, (0, 0, 0)))
    points, normals = sample_surface(FLOOR, (0, 0, 0), 500, np.random.default_rng(2))
    for light in (
        point_light((0.5, 3, 0), radius=0.2, shadow_filter=name),
        distant_light((1, -2, 0.5), angle=5.0, shadow_filter=name),
    ):
        anywhere, within = (_shadow(launcher, light, casters, bounds) for bounds in (None, BOUNDS))
        expected = visibility(within, points, normals)
        assert 0.5 < expected.mean() < 1.0
        np.testing.assert_array_equal(visibility(anywhere, points, normals), expected)


@pytest.mark.parametrize("depth", [0.3, 30.0, 3e5])
def test_a_distant_lights_rays_from_anywhere_have_no_end(launcher, cast, distant_light, visibility, depth):
    """However far below a small plate, a point such as a cell of smoke is in its shadow; beside it, it is lit."""
    plate = cast((Mesh.grid((-0.1, 0, 0.1), (0.2, 0, 0), (0, 0, -0.2)), (0, 0, 0)))
    shadow = _shadow(launcher, distant_light((0, -1, 0)), plate, None)
    points = np.array([[0.01, -depth, 0.02], [0.21, -depth, 0.02]])
    np.testing.assert_array_equal(visibility(shadow, points, UP), [0.0, 1.0])
