"""What casts shadows: every visible triangle of the set in one bounding volume hierarchy (BVH), in set space."""

import numpy as np
import warp as wp

from warp_smoke.geometry import transform_points
from warp_smoke.launch import Launcher
from warp_smoke.record import Samples, value_at
from warp_smoke.scene import Surface

# Rounding in a ray–box test moves a ray by about 3 units in the last place of the distance; with boxes that are not
# larger than their triangles, one ray in a hundred that is aimed at an edge would slip through a closed mesh (Ize,
# 2013, "Robust BVH ray traversal").
_BOX_MARGIN = 16 * float(np.finfo(np.float32).eps)


class Casters:
    """The visible triangles of all surfaces, ready for rays.

    Attributes:
        mesh: the triangles in set space; each has three points of its own.
        surface_of_triangle: index of the surface that each triangle belongs to, [m] int32.
        origin: world position of the origin of set space [stage units], [3] float64.
        lower, upper: bounds in set space [stage units], [3] float64; zeros where nothing is visible.
        moves: whether the triangles ever move or change.
        version: counts the changes so far.
    """

    def __init__(self, launcher: Launcher, surfaces: tuple[Surface, ...], origin: np.ndarray):
        self._launcher, self._surfaces = launcher, tuple(surfaces)
        self.origin = np.asarray(origin, np.float64)
        self.moves = any(s.moves or s.mesh.deforms or isinstance(s.visible, Samples) for s in self._surfaces)
        self.version = 0
        self._time, self._visible = None, None

    @property
    def extent(self) -> float:
        """The largest coordinate in set space [stage units]: rounding errors are in proportion to it."""
        return float(max(np.abs(self.lower).max(), np.abs(self.upper).max()))

    def update(self, time: float) -> None:
        """Moves the triangles to where they are at a time code."""
        if self._time is not None and (time == self._time or not self.moves):
            return
        self._time = time
        visible = [index for index, surface in enumerate(self._surfaces) if value_at(surface.visible, time)]
        corners = [self._corners(self._surfaces[index], time) for index in visible]
        # A point, which no ray hits, keeps an empty set from being a special case.
        triangles = np.concatenate(corners) if any(map(len, corners)) else np.zeros((1, 3, 3), np.float32)
        self.lower, self.upper = (np.asarray(reduce(triangles, (0, 1)), np.float64) for reduce in (np.min, np.max))
        if visible != self._visible:
            self._visible = visible
            self.surface_of_triangle = np.repeat(np.int32(visible), [len(c) for c in corners])
            indices = self._launcher.array(np.arange(3 * len(triangles), dtype=np.int32), "casters")
            points = self._launcher.array(self._boxes(triangles), "casters", dtype=wp.vec3)
            self.mesh = wp.Mesh(points, indices)
        else:
            self.mesh.points.assign(self._boxes(triangles))
            self.mesh.refit()
        # The hierarchy keeps the boxes' bounds; from here on its leaves hold the triangles themselves.
        self.mesh.points.assign(triangles.reshape(-1, 3))
        self.version += 1

    def _corners(self, surface: Surface, time: float) -> np.ndarray:
        """Corners of a surface's triangles in set space, [m, 3, 3] float32."""
        world = transform_points(surface.transform_at(time), surface.mesh.points_at(time))
        corners = (world - self.origin).astype(np.float32)[surface.mesh.triangles]
        # A ray that starts on a triangle without area could hit it by rounding, but never hits a point.
        edges = np.diff(corners.astype(np.float64), axis=1)
        flat = ~np.any(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        corners[flat] = corners[flat, :1]
        return corners

    def _boxes(self, triangles: np.ndarray) -> np.ndarray:
        """Three points for each triangle that span its bounding box and a margin, [3 m, 3] float32."""
        margin = np.float32(_BOX_MARGIN * self.extent)
        lower, upper = triangles.min(axis=1) - margin, triangles.max(axis=1) + margin
        return np.stack([lower, upper, lower], axis=1).reshape(-1, 3)
