"""Tangent frames: directions, handedness, averages, and what has none."""

import numpy as np
from scipy.spatial.transform import Rotation

from warp_smoke.geometry import Mesh, transform_normals, transform_points
from warp_smoke.shading.tangents import corner_tangents

FLOOR = Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2), divisions=3)


def tangents_of(mesh, matrix=None, uvs=None):
    """Tangents of a mesh that is moved by a matrix."""
    matrix = np.eye(4) if matrix is None else matrix
    points, normals = transform_points(matrix, mesh.points), transform_normals(matrix, mesh.normals)
    return corner_tangents(points, mesh.triangles, normals, mesh.uvs if uvs is None else uvs)


def test_a_plane():
    """On a floor with u along x and v along −z the tangent is x and n × t is v's direction: sign 1."""
    np.testing.assert_allclose(tangents_of(FLOOR), np.broadcast_to([1, 0, 0, 1], (18, 3, 4)), atol=1e-7)


def test_mirrored_coordinates_change_the_sign():
    """With u turned around the tangent is −x and the bitangent stays −z: sign −1."""
    found = tangents_of(FLOOR, uvs=FLOOR.uvs * (-1, 1))
    np.testing.assert_allclose(found, np.broadcast_to([-1, 0, 0, -1], (18, 3, 4)), atol=1e-7)


def test_mirrored_surfaces_change_the_sign():
    """A floor mirrored in x has its tangent at −x; seen from above, its texture is mirrored."""
    found = tangents_of(FLOOR, np.diag([-1.0, 1, 1, 1]))
    np.testing.assert_allclose(found, np.broadcast_to([-1, 0, 0, -1], (18, 3, 4)), atol=1e-7)


def test_frames_turn_with_the_surface():
    """A rotation turns tangents and keeps signs."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz", (30, 40, 50), degrees=True).as_matrix().T
    ball = Mesh.sphere(1.0, 16)
    before, after = tangents_of(ball), tangents_of(ball, turn)
    np.testing.assert_allclose(after[..., :3], before[..., :3] @ turn[:3, :3], atol=1e-5)
    np.testing.assert_array_equal(after[..., 3], before[..., 3])


def test_a_sphere_has_its_parallels():
    """Away from the poles, where triangles see u grow askew, tangents are eastwards and at right angles to normals."""
    ball = Mesh.sphere(1.0, 64)
    found = tangents_of(ball)
    x, y, z = np.moveaxis(ball.normals, 2, 0)
    east = np.stack([-y, x, np.zeros_like(x)], axis=2) / np.hypot(x, y)[..., None].clip(1e-9)
    middle = np.abs(z) < 0.8
    np.testing.assert_allclose(found[middle][:, :3], east[middle], atol=0.05)  # at the seam, half a chord of a 64-gon
    np.testing.assert_allclose(np.sum(found[..., :3] * ball.normals, axis=2), 0, atol=1e-6)
    assert np.all(found[..., 3] == 1)


def test_neighbours_share_their_frame():
    """Corners with the same place, normal and coordinates have the same tangent, to the bit."""
    ball = Mesh.sphere(1.0, 16)
    found = tangents_of(ball)
    keys = np.concatenate([ball.points[ball.triangles], ball.normals, ball.uvs], axis=2).reshape(-1, 8)
    _, group = np.unique(np.round(keys, 5), axis=0, return_inverse=True)
    flat = found.reshape(-1, 4)
    first = np.array([flat[group == g][0] for g in range(group.max() + 1)])
    np.testing.assert_array_equal(flat, first[group])


def test_coordinates_without_area_give_no_frame():
    """Triangles whose texture coordinates are one point or one line have no tangent and no sign."""
    for factor in ((0, 0), (1, 0), (0, 1)):
        np.testing.assert_array_equal(tangents_of(FLOOR, uvs=FLOOR.uvs * np.array(factor)), 0)


def test_triangles_without_area_give_no_frame():
    """A triangle that is a point has no tangent, and nothing becomes NaN."""
    found = corner_tangents(np.zeros((3, 3)), np.array([[0, 1, 2]]), np.zeros((1, 3, 3)), FLOOR.uvs[:1])
    np.testing.assert_array_equal(found, 0)


def test_no_triangles():
    """An empty mesh has none."""
    assert corner_tangents(np.zeros((0, 3)), np.zeros((0, 3), int), np.zeros((0, 3, 3)), np.zeros((0, 3, 2))).size == 0
