"""Marks for what has no surface: where lights stand, and before a run also the domains' boxes and the emitters."""

import numpy as np
import pyvista as pv

from warp_smoke.geometry import Mesh
from warp_smoke.preview.color import linear_to_srgb
from warp_smoke.scene import DistantLight, Emitter, Light, SmokeDomain
from warp_smoke.shading.light_source import light_source

DOMAIN_COLOR, EMITTER_COLOR = "#9fc3e0", "#f0a94e"


def mark_light(light: Light, center: np.ndarray, radius: float, time: float) -> pv.Actor | None:
    """A small sphere where a light stands, or for a distant one an arrow upon what is looked at; None for one off.

    Args:
        light: the light.
        center: world position of what is looked at, [3].
        radius: its size [stage units].
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
    actor = pv.Actor(mapper=pv.DataSetMapper(shape))
    actor.prop.lighting = False
    actor.prop.color = linear_to_srgb(strength / strength.max()).tolist()
    return actor


def mark_domain(domain: SmokeDomain, time: float) -> pv.Actor:
    """The edges of a domain's box."""
    box = Mesh.box(np.subtract(domain.upper, domain.lower), domain.lower)
    edges = pv.PolyData.from_regular_faces(box.points_at(time), box.triangles).extract_feature_edges(30.0)
    return _wires(edges, domain.transform_at(time), DOMAIN_COLOR, 1.0)


def mark_emitter(emitter: Emitter, time: float) -> pv.Actor:
    """The triangles' edges of an emitter."""
    mesh = emitter.mesh
    return _wires(
        pv.PolyData.from_regular_faces(mesh.points_at(time), mesh.triangles),
        emitter.transform_at(time),
        EMITTER_COLOR,
        0.15,
    )


def _wires(shape: pv.PolyData, matrix: np.ndarray, color: str, opacity: float) -> pv.Actor:
    actor = pv.Actor(mapper=pv.DataSetMapper(shape))
    actor.prop.style, actor.prop.color, actor.prop.opacity = "wireframe", color, opacity
    actor.prop.lighting, actor.prop.line_width = False, 2.0
    # Towards the eye, before the floor that a box stands on.
    actor.mapper.resolve = "polygon_offset"
    actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, -8.0)
    actor.user_matrix = matrix.T
    return actor
