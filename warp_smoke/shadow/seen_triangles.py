"""Triangles as a light sees them: which of a tile's few triangles a ray hits, without a hierarchy.

Rasterisation with homogeneous edge functions (Olano and Greer, "Triangle Scan Conversion Using 2D Homogeneous
Coordinates", 1997). A *place* is the direction of a ray from a point light, or (s, t, 1) on the map of a distant one.
The places that a triangle covers lie between three planes through the origin, and the nearness of the triangle's own
plane is linear in the place: 1 / distance, or (far − depth) / (far − near). So a triangle costs a ray four dot
products. Neighbours share the plane through a side.
"""

import numpy as np
import warp as wp

from warp_smoke.shadow.bias import round_off

wp.set_module_options({"enable_backward": False})

# Rows, whose products with a place are its distance inside each side, and the nearness.
Planes = wp.types.matrix(shape=(4, 3), dtype=float)


@wp.struct
class SeenTriangles:
    """Triangles around a light.

    Attributes:
        planes: of those that are seen, [n].
        count: n.
        rounding: how far outside a plane a ray still hits the triangle: more than rounding moves it, so that none slips
            between neighbours or through a corner where many meet.
        listed: the number of triangles that rays of a tile may hit, −1 for more than fit, and their indices, one tile
            per row, [tiles, 1 + `coverage.TRIANGLES_IN_TILE`]; no rows where the scene has too many triangles.
    """

    planes: wp.array[Planes]
    count: int
    rounding: float
    listed: wp.array2d[int]


@wp.func
def covers(seen: SeenTriangles, triangle: int, place: wp.vec3, reach: float):
    """Whether a triangle covers a place, or may cover one within `reach` of it."""
    v = seen.planes[triangle] * place
    return wp.min(wp.min(v[0], v[1]), v[2]) >= -reach - seen.rounding


@wp.func
def is_listed(seen: SeenTriangles, tile: int):
    """Whether a tile's list holds all triangles that its rays may hit."""
    found = wp.bool(False)
    if tile < seen.listed.shape[0]:
        found = seen.listed[tile, 0] >= 0
    return found


@wp.func
def greatest_nearness(seen: SeenTriangles, tile: int, place: wp.vec3, most: float):
    """The greatest nearness, up to `most`, of a tile's triangles that cover a place; 0 for none."""
    nearest = wp.float32(0.0)
    for k in range(1, seen.listed[tile, 0] + 1):
        v = seen.planes[seen.listed[tile, k]] * place
        if wp.min(wp.min(v[0], v[1]), v[2]) >= -seen.rounding and v[3] <= most:
            nearest = wp.max(nearest, v[3])
    return nearest


def planes_from_point(triangles: np.ndarray, position: np.ndarray, slack: float, cull_front: bool) -> np.ndarray:
    """Returns planes of the triangles that are seen from a point, [n, 4, 3] float32; nearness is 1 / distance.

    Triangles whose plane is within `slack` of the point are seen edge-on, and hide nothing.

    Args:
        triangles: corners, front faces counter-clockwise, [m, 3, 3].
        position: the point, [3].
        slack: distance from a plane up to which the point counts as on it.
        cull_front: leaves out triangles whose front is seen.
    """
    corners = triangles.astype(np.float64) - position
    own = _normals(corners)
    ahead = np.sum(own * corners[:, 0], axis=1)
    kept = (ahead if cull_front else np.abs(ahead)) > slack
    return _planes(corners[kept], own[kept] / ahead[kept, None], np.sign(ahead[kept]), 3)


def planes_from_afar(triangles: np.ndarray, frame: np.ndarray, near: float, far: float, cull_front: bool) -> np.ndarray:
    """Returns planes of the triangles seen by a distant light, [n, 4, 3] float32; nearness (far − depth)/(far − near).

    Args:
        triangles: corners, front faces counter-clockwise, [m, 3, 3].
        frame: axes s, t and the light's direction, one per row, [3, 3].
        near: depth of nearness 1.
        far: depth of nearness 0.
        cull_front: leaves out triangles whose front is seen.
    """
    local = triangles.astype(np.float64) @ frame.T
    own = _normals(local)
    kept = (own[:, 2] if cull_front else np.abs(own[:, 2])) > round_off(1.0)
    local, own = local[kept], own[kept]
    slopes = -own[:, :2] / own[:, 2:]
    depth = local[:, 0, 2] - np.sum(slopes * local[:, 0, :2], axis=1)
    nearness = np.column_stack([-slopes, far - depth]) / (far - near)
    places = np.concatenate([local[:, :, :2], np.ones((len(local), 3, 1))], axis=2)
    return _planes(places, nearness, np.sign(own[:, 2]), 2)


def _planes(corners: np.ndarray, nearness: np.ndarray, turned: np.ndarray, dimensions: int) -> np.ndarray:
    """Computes the rows of `Planes`.

    Args:
        corners: places of the corners, [n, 3, 3].
        nearness: the last row, [n, 3].
        turned: −1 where corners run clockwise, else 1.
        dimensions: number of components of a side that are normalized, so that distances from it are measured in them.
    """
    sides = [np.cross(corners[:, i], corners[:, j]) * turned[:, None] for i, j in ((0, 1), (1, 2), (2, 0))]
    lengths = [np.linalg.norm(side[:, :dimensions], axis=1, keepdims=True) for side in sides]
    sides = [side / np.maximum(length, 1e-300) for side, length in zip(sides, lengths, strict=True)]
    return np.stack([*sides, nearness], axis=1).astype(np.float32)


def _normals(corners: np.ndarray) -> np.ndarray:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
