"""Meshes of the simple solids: closed, outward, with the right volume; normals and transforms."""

import numpy as np
import pytest

from warp_smoke.geometry import Mesh, corner_normals, transform_normals, transform_points, winding_flips
from warp_smoke.record import FieldError, Samples


def signed_volume(mesh):
    """Volume inside a closed mesh by the divergence theorem, positive if faces look outward."""
    p = mesh.points[mesh.triangles].astype(float)
    return np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6


SOLIDS = {
    "box": (Mesh.box((1.0, 2.0, 3.0)), 6.0),
    "sphere": (Mesh.sphere(0.5), np.pi / 6),
    "cylinder": (Mesh.cylinder(0.5, 2.0, "Y"), np.pi / 2),
    "cone": (Mesh.cone(0.5, 3.0, "X"), np.pi / 4),
    "capsule": (Mesh.capsule(0.5, 1.0), np.pi / 6 + np.pi / 4),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_volume(name):
    """Volumes match the closed forms; a 64-gon's area is 0.16 % below its circle's."""
    mesh, volume = SOLIDS[name]
    assert signed_volume(mesh) == pytest.approx(volume, rel=5e-3)
    assert signed_volume(mesh) <= volume * (1 + 1e-6)


@pytest.mark.parametrize("name", SOLIDS)
def test_closed(name):
    """Each edge, taken by position, is used once in each direction: no holes, no triangles without area."""
    mesh, _ = SOLIDS[name]
    _, same = np.unique(np.round(mesh.points, 6), axis=0, return_inverse=True)
    edges = same[mesh.triangles][:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    forward, counts = np.unique(edges, axis=0, return_counts=True)
    assert np.all(counts == 1)
    assert {tuple(edge) for edge in forward} == {tuple(edge[::-1]) for edge in forward}


@pytest.mark.parametrize("name", SOLIDS)
def test_normals_and_uvs(name):
    """Corner normals are unit vectors on the outside of their face, UVs lie in [0, 1]."""
    mesh, _ = SOLIDS[name]
    assert np.linalg.norm(mesh.normals, axis=2) == pytest.approx(1.0, abs=1e-6)
    face = corner_normals(mesh.points, mesh.triangles)
    assert np.einsum("ijk,ijk->ij", face, mesh.normals).min() > 0.99
    assert mesh.uvs.min() >= 0
    assert mesh.uvs.max() <= 1


@pytest.mark.parametrize(("axis", "index"), [("X", 0), ("Y", 1), ("Z", 2)])
def test_axis(axis, index):
    """A cone points its apex along the positive axis asked for."""
    mesh = Mesh.cone(0.5, 2.0, axis)
    apex = mesh.points[np.argmax(mesh.points[:, index])]
    expected = np.zeros(3)
    expected[index] = 1.0
    np.testing.assert_allclose(apex, expected, atol=1e-7)


def test_grid():
    """A patch has the corner, the edges, the facing and the UVs asked for."""
    mesh = Mesh.grid((1, 0, 2), (2, 0, 0), (0, 0, -3), divisions=4)
    np.testing.assert_allclose(mesh.points.min(axis=0), (1, 0, -1))
    np.testing.assert_allclose(mesh.points.max(axis=0), (3, 0, 2))
    np.testing.assert_allclose(mesh.normals, np.broadcast_to([0, 1, 0], mesh.normals.shape), atol=1e-7)
    np.testing.assert_allclose(corner_normals(mesh.points, mesh.triangles)[0, 0], (0, 1, 0))
    p = mesh.points[mesh.triangles]
    np.testing.assert_allclose(mesh.uvs[..., 0], (p[..., 0] - 1) / 2, atol=1e-6)
    np.testing.assert_allclose(mesh.uvs[..., 1], (2 - p[..., 2]) / 3, atol=1e-6)


def test_smooth_normals_weigh_by_area():
    """At a corner of a cube the sum of the faces points along the diagonal; a sliver adds nothing."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0]], float)
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [0, 1, 4]])
    normals = corner_normals(points, triangles, smooth=True)
    np.testing.assert_allclose(normals[0, 0], -np.ones(3) / np.sqrt(3), atol=1e-12)
    np.testing.assert_array_equal(corner_normals(points, triangles)[3], 0.0)


def test_normals_take_the_inverse_transpose():
    """A slope of 45° stretched twice along x keeps its normal at right angles to it, also under a mirror."""
    along, across = np.array([1.0, 1.0, 0.0]), np.array([-1.0, 1.0, 0.0]) / np.sqrt(2)
    for x in (2.0, -2.0):
        matrix = np.diag([x, 1.0, 1.0, 1.0])
        normal = transform_normals(matrix, across)
        assert normal @ transform_points(matrix, along) == pytest.approx(0.0, abs=1e-12)
        assert winding_flips(matrix) == (x < 0)


def test_normals_of_what_is_flattened():
    """Squashed into a plane, a solid has the plane's normals; squashed into a point it has none, and nothing fails."""
    normals = np.array([[0.0, 1.0, 0.0], [0.6, 0.0, 0.8], [0.0, -0.6, 0.8]])
    flat = transform_normals(np.diag([2.0, 0.0, 1.0, 1.0]), normals)
    np.testing.assert_allclose(flat, [[0, 1, 0], [0, 0, 0], [0, -1, 0]], atol=1e-12)
    np.testing.assert_array_equal(transform_normals(np.diag([0.0, 0.0, 0.0, 1.0]), normals), 0.0)


def test_bad_meshes_are_refused():
    """Indices out of range, NaN and wrong shapes name the field, the value and what is allowed."""
    points, triangles = np.zeros((3, 3)), [[0, 1, 2]]
    for change, message in (
        ({"triangles": [[0, 1, 3]]}, r"triangles is 0…3; allowed: 0…2"),
        ({"points": np.full((3, 3), np.nan)}, r"points is .*nan.* at index 0; allowed: finite"),
        ({"points": np.zeros((3, 2))}, r"points is shape \(3, 2\); allowed: \[n, 3\]"),
        ({"uvs": np.zeros((3, 2))}, r"uvs is shape \(3, 2\); allowed: \[1, 3, 2\]"),
    ):
        with pytest.raises(FieldError, match=message):
            Mesh(**{"points": points, "triangles": triangles} | change)


def test_moving_points():
    """Points move linearly between samples and stay outside them."""
    still = np.eye(3, dtype=np.float32)
    mesh = Mesh(Samples([1, 3], np.stack([still, still + 2])), [[0, 1, 2]])
    assert mesh.deforms
    np.testing.assert_allclose(mesh.points_at(2), still + 1)
    np.testing.assert_allclose(mesh.points_at(9), still + 2)
    assert not Mesh(Samples([1, 3], np.stack([still, still])), [[0, 1, 2]]).deforms


def test_parts_of_a_mesh():
    """A part has its triangles' corners alone, also where their normals turn; a part may be empty."""
    ball = Mesh.sphere(1.0, 8)
    turning = Samples([1, 2], np.stack([ball.normals, -ball.normals]))
    whole = Mesh(ball.points, ball.triangles, turning, ball.uvs, np.arange(len(ball.triangles)) // 2)
    chosen = np.arange(0, len(whole.triangles), 3)
    part = whole.part(chosen)
    np.testing.assert_array_equal(part.points[part.triangles], whole.points[whole.triangles][chosen])
    np.testing.assert_array_equal(part.normals_at(1.5), whole.normals_at(1.5)[chosen])
    np.testing.assert_array_equal(part.uvs, whole.uvs[chosen])
    np.testing.assert_array_equal(part.faces, whole.faces[chosen])
    assert whole.part(chosen[:0]).normals_at(1.0).shape == (0, 3, 3)
