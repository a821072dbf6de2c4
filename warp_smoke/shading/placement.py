"""A surface placed at a time: its points and corner normals in set space (world − origin)."""

import numpy as np

from warp_smoke.geometry import corner_normals, transform_normals, transform_points
from warp_smoke.scene import Surface


def place_points(surface: Surface, origin: np.ndarray, time: float) -> np.ndarray:
    """Returns a surface's points in set space, [n, 3] float32."""
    points = transform_points(surface.transform_at(time), surface.mesh.points_at(time))
    return (points - origin).astype(np.float32)


def place_normals(surface: Surface, time: float, smooth: bool = False) -> np.ndarray:
    """Returns unit corner normals, [m, 3, 3] float32: the mesh's, or else flat or `smooth` ones; zero without area."""
    mesh = surface.mesh
    normals = mesh.normals_at(time)
    if normals is None:
        normals = corner_normals(mesh.points_at(time), mesh.triangles, smooth)
    return transform_normals(surface.transform_at(time), normals).astype(np.float32)


class Placement:
    """Remembers where a surface was, so that nothing is placed again while it does not move."""

    def __init__(self, surface: Surface):
        self._surface = surface
        self._last = None

    def changed(self, time: float) -> bool:
        """Returns whether the surface has moved since the last call; True at the first one."""
        mesh = self._surface.mesh
        now = (self._surface.transform_at(time), mesh.points_at(time), mesh.normals_at(time))
        before, self._last = self._last, now
        return before is None or not all(map(np.array_equal, before, now))
