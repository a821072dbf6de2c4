"""Shapes that several tests share."""

import numpy as np

from warp_smoke.geometry import Mesh


def shell(radius, thickness):
    """A hollow sphere, closed on both sides."""
    outer, inner = Mesh.sphere(radius, 32), Mesh.sphere(radius - thickness, 32)
    points = np.concatenate([outer.points, inner.points])
    return Mesh(points, np.concatenate([outer.triangles, inner.triangles[:, ::-1] + len(outer.points)]))
