"""Triangulation of polygons: fans for convex ones, ear clipping (Meisters, 1975) for the rest."""

import numpy as np

# Corners that turn the wrong way by less than this fraction of the polygon's area count as straight.
STRAIGHT = 1e-6


def triangulate(points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Splits polygons into triangles of the same winding.

    Args:
        points: [n, 3].
        counts: number of corners of each polygon, [p]; polygons with fewer than three are left out.
        indices: the corners' points, polygon after polygon, [c].

    Returns:
        The corners of each triangle, [m, 3] into `indices`, and its polygon, [m]; in the order of the polygons.
    """
    counts = np.asarray(counts, np.int64)
    first = np.cumsum(counts) - counts
    per_polygon = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), per_polygon)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(per_polygon) - per_polygon, per_polygon)
    corners = first[polygon, None] + np.stack([np.zeros_like(step), step + 1, step + 2], axis=1)

    start = np.cumsum(per_polygon) - per_polygon
    for p in _not_convex(points, counts, indices):
        ears = clip_ears(points[indices[first[p] : first[p] + counts[p]]])
        corners[start[p] : start[p] + per_polygon[p]] = first[p] + ears
    return corners, polygon


def _not_convex(points: np.ndarray, counts: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """Returns the polygons of more than three corners that turn both ways."""
    many = np.repeat(counts > 3, counts)
    polygon = np.repeat(np.arange(len(counts)), counts)[many]
    if not len(polygon):
        return polygon
    corner = np.flatnonzero(many)
    first = np.cumsum(counts) - counts
    place = corner - first[polygon]
    after = first[polygon] + (place + 1) % counts[polygon]
    before = first[polygon] + (place - 1) % counts[polygon]
    here = np.asarray(points, np.float64)[indices[corner]]
    ahead = points[indices[after]] - here
    behind = here - points[indices[before]]
    # Twice the area, from corners relative to the polygon's first, so that far-away polygons do not lose digits.
    base = points[indices[first[polygon]]]
    area = np.zeros((len(counts), 3))
    np.add.at(area, polygon, np.cross(here - base, here + ahead - base))
    size = np.linalg.norm(area, axis=1)[polygon]
    turn = np.einsum("ij,ij->i", np.cross(behind, ahead), area[polygon])
    return np.unique(polygon[turn < -STRAIGHT * size**2])


def clip_ears(polygon: np.ndarray) -> np.ndarray:
    """Splits a simple polygon, not necessarily convex, into triangles.

    Args:
        polygon: corners [n, 3], approximately in a plane.

    Returns:
        Triangles [n − 2, 3] into the corners. If no ear is found (the outline crosses itself), the rest is a fan.
    """
    flat = _flattened(np.asarray(polygon, np.float64))
    left = list(range(len(flat)))
    triangles = []
    while len(left) > 3:
        ear = next((k for k in range(len(left)) if _is_ear(flat, left, k)), None)
        if ear is None:
            triangles += [[left[0], left[k], left[k + 1]] for k in range(1, len(left) - 2)]
            left = [left[0], left[-2], left[-1]]
            break
        triangles.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
    return np.array([*triangles, left])


def _flattened(polygon: np.ndarray) -> np.ndarray:
    """Returns the polygon projected along its normal's main axis, [n, 2], counter-clockwise."""
    relative = polygon - polygon[0]
    normal = np.cross(relative, np.roll(relative, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    kept = [(axis + 1) % 3, (axis + 2) % 3]
    return relative[:, kept] if normal[axis] > 0 else relative[:, kept[::-1]]


def _is_ear(flat: np.ndarray, left: list[int], k: int) -> bool:
    """Returns whether corner k turns left and no other corner lies in the triangle it makes with its neighbours."""
    a, b, c = (flat[left[n % len(left)]] for n in (k - 1, k, k + 1))
    if _turn(a, b, c) <= 0:
        return False
    others = flat[[left[n % len(left)] for n in range(k + 2, k + len(left) - 1)]]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    # Outlines with a slit pass through a point twice: points equal to the ear's corners do not count.
    inside &= ~np.any([np.all(others == corner, axis=1) for corner in (a, b, c)], axis=0)
    return not inside.any()


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Returns twice the signed area of the triangle a b c."""
    return (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])
