"""Tangent frames by MikkTSpace's convention (M. Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008).

A tangent is the direction in which u grows, perpendicular to the normal, averaged by angle over the triangles around
a point that share its normal, texture coordinates and handedness; the bitangent is sign · normal × tangent.
"""

import numpy as np

from warp_smoke.geometry import normalized


def corner_tangents(points: np.ndarray, triangles: np.ndarray, normals: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """Computes unit tangents and signs at each corner, [m, 3, 4] float32; zero where texture coordinates have no area.

    Args:
        points: the surface's points, [n, 3].
        triangles: [m, 3].
        normals: unit normals at each corner, [m, 3, 3], pointing outward even on a mirrored surface.
        uvs: at each corner, [m, 3, 2].
    """
    p, t, normals = (np.asarray(a, np.float64) for a in (points[triangles], uvs, normals))
    along_u, sign = _gradients(p, t, normals)
    tangents = _flattened(along_u[:, None, :], normals)
    tangents[sign == 0] = 0.0
    weights = _corner_angles(p, normals)[..., None]

    # Bytes, so that equal corners are found by one sort; + 0.0 turns −0 into 0.
    corners = np.concatenate([p, normals, t], axis=2).astype(np.float32) + np.float32(0.0)
    signs = np.broadcast_to(sign[:, None, None], (*sign.shape, 3, 1)).astype(np.float32)
    keys = np.ascontiguousarray(np.concatenate([corners, signs], axis=2).reshape(-1, 9))
    _, group = np.unique(keys.view(f"V{keys.strides[0]}").ravel(), return_inverse=True)
    total = np.zeros((group.max(initial=-1) + 1, 3))
    np.add.at(total, group, (weights * tangents).reshape(-1, 3))
    tangents = _flattened(total[group].reshape(-1, 3, 3), normals)
    return np.concatenate([tangents, signs * np.any(tangents, axis=2, keepdims=True)], axis=2).astype(np.float32)


def _gradients(p: np.ndarray, t: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns dp/du of each triangle, of any length, [m, 3], and its handedness 1, −1 or 0, [m]."""
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    (u1, v1), (u2, v2) = (t[:, 1] - t[:, 0]).T, (t[:, 2] - t[:, 0]).T
    area = (u1 * v2 - u2 * v1)[:, None]
    along_u = (e1 * v2[:, None] - e2 * v1[:, None]) * np.sign(area)
    along_v = (e2 * u1[:, None] - e1 * u2[:, None]) * np.sign(area)
    outward = normals.sum(axis=1)
    return along_u, np.sign(np.sum(np.cross(outward, along_u) * along_v, axis=1))


def _flattened(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Projects vectors perpendicular to unit normals and normalizes them."""
    return normalized(vectors - np.sum(vectors * normals, axis=-1, keepdims=True) * normals)


def _corner_angles(p: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Returns the angle of each triangle at each corner, projected along the normal there, [m, 3] [rad]."""
    angles = np.empty(p.shape[:2])
    for corner in range(3):
        n = normals[:, corner]
        a, b = (_flattened(p[:, (corner + k) % 3] - p[:, corner], n) for k in (1, 2))
        angles[:, corner] = np.arccos(np.clip(np.sum(a * b, axis=1), -1.0, 1.0))
    return angles
