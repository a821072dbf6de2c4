"""Vertex maps: the points of a mesh as places to bake."""

import numpy as np
import warp as wp

from warp_smoke.geometry import Mesh
from warp_smoke.record import Samples
from warp_smoke.scene import Receiver, Surface
from warp_smoke.shading.vertices import VertexMap


def receiver(mesh, **fields):
    """A surface to bake."""
    return Surface(path="/S", mesh=mesh, receiver=Receiver(path="/S"), **fields)


def corner_mesh():
    """Faces of areas ½, 1 and 1 across x, y and z that meet at the origin, and a point that none of them uses."""
    points = [[0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 1], [9, 9, 9]]
    return Mesh(points, [[0, 2, 1], [0, 1, 3], [0, 3, 2]])


def test_points_and_normals(launcher):
    """Points are the mesh's, moved; normals sum the faces around by area; a point without faces has none."""
    matrix = np.eye(4)
    matrix[3, :3] = 1, 2, 3
    vertices = VertexMap(launcher, receiver(corner_mesh(), transform=matrix), np.array([1.0, 1.0, 1.0]))
    assert vertices.update(1.0)
    assert not vertices.update(2.0)
    np.testing.assert_allclose(vertices.points.numpy()[0], [0, 1, 2])
    normals = vertices.normals.numpy()
    np.testing.assert_allclose(normals[0], -np.array([1, 2, 2]) / 3, atol=1e-6)
    np.testing.assert_allclose(normals[1], -np.array([0, 1, 1]) / np.sqrt(2), atol=1e-6)
    np.testing.assert_array_equal(normals[4], 0.0)


def test_own_normals_are_used(launcher):
    """Where the mesh has normals, a point's is the mean of its corners'."""
    mesh = corner_mesh()
    tilted = Mesh(mesh.points, mesh.triangles, normals=np.broadcast_to([0.6, 0.8, 0.0], (3, 3, 3)))
    vertices = VertexMap(launcher, receiver(tilted), np.zeros(3))
    vertices.update(1.0)
    np.testing.assert_allclose(vertices.normals.numpy()[:4], np.broadcast_to([0.6, 0.8, 0.0], (4, 3)), atol=1e-6)


def test_moves_with_the_points(launcher):
    """Points that move take their normals along."""
    mesh = corner_mesh()
    turned = mesh.points[:, [1, 2, 0]] * np.float32(2)
    moving = Mesh(Samples([1, 2], np.stack([mesh.points, turned])), mesh.triangles)
    vertices = VertexMap(launcher, receiver(moving), np.zeros(3))
    assert vertices.update(1.0)
    assert vertices.update(2.0)
    np.testing.assert_allclose(vertices.points.numpy(), turned)
    np.testing.assert_allclose(vertices.normals.numpy()[1], -np.array([1, 1, 0]) / np.sqrt(2), atol=1e-6)


def test_results_are_values_at_the_points(launcher):
    """Colours stay linear and shares plain numbers, one for each point; texture coordinates are a corner's."""
    mesh = Mesh.grid((0, 0, 0), (1, 0, 0), (0, 0, -1), 2)
    tiled = Mesh(mesh.points, mesh.triangles, uvs=mesh.uvs * 4)
    vertices = VertexMap(launcher, receiver(tiled), np.zeros(3))
    np.testing.assert_allclose(vertices.uvs, np.stack([mesh.points[:, 0], -mesh.points[:, 2]], axis=1) * 4, atol=1e-6)
    colors = np.arange(27, dtype=np.float32).reshape(9, 3)
    picture = vertices.color_picture("lit", launcher.array(colors, "test", dtype=wp.vec3))
    np.testing.assert_array_equal(picture, colors)
    shares = np.linspace(0, 1, 9, dtype=np.float32)
    np.testing.assert_array_equal(vertices.share_picture("visibility", launcher.array(shares, "test")), shares)
