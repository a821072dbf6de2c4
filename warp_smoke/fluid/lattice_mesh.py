"""Meshes on the lattice: their position in its cells and their motion."""

import numpy as np
import warp as wp

from warp_smoke.geometry import transform_points
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher
from warp_smoke.scene import Collider, Emitter


@wp.struct
class Motion:
    """The motion of a mesh's surface [m/s] at points in cell coordinates.

    Within `near` cells of the surface it is that of the closest point, elsewhere mean + gradient (x − centre).
    """

    near: float
    centre: wp.vec3
    mean: wp.vec3
    gradient: wp.mat33


@wp.func
def surface_velocity(mesh: wp.uint64, motion: Motion, x: wp.vec3):
    """Returns the velocity of the surface at or near x."""
    velocity = motion.mean + motion.gradient * (x - motion.centre)
    if motion.near > 0.0:
        query = wp.mesh_query_point_no_sign(mesh, x, motion.near)
        if query.result:
            velocity = wp.mesh_eval_velocity(mesh, query.face, query.u, query.v)
    return velocity


def box_limits(lattice: Lattice, extent: np.ndarray, wraps: bool) -> tuple[np.ndarray, np.ndarray]:
    """Returns the first cell and the end of the cells that the box around a shape may cover, along each axis.

    Args:
        lattice: cells of the domain.
        extent: extent of the shape, [3] [cells].
        wraps: whether the box continues beyond periodic sides: as far as the shape does, but by only one cell if the
            shape is longer than the domain, as it then has no images.
    """
    n = np.asarray(lattice.shape)
    ring = wraps & np.array([side == "periodic" for side in lattice.sides[0::2]])
    beyond = np.where(ring, np.where(extent > n, 1, 2**30), 0)
    return -beyond, n + beyond


class LatticeMesh:
    """One mesh in cell coordinates, kept up to date as it moves; subclasses define what happens in its cells.

    A mesh that is inside out (negative volume) is reversed, so its inside does not depend on the winding order.

    Attributes:
        moves: whether the mesh ever moves or deforms.
        lower: first cell of its box (i, j, k).
        shape: cells along each axis of the box that the mesh with its margin touches, at least one; (0, 0, 0) before
            the first update, and if the mesh has no triangles or lies outside the lattice.
    """

    wraps = False  # whether the box continues beyond periodic sides

    def __init__(self, launcher: Launcher, lattice: Lattice, prim: Emitter | Collider, label: str, margin: float = 0.0):
        """Prepares the mesh; `update` places it.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            prim: the prim that has the mesh and its transform.
            label: label under which its memory is counted.
            margin: added outside the mesh [cells].
        """
        self._launcher, self._lattice, self._prim = launcher, lattice, prim
        self._label, self._margin = label, float(margin)
        self._closed = prim.mesh.is_closed
        self.moves = prim.moves or prim.mesh.deforms
        self.lower = self.shape = (0, 0, 0)
        self._points = self._point_velocity = None  # of the last update, [n, 3] float64 [cells], [m/s]
        self._mesh = None
        a, b, c = prim.mesh.welded.T
        self._triangles = prim.mesh.triangles[(a != b) & (b != c) & (c != a)]
        self._used = np.unique(self._triangles)

    def update(self, start: float, end: float, seconds: float) -> bool:
        """Places the mesh at its position at `end`, with its mean velocity since `start`.

        Args:
            start: time code.
            end: time code; the mesh is at rest if it equals `start`.
            seconds: simulated time between them [s].

        Returns:
            Whether anything changed since the last update.
        """
        if self._points is not None and not self.moves:
            return False
        points = self._points_at(end)
        displacement = points - self._points_at(start) if self.moves and start != end else np.zeros_like(points)
        velocity = displacement * (self._lattice.h / seconds) if displacement.any() else displacement
        if (
            self._points is not None
            and np.array_equal(points, self._points)
            and np.array_equal(velocity, self._point_velocity)
        ):
            return False
        self._points, self._point_velocity = points, velocity
        if len(self._triangles):
            self._fit_box(points[self._used])
            self._place_mesh(points, velocity)
        return True

    def travel(self, start: float, end: float) -> float:
        """Returns an upper bound of the distance between any point's positions at `start` and `end` [cells]."""
        if not self.moves or start == end or not len(self._triangles):
            return 0.0
        if self._prim.mesh.deforms:
            was, now = self._points_at(start), self._points_at(end)
        else:
            # A linear displacement is largest at a corner of the box.
            points = self._prim.mesh.points_at(start)
            low, high = points.min(axis=0), points.max(axis=0)
            corners = np.where(np.indices((2, 2, 2)).reshape(3, 8).T, high, low)
            was, now = (transform_points(self._to_cells(time), corners) for time in (start, end))
        return float(np.linalg.norm(now - was, axis=1).max())

    def _to_cells(self, time: float) -> np.ndarray:
        """Returns the matrix from local space to cell coordinates."""
        return self._prim.transform_at(time) @ self._lattice.world_to_cells()

    def _points_at(self, time: float) -> np.ndarray:
        """Returns the points in cell coordinates, [n, 3] float64."""
        return transform_points(self._to_cells(time), self._prim.mesh.points_at(time))

    def _fit_box(self, points: np.ndarray) -> None:
        low, high = points.min(axis=0) - self._margin, points.max(axis=0) + self._margin
        self.lower = self.shape = (0, 0, 0)
        first, end = box_limits(self._lattice, high - low, self.wraps)
        # A mesh less than half a cell outside lies between the outermost centres and those beyond an open side.
        if np.all(high >= first - 0.5) and np.all(low <= end + 0.5):
            lower = np.clip(np.floor(low), first, end - 1).astype(int)
            upper = np.maximum(np.clip(np.ceil(high), first + 1, end).astype(int), lower + 1)
            self.lower, self.shape = tuple(lower.tolist()), tuple((upper - lower).tolist())

    def _place_mesh(self, points: np.ndarray, velocity: np.ndarray) -> None:
        """Moves the device's mesh to these points; its bounding volume hierarchy is built once and then refitted."""
        if self._mesh is not None:
            self._mesh.points.assign(points.astype(np.float32))
            self._mesh.velocities.assign(velocity.astype(np.float32))
            self._mesh.refit()
            return
        triangles = self._triangles[:, ::-1] if self._volume() < 0 else self._triangles
        self._mesh = wp.Mesh(
            self._launcher.array(points.astype(np.float32), self._label, wp.vec3),
            self._launcher.array(np.ascontiguousarray(triangles).ravel(), self._label),
            velocities=self._launcher.array(velocity.astype(np.float32), self._label, wp.vec3) if self.moves else None,
            support_winding_number=True,
        )

    def _volume(self) -> float:
        """Returns the volume by the divergence theorem [cells]; negative if the mesh is inside out."""
        a, b, c = (self._points[self._triangles[:, n]] - self._points.mean(axis=0) for n in range(3))
        return float(np.einsum("ni,ni", a, np.cross(b, c))) / 6.0

    def _far(self) -> float:
        """Returns a bound on the distance of the box's cells from the mesh [cells]."""
        return float(np.linalg.norm(np.ptp(self._points, axis=0))) + 2.0 * self._margin + 4.0

    def _motion(self, near: float) -> Motion:
        """Returns the motion in the form that kernels take.

        Args:
            near: distance within which a deforming mesh moves as its closest point does [cells]; unused if rigid.
        """
        centre, mean, gradient = self._mean_motion()
        motion = Motion()
        motion.near = near if self._prim.mesh.deforms else 0.0
        motion.centre, motion.mean, motion.gradient = wp.vec3(*centre), wp.vec3(*mean), wp.mat33(*gradient.ravel())
        return motion

    def _mean_motion(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Fits the overall motion: centre c of the points, their mean velocity, and its least-squares gradient G.

        The velocity at x is mean + G (x − c): exact for rigid motion.
        """
        points, velocity = self._points, self._point_velocity
        centre, mean = points.mean(axis=0), velocity.mean(axis=0)
        # The normal equations: the inverse of a 3 × 3 matrix costs nothing, however many points there are.
        offset = points - centre
        gradient = np.linalg.pinv(offset.T @ offset, rcond=1e-10, hermitian=True) @ (offset.T @ (velocity - mean))
        return centre, mean, gradient.T
