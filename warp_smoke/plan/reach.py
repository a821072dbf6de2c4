"""Conservative tests for the plan of what can touch, reach or shadow what, on bounds over all frames."""

from itertools import combinations

import numpy as np

from warp_smoke.geometry import Points, transform_points
from warp_smoke.lattice import Lattice
from warp_smoke.record import Samples, each_value
from warp_smoke.scene import DistantLight, Light, Prim, SpotLight

# The most points for which every separating axis is tried, in 30 ms; for more, a linear program (0.3 s to import).
_MOST_FOR_AXES = 48
# Smallest gap that counts, relative to the size of the scene: more than round-off.
_GAP = 1e-9
_CORNERS = np.array([[i, j, k] for i in (0.0, 1.0) for j in (0.0, 1.0) for k in (0.0, 1.0)])


def swept_corners(prim: Prim, frames: range) -> np.ndarray:
    """Returns the world corners of a shape's local bounds at every frame, [8 t, 3] float64; none without points."""
    points = each_value(prim.mesh.points).reshape(-1, 3)
    if not len(points):
        return np.zeros((0, 3))
    radius = each_value(prim.mesh.widths).max() / 2.0 if isinstance(prim.mesh, Points) else 0.0
    lower, upper = points.min(axis=0).astype(float) - radius, points.max(axis=0).astype(float) + radius
    corners = lower + _CORNERS * (upper - lower)
    return np.concatenate([transform_points(matrix, corners) for matrix in _transforms(prim, frames)])


def box_corners(lattice: Lattice) -> np.ndarray:
    """Returns the world corners of a lattice's box, [8, 3]."""
    return transform_points(lattice.cells_to_world(), _CORNERS * lattice.shape)


def is_moving(*prims: Prim) -> bool:
    """Returns whether any of the prims moves or deforms."""
    return any(prim.moves or (hasattr(prim, "mesh") and prim.mesh.deforms) for prim in prims)


def is_flat(prim: Prim) -> bool:
    """Returns whether all points of a mesh always lie in one plane, so that it cannot shadow itself."""
    if prim.mesh.deforms:
        return False
    points = each_value(prim.mesh.points)[0].astype(np.float64)
    if len(points) < 4:
        return True
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[2] <= 1e-6 * spread[0])


def over(value: object, frames: range) -> np.ndarray:
    """Returns a field's values at every frame and at the samples in between, or its one value if it has no samples."""
    if not isinstance(value, Samples):
        return np.asarray(value)
    return np.array([value.at(time) for time in times_in(value, frames)])


def in_box(lattice: Lattice, points: np.ndarray, margin: float = 0.0) -> bool:
    """Returns whether the hull of world points [n, 3] meets a lattice's box, shrunk on each side by `margin` cells."""
    if not len(points):
        return False
    cells = transform_points(lattice.world_to_cells(), points)
    return _hull_meets_box(cells, np.full(3, margin), np.asarray(lattice.shape, float) - margin)


def may_touch(lattice: Lattice, points: np.ndarray) -> bool:
    """Returns whether the hull of world points [n, 3], or an image of it along periodic axes, meets a lattice's box."""
    if not len(points):
        return False
    cells = transform_points(lattice.world_to_cells(), points)
    for axis, side in enumerate(lattice.sides[0::2]):
        if side == "periodic":  # images repeat along the axis, so the test there always passes
            cells[:, axis] = lattice.shape[axis] / 2
    return _hull_meets_box(cells, np.zeros(3), np.asarray(lattice.shape, float))


def in_range(light: Light, points: np.ndarray, frames: range) -> bool:
    """Returns whether the bounds of world points [n, 3] come within a light's falloff end at any frame."""
    if isinstance(light, DistantLight) or light.falloff_end is None:
        return True
    positions = np.array([matrix[3, :3] for matrix in _transforms(light, frames)])
    lower, upper = points.min(axis=0), points.max(axis=0)
    nearest = np.clip(positions, lower, upper)
    return bool(np.any(np.linalg.norm(positions - nearest, axis=1) < light.falloff_end))


def may_shadow(light: Light, blocker: np.ndarray, receiver: np.ndarray, frames: range) -> bool:
    """Returns whether anything in a blocker's bounds may lie between a light and a receiver, at any frame.

    The hull of the light and the receiver, over all frames together and so never too small, is tested against the
    blocker's bounding box, and so is a spot light's cone.

    Args:
        light: the light.
        blocker: world points whose box blocks light, [n, 3].
        receiver: world points whose hull receives it, [m, 3].
        frames: the frames to consider.
    """
    if not len(blocker) or not len(receiver):
        return False
    lower, upper = blocker.min(axis=0), blocker.max(axis=0)
    matrices = _transforms(light, frames)
    if isinstance(light, DistantLight):
        reach = np.linalg.norm(np.maximum(upper, receiver.max(axis=0)) - np.minimum(lower, receiver.min(axis=0)))
        directions = np.array([-matrix[2, :3] / np.linalg.norm(matrix[2, :3]) for matrix in matrices])
        lit_from = np.concatenate([receiver - reach * direction for direction in np.unique(directions, axis=0)])
    else:
        lit_from = np.unique(np.array([matrix[3, :3] for matrix in matrices]), axis=0)
    if isinstance(light, SpotLight) and not _cone_meets(light, matrices, lower, upper):
        return False
    return _hull_meets_box(np.concatenate([receiver, lit_from]), lower, upper)


def _cone_meets(light: SpotLight, matrices: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> bool:
    """Returns whether the bounding sphere of a box meets a spot light's cone at any frame."""
    centre, radius = (lower + upper) / 2, np.linalg.norm(upper - lower) / 2
    for matrix in matrices:
        offset = centre - matrix[3, :3]
        distance = np.linalg.norm(offset)
        if distance <= radius:
            return True
        axis = -matrix[2, :3] / np.linalg.norm(matrix[2, :3])
        angle = np.arccos(np.clip(offset @ axis / distance, -1.0, 1.0))
        if angle <= np.radians(light.cone_angle) + np.arcsin(radius / distance):
            return True
    return False


def _transforms(prim: Prim, frames: range) -> np.ndarray:
    """Returns a prim's transforms at every frame and at the samples in between, [t, 4, 4]; one if it has no samples."""
    if not isinstance(prim.transform, Samples):
        return prim.transform[None]
    return np.array([prim.transform_at(time) for time in times_in(prim.transform, frames)])


def times_in(samples: Samples, frames: range) -> np.ndarray:
    """Returns every frame, and the times of the samples in between."""
    between = samples.times[(samples.times > frames[0]) & (samples.times < frames[-1])]
    return np.union1d(np.asarray(frames, float), between)


def _hull_meets_box(points: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> bool:
    """Returns whether the convex hull of points [n, 3] meets a box; touching counts as meeting."""
    if np.any(points.max(axis=0) < lower) or np.any(points.min(axis=0) > upper):
        return False
    if np.any(np.all((points >= lower) & (points <= upper), axis=1)):
        return True
    centre = (lower + upper) / 2
    scale = max(np.abs(points - centre).max(), 1e-30)  # scales to about 1, for absolute tolerances
    p, low, high = ((a - centre) / scale for a in (np.unique(points, axis=0), lower, upper))
    return not _any_axis_separates(p, high) if len(p) <= _MOST_FOR_AXES else _program_is_feasible(p, low, high)


def _any_axis_separates(points: np.ndarray, half: np.ndarray) -> bool:
    """Returns whether a plane separates the hull of points [n, 3] from the box −half to half.

    By the separating axis theorem, if there is such a plane, one is normal to one of these: an axis of the box (already
    tested with the bounds), a normal of three of the points, or the cross product of an axis and the line through two.
    """
    i, j = np.triu_indices(len(points), 1)
    edges = np.unique(points[j] - points[i], axis=0)
    a, b, c = points[np.array(list(combinations(range(len(points)), 3)), int).reshape(-1, 3).T]
    axes = np.concatenate([np.cross(b - a, c - a), *(np.cross(edges, axis) for axis in np.eye(3))])
    length = np.linalg.norm(axes, axis=1)
    axes = axes[length > 0.0] / length[length > 0.0, None]
    along, reach = axes @ points.T, np.abs(axes) @ half
    return bool(np.any((along.min(axis=1) > reach + _GAP) | (along.max(axis=1) < -reach - _GAP)))


def _program_is_feasible(points: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> bool:
    """Returns whether there are λ ≥ 0, Σλ = 1 with lower ≤ λ · points ≤ upper: whether hull and box meet."""
    from scipy.optimize import linprog  # takes 0.3 s to import

    answer = linprog(
        np.zeros(len(points)),
        A_ub=np.concatenate([points.T, -points.T]),
        b_ub=np.concatenate([upper, -lower]),
        A_eq=np.ones((1, len(points))),
        b_eq=[1.0],
    )
    return answer.status != 2  # 2 = proven infeasible; anything else counts as meeting
