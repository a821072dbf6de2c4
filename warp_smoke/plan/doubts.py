"""Meshes that can be worked with, but that hardly are what their maker meant; each is worth a warning."""

from collections.abc import Iterable, Iterator

import numpy as np

from warp_smoke.geometry import Mesh, corner_normals, transform_normals, transform_points
from warp_smoke.plan.passes import DomainPlan, ReceiverPlan
from warp_smoke.plan.reach import is_moving
from warp_smoke.scene import DistantLight, Light, Surface


def open_meshes(domains: Iterable[DomainPlan]) -> Iterator[str]:
    """Emitters and colliders with holes, whose inside can only be estimated."""
    shapes = {each.path: each for domain in domains for each in (*domain.emitters, *domain.colliders)}
    for path, each in shapes.items():
        mesh = getattr(each, "mesh", None)
        if isinstance(mesh, Mesh) and not mesh.is_closed:
            yield f"{path}: its mesh is not closed; what counts as inside it is estimated"


def dark_receivers(receivers: Iterable[ReceiverPlan], time: float) -> Iterator[str]:
    """Receivers that bake black for their winding or their normals."""
    for each in receivers:
        if each.lights and faces_away(each.surface, [light.light for light in each.lights], time):
            yield f"{each.surface.path}: it faces away from every light; are its orientation and normals right?"


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
