"""Lights, placed prims and look-ups that the shadow tests share."""

import numpy as np
import pytest
import warp as wp

from warp_smoke.scene import DistantLight, PointLight


def _placed(position):
    matrix = np.eye(4)
    matrix[3, :3] = position
    return matrix


def _aimed(direction):
    """A matrix whose −Z axis points along `direction`."""
    z = -np.asarray(direction, float) / np.linalg.norm(direction)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = x, np.cross(z, x), z
    return matrix


@pytest.fixture(scope="session")
def placed():
    """A function: position → transform."""
    return _placed


@pytest.fixture(scope="session")
def point_light():
    """A function: position → point light."""
    return lambda position, **fields: PointLight(path="/light", transform=_placed(position), **fields)


@pytest.fixture(scope="session")
def distant_light():
    """A function: direction in which it shines → distant light."""
    return lambda direction, **fields: DistantLight(path="/light", transform=_aimed(direction), **fields)


@pytest.fixture(scope="session")
def visibility(device):
    """A function: (shadow, points, normals) → visibility [n]."""

    def look_up(shadow, points, normals):
        points = np.asarray(points, np.float32)
        normals = np.broadcast_to(np.asarray(normals, np.float32), points.shape)
        points, normals = (wp.array(a, dtype=wp.vec3, device=device) for a in (points, normals))
        out = wp.full(len(points), -1.0, dtype=float, device=device)
        shadow.visibility(points, normals, out)
        return out.numpy()

    return look_up


@pytest.fixture(scope="session")
def transmittance(device):
    """A function: (*shadows, points=) → product of their transmittances [n]."""

    def look_up(*shadows, points):
        points = wp.array(np.asarray(points, np.float32), dtype=wp.vec3, device=device)
        out = wp.full(len(points), 1.0, dtype=float, device=device)
        for shadow in shadows:
            shadow.transmittance(points, out)
        return out.numpy()

    return look_up
