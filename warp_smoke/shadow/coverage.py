"""Which tiles of a depth map can hold a shadow: those over which both a caster and a receiver may lie.

Everything is bounded by axis-aligned boxes in set space. Seen from a point, the box [x₀, x₁] × … spans on the plane
z = 1 exactly the slopes between min x/z and max x/z over its corners in front. Rectangles are given as
(lower s, upper s, lower t, upper t) with the map's sides at −1 and 1; lower > upper means none.
"""

from itertools import product

import numpy as np

# Rays of a tile of 8 × 8 texels pass through the same part of the hierarchy.
TILE = 8

# A tile lists the triangles that its rays may hit if there are at most this many, in scenes of at most this many: it is
# then faster to test them all than to traverse the hierarchy.
TRIANGLES_IN_TILE = 15
TRIANGLES_IN_LISTS = 1024

# Texels along a side of the caster mask where there is no depth map.
MASK_SIZE = 512

# Axes of each face of a cube map: s to the right, t down, and viewing direction; OpenGL's order and orientation.
CUBE_FRAMES = np.array(
    [
        [[0, 0, -1], [0, -1, 0], [1, 0, 0]],
        [[0, 0, 1], [0, -1, 0], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
        [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
    ],
    np.float64,
)
FACE_NAMES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")
# Half angle of the widest cone that one map serves [degrees]: beyond it, texels in the middle are more than 1.7 times
# as wide as those of a cube map.
WIDEST_CONE = 60.0
# Cells along each axis of the grid that sorts a surface's triangles: a thousand boxes follow a silhouette well.
_PATCHES_ALONG = 16
_CORNERS = np.array(list(product((0, 1), repeat=3)))
_NONE = np.array([1.0, -1.0, 1.0, -1.0])
_ALL = np.array([-1.0, 1.0, -1.0, 1.0])


def frame_along(direction: np.ndarray) -> np.ndarray:
    """Returns right-handed unit axes s, t and the direction itself, one per row, [3, 3]."""
    s_axis = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    s_axis /= np.linalg.norm(s_axis)
    return np.stack([s_axis, np.cross(direction, s_axis), direction])


def box_corners(boxes: np.ndarray) -> np.ndarray:
    """Returns the corners of boxes [n, 2, 3], as [n, 8, 3]."""
    return np.where(_CORNERS[None], boxes[:, 1, None], boxes[:, 0, None])


def cube_rectangles(boxes: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Returns the rectangles that boxes [n, 2, 3] fill on the faces of a cube map around a point, [n, 6, 4]."""
    found = np.empty((len(boxes), 6, 4))
    for face, frame in enumerate(CUBE_FRAMES):
        ends = (np.asarray(boxes, np.float64) - position) @ frame.T
        lower, upper = ends.min(axis=1), ends.max(axis=1)
        nearest, farthest = np.maximum(lower[:, 2:], 1e-300), np.maximum(upper[:, 2:], 1e-300)
        with np.errstate(over="ignore"):
            low = lower[:, :2] / np.where(lower[:, :2] < 0.0, nearest, farthest)
            high = upper[:, :2] / np.where(upper[:, :2] > 0.0, nearest, farthest)
        found[:, face] = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1)
        found[upper[:, 2] <= 0.0, face] = _NONE
    return found


def cone_rectangles(boxes: np.ndarray, position: np.ndarray, frame: np.ndarray, tangent: float) -> np.ndarray:
    """Returns the rectangles of boxes on one perspective map, [n, 1, 4].

    Args:
        boxes: [n, 2, 3].
        position: of the light.
        frame: unit axes s, t and viewing direction, one per row, [3, 3].
        tangent: of the angle between the viewing direction and the middle of a side.
    """
    local = (box_corners(boxes) - position) @ frame.T
    ahead = local[..., 2] > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        st = local[..., :2] / (tangent * local[..., 2:])
    found = np.stack([st[..., 0].min(1), st[..., 0].max(1), st[..., 1].min(1), st[..., 1].max(1)], axis=1)
    found[~ahead.all(axis=1)] = _ALL
    found[~ahead.any(axis=1)] = _NONE
    return found[:, None]


def flat_rectangles(boxes: np.ndarray, frame: np.ndarray, corner: np.ndarray, width: float) -> np.ndarray:
    """Returns the rectangles of boxes on an orthographic map, [n, 1, 4].

    Args:
        boxes: [n, 2, 3].
        frame: unit axes s, t and the direction, one per row, [3, 3].
        corner: s and t of the map's upper left corner.
        width: of the map.
    """
    st = 2.0 * (box_corners(boxes) @ frame[:2].T - corner) / width - 1.0
    lower, upper = st.min(axis=1), st.max(axis=1)
    return np.stack([lower[:, 0], upper[:, 0], lower[:, 1], upper[:, 1]], axis=1)[:, None]


def covered_tiles(rectangles: np.ndarray, size: int) -> np.ndarray:
    """Returns which tiles of each face any of the rectangles [n, faces, 4] may touch, [faces, rows, columns] bool.

    Rectangles are grown by a texel on each side to absorb rounding.
    """
    count = -(-size // TILE)
    margin = 2.0 / size
    outward = np.array([-margin, margin, -margin, margin])
    grown = np.where(rectangles[..., :1] > rectangles[..., 1:2], _NONE, rectangles + outward)
    seen = (grown[..., 0] <= 1.0) & (grown[..., 1] >= -1.0) & (grown[..., 2] <= 1.0) & (grown[..., 3] >= -1.0)
    seen &= grown[..., 0] <= grown[..., 1]
    index = np.floor((np.clip(grown, -1.0, 1.0) + 1.0) * (0.5 * size / TILE)).astype(int).clip(0, count - 1)
    box, face = np.nonzero(seen)
    left, right, top, bottom = index[box, face].T
    # Each rectangle becomes four steps, whose running sums along rows and columns count the rectangles on each tile.
    steps = np.zeros((rectangles.shape[1], count + 1, count + 1), int)
    for row, column, step in ((top, left, 1), (top, right + 1, -1), (bottom + 1, left, -1), (bottom + 1, right + 1, 1)):
        np.add.at(steps, (face, row, column), step)
    return steps.cumsum(axis=1).cumsum(axis=2)[:, :count, :count] > 0


def patches_of(triangles: np.ndarray, owners: np.ndarray) -> np.ndarray:
    """Sorts triangles into patches with tight bounding boxes: cells of a coarse grid over each surface.

    Args:
        triangles: corners, [m, 3, 3].
        owners: surface index of each triangle, [m], ascending.

    Returns:
        Patch number of each triangle, [m]; patches of a surface follow those of the surfaces before it.
    """
    patches = np.zeros(len(triangles), np.int64)
    for owner in np.unique(owners):
        first, end = np.searchsorted(owners, (owner, owner + 1))
        middles = triangles[first:end].mean(axis=1)
        lower, upper = middles.min(axis=0), middles.max(axis=0)
        cells = (middles - lower) * (_PATCHES_ALONG / np.maximum(upper - lower, 1e-30))
        cells = np.minimum(cells.astype(np.int64), _PATCHES_ALONG - 1)
        patches[first:end] = owner * _PATCHES_ALONG**3 + np.ravel_multi_index(cells.T, (_PATCHES_ALONG,) * 3)
    return patches


def casting_boxes(
    triangles: np.ndarray, owners: np.ndarray, receivers: np.ndarray, light: np.ndarray, slack: float
) -> np.ndarray:
    """Returns bounds of what may shadow the receivers, a box for each group of such triangles, [n, 2, 3].

    A triangle shadows nothing if no receiver lies behind its plane, as with the walls of a room and the ground under
    it.

    Args:
        triangles: corners, [m, 3, 3].
        owners: group number of each triangle, [m], ascending.
        receivers: boxes of the receivers, [r, 2, 3].
        light: position and 1, or the direction towards the light and 0, [4].
        slack: distance from a plane up to which a point counts as on it.
    """
    if not len(owners):
        return np.zeros((0, 2, 3))
    corner = triangles[:, 0].astype(np.float64)
    normal = np.cross(triangles[:, 1] - corner, triangles[:, 2] - corner)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    offset = np.sum(normal * corner, axis=1)
    lit_side = normal @ light[:3] - light[3] * offset
    lower, upper = receivers[:, 0].min(axis=0), receivers[:, 1].max(axis=0)
    middle = normal @ (0.5 * (lower + upper)) - offset
    reach = np.abs(normal) @ (0.5 * (upper - lower))
    casts = np.where(lit_side >= 0.0, middle - reach < -slack, False)
    casts |= np.where(lit_side <= 0.0, middle + reach > slack, False)
    casting = triangles[casts]
    if not len(casting):
        return np.zeros((0, 2, 3))
    first = np.flatnonzero(np.diff(owners[casts], prepend=-1))
    lowest = np.minimum.reduceat(casting.min(axis=1), first)
    highest = np.maximum.reduceat(casting.max(axis=1), first)
    return np.stack([lowest, highest], axis=1).astype(np.float64)


def nearest_distance(boxes: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Returns the distance of each box [n, 2, 3] from a point, [n]."""
    return np.linalg.norm(np.clip(position, boxes[:, 0], boxes[:, 1]) - position, axis=1)


def tile_lists(faces: int, size: int, triangles: int) -> tuple[int, int]:
    """Returns the shape of a map's triangle lists: tiles (0 for too many triangles) and entries per tile."""
    tiles = faces * (-(-size // TILE)) ** 2
    return (tiles if triangles <= TRIANGLES_IN_LISTS else 0), 1 + TRIANGLES_IN_TILE


def launch_size(tiles: int) -> int:
    """Rounds a number of tiles up to one of a few values, since launches are recorded by their size."""
    step = max(1, 2 ** (tiles.bit_length() - 4))
    return -(-tiles // step) * step
