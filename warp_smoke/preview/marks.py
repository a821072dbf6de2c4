"""Marks for what has no surface: lights, and before a run also the domains' boxes and the emitters."""

import numpy as np
import pyvista as pv

from warp_smoke.geometry import Mesh, Points, normalized
from warp_smoke.preview.color import linear_to_srgb
from warp_smoke.scene import DistantLight, Emitter, Light, SmokeDomain, SpotLight
from warp_smoke.shading.light_source import light_source

DOMAIN_COLOR, EMITTER_COLOR = "#9fc3e0", "#f0a94e"
# Faces of an octahedron with the corners +X, +Y, +Z, -X, -Y, -Z.
OCTAHEDRON = np.array([(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)])


def mark_light(light: Light, center: np.ndarray, radius: float, time: float) -> pv.Actor | None:
    """Marks a light by a small sphere, a spot light also by its cone, a distant light by an arrow; None if it is off.

    Args:
        light: the light.
        center: world position of the middle of what is shown, [3].
        radius: radius of what is shown [stage units].
        time: time code.
    """
    strength = np.asarray(light_source(light, np.zeros(3), time).strength)
    if not strength.any():
        return None
    if isinstance(light, DistantLight):
        direction = light.direction_at(time)
        shape = pv.Arrow(start=center - 1.4 * radius * direction, direction=direction, scale=0.3 * radius)
    else:
        shape = pv.Sphere(radius=0.02 * radius, center=light.position_at(time))
        if isinstance(light, SpotLight):
            shape = shape.append_polydata(_rays(light, 0.3 * radius, time))
    actor = pv.Actor(mapper=pv.DataSetMapper(shape))
    actor.prop.lighting = False
    actor.prop.color = linear_to_srgb(strength / strength.max()).tolist()
    return actor


def mark_domain(domain: SmokeDomain, time: float) -> pv.Actor:
    """Draws the edges of a domain's box."""
    box = Mesh.box(np.subtract(domain.upper, domain.lower), domain.lower)
    edges = pv.PolyData.from_regular_faces(box.points_at(time), box.triangles).extract_feature_edges(30.0)
    return _wires(edges, domain.transform_at(time), DOMAIN_COLOR, 1.0)


def mark_emitter(emitter: Emitter, time: float) -> pv.Actor:
    """Draws the edges of an emitter's triangles, or of an octahedron for each of its points."""
    mesh = emitter.mesh
    if isinstance(mesh, Points):
        corners = np.concatenate([np.eye(3), -np.eye(3)])
        sizes = mesh.widths_at(time)[:, None, None] / 2
        points = (mesh.points_at(time)[:, None] + sizes * corners).reshape(-1, 3)
        triangles = (6 * np.arange(len(sizes))[:, None, None] + OCTAHEDRON).reshape(-1, 3)
    else:
        points, triangles = mesh.points_at(time), mesh.triangles
    shape = pv.PolyData.from_regular_faces(points, triangles)
    return _wires(shape, emitter.transform_at(time), EMITTER_COLOR, 0.15)


def _rays(light: SpotLight, length: float, time: float) -> pv.PolyData:
    """Lines along the edge of a spot light's cone."""
    position, direction = light.position_at(time), light.direction_at(time)
    across = normalized(np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))]))
    angle, turn = np.radians(light.cone_angle), np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)[:, None]
    around = np.cos(turn) * across + np.sin(turn) * np.cross(direction, across)
    ends = position + length * (np.cos(angle) * direction + np.sin(angle) * around)
    points = np.stack([np.broadcast_to(position, ends.shape), ends], axis=1).reshape(-1, 3)
    return pv.line_segments_from_points(points)


def _wires(shape: pv.PolyData, matrix: np.ndarray, color: str, opacity: float) -> pv.Actor:
    actor = pv.Actor(mapper=pv.DataSetMapper(shape))
    actor.prop.style, actor.prop.color, actor.prop.opacity = "wireframe", color, opacity
    actor.prop.lighting, actor.prop.line_width = False, 2.0
    # Moved towards the eye, in front of the floor that a box stands on.
    actor.mapper.resolve = "polygon_offset"
    actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, -8.0)
    actor.user_matrix = matrix.T
    return actor
