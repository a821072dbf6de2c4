"""The casters' hierarchy: equal to brute force, no leak through closed meshes, follows what moves."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

from warp_smoke.geometry import Mesh
from warp_smoke.launch import Launcher, Rows
from warp_smoke.record import Samples
from warp_smoke.scene import Surface
from warp_smoke.shadow.casters import Casters

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _cast_rays(
    rows: Rows,
    mesh: wp.uint64,
    starts: wp.array[wp.vec3],
    directions: wp.array[wp.vec3],
    t_out: wp.array[float],
    face_out: wp.array[int],
    any_out: wp.array[int],
):
    """t[n], face[n] = nearest hit (−1 = none); any[n] = 1 where there is one."""
    n = rows.first + wp.tid()
    hit = wp.mesh_query_ray(mesh, starts[n], directions[n], 1.0e30)
    t_out[n] = wp.where(hit.result, hit.t, -1.0)
    face_out[n] = wp.where(hit.result, hit.face, -1)
    any_out[n] = wp.where(wp.mesh_query_ray_anyhit(mesh, starts[n], directions[n], 1.0e30), 1, 0)


def _cast(launcher, casters, starts, directions):
    starts, directions = (
        launcher.array(np.asarray(a, np.float32), "test", dtype=wp.vec3) for a in (starts, directions)
    )
    t = launcher.zeros(len(starts), "test")
    face, any_hit = (launcher.zeros(len(starts), "test", dtype=int) for _ in range(2))
    launcher.launch_each(_cast_rays, len(starts), casters.mesh.id, starts, directions, t, face, any_hit)
    return t.numpy(), face.numpy(), any_hit.numpy()


def _casters(launcher, *meshes, origin=(0, 0, 0), transform=None):
    transform = np.eye(4) if transform is None else transform
    surfaces = [Surface(path=f"/s{n}", mesh=mesh, transform=transform) for n, mesh in enumerate(meshes)]
    casters = Casters(launcher, surfaces, origin)
    casters.update(1.0)
    return casters


def _brute_force(points, triangles, starts, directions):
    """Nearest hit of each ray with each triangle (Möller and Trumbore, 1997), and how clearly it is decided."""
    a, b, c = (points[triangles[:, corner]].astype(np.float64) for corner in range(3))
    starts, directions = (np.asarray(x, np.float64)[:, None] for x in (starts, directions))
    edge1, edge2 = b - a, c - a
    p = np.cross(directions, edge2)
    determinant = np.sum(edge1 * p, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / determinant
        offset = starts - a
        u = np.sum(offset * p, axis=-1) * inverse
        q = np.cross(offset, edge1)
        v = np.sum(directions * q, axis=-1) * inverse
        t = np.sum(edge2 * q, axis=-1) * inverse
    inside = np.minimum(np.minimum(u, v), np.minimum(1.0 - u - v, t))
    clear = np.all(np.abs(np.nan_to_num(inside, nan=1.0)) > 1e-5, axis=1)
    t = np.where(inside > 0.0, t, np.inf)
    return t.min(axis=1), t.argmin(axis=1), clear


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 40))
def test_equals_brute_force(launcher, seed, count):
    """Nearest hit, its triangle and any-hit agree with every triangle tested in float64."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (3 * count, 3)).astype(np.float32)
    triangles = np.arange(3 * count).reshape(-1, 3)
    starts = rng.uniform(-2, 2, (64, 3)).astype(np.float32)
    directions = (rng.uniform(-1, 1, (64, 3)) - starts).astype(np.float32)
    t, face, any_hit = _cast(launcher, _casters(launcher, Mesh(points, triangles)), starts, directions)
    expected, nearest, clear = _brute_force(points, triangles, starts, directions)
    # Rays within 1e-5 of a triangle's edge may go either way.
    hit = np.isfinite(expected) & clear
    miss = ~np.isfinite(expected) & clear
    np.testing.assert_array_equal(any_hit[hit], 1)
    np.testing.assert_array_equal(any_hit[miss], 0)
    np.testing.assert_array_equal(t[miss], -1.0)
    np.testing.assert_allclose(t[hit], expected[hit], rtol=1e-4, atol=1e-5)  # float32 at grazing angles
    second = np.abs(t[hit] - expected[hit]) < 1e-6
    np.testing.assert_array_equal(face[hit][second], nearest[hit][second])


@pytest.mark.parametrize("distance", [0.0, 100.0])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("shape", ["box", "sphere", "cone"])
def test_closed_mesh_never_leaks(launcher, shape, turned, distance, record_property):
    """Rays from inside through vertices and points on edges all hit: boxes one rounding too tight lose 1 in 100."""
    rng = np.random.default_rng(3)
    mesh = getattr(Mesh, shape)()
    transform = np.eye(4)
    if turned:
        transform[:3, :3] = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    transform[3, :3] = distance
    casters = _casters(launcher, mesh, transform=transform)
    corners = casters.mesh.points.numpy().reshape(-1, 3, 3).astype(np.float64)
    count = 40_000
    triangle, corner = rng.integers(len(corners), size=count), rng.integers(3, size=count)
    along = np.where(rng.random(count) < 0.25, 0.0, rng.random(count))[:, None]
    targets = (1 - along) * corners[triangle, corner] + along * corners[triangle, (corner + 1) % 3]
    inside = corners.reshape(-1, 3).mean(axis=0)
    starts = (inside + rng.uniform(-0.1, 0.1, (count, 3))).astype(np.float32)
    t, _, any_hit = _cast(launcher, casters, starts, targets - starts)
    record_property(f"rays of {count} that miss", int(np.count_nonzero((t <= 0.0) | (any_hit != 1))))
    assert np.all(t > 0.0)
    assert np.all(any_hit == 1)


def test_axis_aligned_rays_hit_from_a_side_of_the_bounds(launcher):
    """Rays along an axis that start in the plane of a bounding box's side, and rays along its edges, are found."""
    casters = _casters(launcher, Mesh.box())
    starts = np.array([[-3, 0.2, 0.3], [-3, 1, 0.3], [-3, 1, 1], [0.2, -3, -1], [0, 0, -1]], np.float32)
    directions = np.array([[1, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    t, _, _ = _cast(launcher, casters, starts, directions)
    np.testing.assert_array_equal(t, [2, 2, 2, 2, 0])


def test_far_from_the_origin_nothing_changes(launcher, placed):
    """A million units away, set space holds the same triangles as at the origin."""
    near = _casters(launcher, Mesh.sphere(), transform=placed((0.25, 0, 0)))
    far = _casters(launcher, Mesh.sphere(), transform=placed((1e6 + 0.25, -1e6, 1e6)), origin=(1e6, -1e6, 1e6))
    # float64 holds 1e6 to 1.2e-10, which may tip a float32 rounding.
    np.testing.assert_allclose(far.mesh.points.numpy(), near.mesh.points.numpy(), atol=1.2e-7, rtol=0)


def test_follows_transforms_points_and_visibility(launcher, placed):
    """Hits move with a moving transform and with moving points, and end when a surface becomes invisible."""
    quad = Mesh.grid((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    waving = Mesh(Samples([1, 3], np.stack([quad.points, quad.points + np.float32([0, 0, 4])])), quad.triangles)
    surfaces = (
        Surface(path="/still", mesh=quad, transform=placed((10, 0, 0))),
        Surface(path="/carried", mesh=quad, transform=Samples([1, 3], [placed((0, 0, 0)), placed((0, 0, 2))])),
        Surface(path="/waving", mesh=waving, transform=placed((20, 0, 0))),
        Surface(path="/blinking", mesh=quad, transform=placed((30, 0, 0)), visible=Samples([1, 2], [True, False])),
    )
    casters = Casters(launcher, surfaces, np.zeros(3))
    assert casters.moves
    starts = [[x, 0.1, 5] for x in (10, 0, 20, 30)]
    expected = {1: [5, 5, 5, 5], 2: [5, 4, 3, -1], 3: [5, 3, 1, -1]}
    for time in (1, 2, 3, 1):  # and back again
        casters.update(time)
        t, face, _ = _cast(launcher, casters, starts, [[0, 0, -1]] * 4)
        np.testing.assert_allclose(t, expected[time], atol=1e-6)
        hit = t > 0
        np.testing.assert_array_equal(casters.surface_of_triangle[face[hit]], np.arange(4)[hit])


def test_still_casters_are_made_once(launcher):
    """Updating a set that does not move allocates and changes nothing."""
    launcher = Launcher(launcher.device.alias, 1)
    casters = _casters(launcher, Mesh.box())
    version, allocated = casters.version, dict(launcher.allocated)
    casters.update(2.0)
    assert not casters.moves
    assert (casters.version, dict(launcher.allocated)) == (version, allocated)


@pytest.mark.parametrize(
    "mesh",
    [
        None,
        Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)),
        Mesh(np.ones((3, 3)), [[0, 1, 2]]),
        Mesh([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2], [0, 0, 1]]),
    ],
    ids=["no surface", "no points", "a point", "lines"],
)
def test_nothing_to_hit(launcher, mesh):
    """Without triangles, or with triangles without area, rays end nowhere and nothing is NaN."""
    casters = _casters(launcher, *([mesh] if mesh else []))
    rng = np.random.default_rng(0)
    directions = np.concatenate([rng.standard_normal((100, 3)), [[0, 0, -1], [1, 1, 1]]])
    t, _, any_hit = _cast(launcher, casters, np.full((102, 3), 1.5), directions)
    np.testing.assert_array_equal(t, -1.0)
    np.testing.assert_array_equal(any_hit, 0)
    assert np.all(np.isfinite([casters.lower, casters.upper]))
