"""Whether a surface shows any light its front: what bakes black for its winding or its normals is worth a warning."""

from collections.abc import Iterable

import numpy as np

from warp_smoke.geometry import corner_normals, transform_normals, transform_points
from warp_smoke.plan.reach import is_moving
from warp_smoke.scene import DistantLight, Light, Surface


def faces_away(surface: Surface, lights: Iterable[Light], time: float) -> bool:
    """Whether every corner of a surface turns its back to every light; False where any of them moves.

    Args:
        surface: its front is where its normals point, or, without any, from where its triangles are counter-clockwise.
        lights: the lights that reach it.
        time: time code.
    """
    lights = tuple(lights)
    if is_moving(surface, *lights):
        return False
    mesh, matrix = surface.mesh, surface.transform_at(time)
    points, normals = mesh.points_at(time), mesh.normals_at(time)
    if normals is None:
        normals = corner_normals(points, mesh.triangles)
    corners = transform_points(matrix, points)[mesh.triangles]
    normals = transform_normals(matrix, normals)
    return all(np.all(np.sum(normals * _towards(light, corners, time), axis=-1) <= 0.0) for light in lights)


def _towards(light: Light, points: np.ndarray, time: float) -> np.ndarray:
    """Vectors from world points to a light, of any length."""
    if isinstance(light, DistantLight):
        return np.broadcast_to(-light.direction_at(time), points.shape)
    return light.position_at(time) - points
