"""What casts shadows: every visible triangle of the set in one bounding volume hierarchy (BVH), in set space."""

import numpy as np
import warp as wp

from warp_smoke.geometry import transform_points, winding_flips
from warp_smoke.launch import Launcher
from warp_smoke.record import Samples, value_at
from warp_smoke.scene import Surface
from warp_smoke.shadow.coverage import casting_boxes, patches_of

# Rounding in a ray–box test moves a ray by about 3 units in the last place of the distance; with boxes no larger than
# their triangles, one in a hundred rays aimed at an edge would slip through a closed mesh (Ize, 2013, "Robust BVH Ray
# Traversal").
_BOX_MARGIN = 16 * float(np.finfo(np.float32).eps)


@wp.func
def nearest_hit(mesh: wp.uint64, start: wp.vec3, direction: wp.vec3, end: float, cull: float):
    """Ray parameter of the nearest hit, or −1; with `cull` > 0 of the nearest face that is turned away from the ray."""
    found = wp.float32(-1.0)
    passed = wp.float32(0.0)
    searching = wp.int32(1)
    while searching == 1:
        hit = wp.mesh_query_ray(mesh, start + passed * direction, direction, end - passed)
        searching = wp.int32(0)
        if hit.result:
            if cull > 0.0 and wp.dot(hit.normal, direction) < 0.0:
                # Continue past this front face; a back face within rounding behind it is passed too.
                passed = wp.max((passed + hit.t) * 1.000001, passed + 1.0e-30)
                searching = wp.where(passed < end, 1, 0)
            else:
                found = passed + hit.t
    return found


class Casters:
    """The visible triangles of all surfaces, ready for rays.

    Attributes:
        mesh: the triangles in set space; each has three points of its own.
        surface_of_triangle: index of the surface that each triangle of `mesh` belongs to, [m] int32.
        triangles: corners of the triangles in set space, patch by patch, [m, 3, 3] float32.
        origin: world position of the origin of set space [stage units], [3] float64.
        lower, upper: bounds in set space [stage units], [3] float64; zeros where nothing is visible.
        moves: whether the triangles ever move or change.
        most_triangles: how many there are when all surfaces are visible.
        version: counts the changes so far.
    """

    def __init__(self, launcher: Launcher, surfaces: tuple[Surface, ...], origin: np.ndarray):
        self._launcher, self._surfaces = launcher, tuple(surfaces)
        self.origin = np.asarray(origin, np.float64)
        self.moves = any(s.moves or s.mesh.deforms or isinstance(s.visible, Samples) for s in self._surfaces)
        self.version = 0
        self.most_triangles = sum(len(surface.mesh.triangles) for surface in self._surfaces)
        self._time, self._visible = None, None
        self._still: dict[int, np.ndarray] = {}

    @property
    def extent(self) -> float:
        """The largest coordinate in set space [stage units]: rounding errors are proportional to it."""
        return float(max(np.abs(self.lower).max(), np.abs(self.upper).max()))

    def update(self, time: float) -> None:
        """Moves the triangles to where they are at a time code."""
        if self._time is not None and (time == self._time or not self.moves):
            return
        self._time = time
        visible = [index for index, surface in enumerate(self._surfaces) if value_at(surface.visible, time)]
        corners = [self._corners(index, time) for index in visible]
        # A point, which no ray hits, keeps an empty set from being a special case.
        triangles = np.concatenate(corners) if any(map(len, corners)) else np.zeros((1, 3, 3), np.float32)
        self.lower, self.upper = (np.asarray(reduce(triangles, (0, 1)), np.float64) for reduce in (np.min, np.max))
        if visible != self._visible:
            self._visible = visible
            self.surface_of_triangle = np.repeat(np.int32(visible), [len(c) for c in corners])
            patches = patches_of(triangles[: len(self.surface_of_triangle)], self.surface_of_triangle)
            self._by_patch = np.argsort(patches, kind="stable")
            self._patches = patches[self._by_patch]
            indices = self._launcher.array(np.arange(3 * len(triangles), dtype=np.int32), "casters")
            points = self._launcher.array(self._boxes(triangles), "casters", dtype=wp.vec3)
            self.mesh = wp.Mesh(points, indices)
        else:
            self.mesh.points.assign(self._boxes(triangles))
            self.mesh.refit()
        self.triangles = triangles[self._by_patch]
        # The hierarchy keeps the boxes' bounds; from here on its leaves refer to the triangles themselves.
        self.mesh.points.assign(triangles.reshape(-1, 3))
        self.version += 1

    def follow(self, frames: range) -> None:
        """Gives the hierarchy the shape that it would have after an update at each of these frames.

        It is rebuilt when the set of visible surfaces changes; when that last happened may decide which of several
        triangles at the same distance a ray hits.
        """
        shown = [[bool(value_at(surface.visible, time)) for surface in self._surfaces] for time in frames]
        changes = [time for time, before, now in zip(frames[1:], shown, shown[1:], strict=False) if before != now]
        self.update(changes[-1] if changes else frames[0])

    def boxes_behind_which(self, receivers: np.ndarray, light: np.ndarray, slack: float) -> np.ndarray:
        """Returns bounds of the patches that may shadow receivers, [n, 2, 3]; see `coverage.casting_boxes`."""
        return casting_boxes(self.triangles, self._patches, receivers, light, slack)

    def _corners(self, index: int, time: float) -> np.ndarray:
        """Returns a surface's triangle corners in set space, [m, 3, 3] float32, front faces counter-clockwise."""
        surface = self._surfaces[index]
        if index in self._still:
            return self._still[index]
        matrix = surface.transform_at(time)
        world = transform_points(matrix, surface.mesh.points_at(time))
        order = surface.mesh.triangles[:, ::-1] if winding_flips(matrix) else surface.mesh.triangles
        corners = (world - self.origin).astype(np.float32)[order]
        # A ray that starts on a triangle without area could hit it by rounding; collapsed to a point it is never hit.
        edges = np.diff(corners.astype(np.float64), axis=1)
        flat = ~np.any(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        corners[flat] = corners[flat, :1]
        if not (surface.moves or surface.mesh.deforms):
            self._still[index] = corners
        return corners

    def _boxes(self, triangles: np.ndarray) -> np.ndarray:
        """Returns three points per triangle that span its bounding box plus a margin, [3 m, 3] float32."""
        margin = np.float32(_BOX_MARGIN * self.extent)
        lower, upper = triangles.min(axis=1) - margin, triangles.max(axis=1) + margin
        return np.stack([lower, upper, lower], axis=1).reshape(-1, 3)
