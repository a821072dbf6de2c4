"""Which triangle each texel of a texture shows: exact, conservative rasterisation of a UV layout.

Corners are rounded to 1/65536 of a texel and all tests are in integers (after J. Pineda, "A Parallel Algorithm for
Polygon Rasterization", 1988), so triangles that share an edge leave no hole and cover no texel twice. Triangles are
split into rows, rows into spans: the cost is proportional to the texels covered, not to the triangles' boxes.
"""

from dataclasses import dataclass

import numpy as np

_STEPS = 1 << 16  # of a texel; products of two coordinates stay below 2⁶¹ for textures up to 16384²


@dataclass(frozen=True, eq=False)
class Coverage:
    """The texels of a square texture that show a surface.

    Attributes:
        texel: row · size + column, rows from the top, increasing, [n] int64.
        triangle: the triangle that the texel shows, [n] int64.
        weights: barycentric weights of that triangle's second and third corner, [n, 2] float64: at the texel's centre,
            or at the triangle's nearest point where the centre lies on none (a texel at the border of a chart).
        overlapping: number of texels whose centre lies on several triangles; they show the first.
    """

    texel: np.ndarray
    triangle: np.ndarray
    weights: np.ndarray
    overlapping: int


def cover_texels(uvs: np.ndarray, size: int) -> Coverage:
    """Finds every texel whose square overlaps a triangle.

    Args:
        uvs: texture coordinates at each corner, v up, within half a texel of [0, 1]², [m, 3, 2]. Triangles may be
            mirrored; those without area are left out.
        size: texels along a side, at most 16384.
    """
    uvs = np.asarray(uvs, np.float64)
    corners = np.rint(np.stack([uvs[..., 0], 1.0 - uvs[..., 1]], axis=2) * (size * _STEPS)).astype(np.int64)
    area = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    mirrored = area < 0
    corners[mirrored] = corners[mirrored][:, (0, 2, 1)]
    kept = np.flatnonzero(area)
    corners, area = corners[kept], np.abs(area[kept])

    shown = np.full(size * size, -1, np.int32)
    triangle, texel = _fill(*_rows_of_centres(corners, size), size)
    shown[texel[::-1]] = triangle[::-1]  # the last of several writes wins: the first triangle's
    overlapping = 0
    if len(texel) > np.count_nonzero(shown >= 0):
        overlapping = int(np.count_nonzero(np.unique_counts(texel).counts > 1))
    border, triangle, border_weights = _nearest_triangles(corners, shown, size)
    shown[border] = triangle

    texel = np.flatnonzero(shown >= 0)
    triangle = shown[texel]
    weights = _weights_at_centres(corners, area, triangle, texel, size)
    weights[np.searchsorted(texel, border)] = border_weights
    triangle = kept[triangle]
    turned_back = mirrored[triangle]
    weights[turned_back] = weights[turned_back, ::-1]
    return Coverage(texel, triangle, weights, overlapping)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _weights_at_centres(corners, area, triangle, texel, size: int) -> np.ndarray:
    """Returns the barycentric weights of the second and third corner at texel centres, [n, 2] float64."""
    row, column = np.divmod(texel, size)
    a, b, c = corners.transpose(1, 0, 2)
    weights = np.empty((len(texel), 2))
    for index, side in enumerate((c - a, a - b)):  # the cross product of (centre − a) and the side, over the area
        at_first = _cross(_STEPS // 2 - a, side)
        right, down = side[:, 1] * _STEPS, -side[:, 0] * _STEPS
        weights[:, index] = (at_first[triangle] + right[triangle] * column + down[triangle] * row) / area[triangle]
    return weights


def _expand(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the integers first…last of each item, as (item, number) pairs."""
    counts = np.maximum(last - first + 1, 0)
    item = np.repeat(np.arange(len(first)), counts)
    return item, np.arange(len(item)) + np.repeat(first - (np.cumsum(counts) - counts), counts)


def _fill(triangle, row, first, last, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns columns first…last of rows as (triangle, texel) pairs."""
    item, column = _expand(np.maximum(first, 0), np.minimum(last, size - 1))
    return triangle[item], row[item] * size + column


def _rows_of_centres(corners: np.ndarray, size: int):
    """Returns the triangle, row, first and last column of the texels whose centres lie in each triangle.

    A centre on an edge counts as moved by (−ε, +ε²), so that exactly one of the triangles around it contains it.
    """
    half = _STEPS // 2
    y = corners[..., 1]
    top, bottom = -((half - y.min(axis=1)) // _STEPS), (y.max(axis=1) - half) // _STEPS
    triangle, row = _expand(np.maximum(top, 0), np.minimum(bottom, size - 1))
    first, last = np.zeros(len(row), np.int64), np.full(len(row), size - 1)
    for corner in range(3):
        start = corners[:, corner]
        dx, dy = (corners[:, (corner + 1) % 3] - start).T
        # Inside the edge: dx (y − y₀) − dy (x − x₀) ≥ 0, or > 0 where the edge belongs to the neighbour.
        belongs = (dy > 0) | ((dy == 0) & (dx > 0))
        constant = dx * (half - start[:, 1]) - dy * (half - start[:, 0]) - np.where(belongs, 0, 1)
        room = (dx * _STEPS)[triangle] * row + constant[triangle]
        slope = dy[triangle] * _STEPS
        bound = room // np.where(slope == 0, 1, np.abs(slope))
        np.minimum(last, np.where(slope == 0, np.where(room < 0, -1, last), bound), out=last, where=slope >= 0)
        np.maximum(first, -bound, out=first, where=slope < 0)
    return triangle, row, first, last


def _rows_of_squares(corners: np.ndarray, size: int):
    """Returns the triangle, row, first and last column of the texels whose squares share area with each triangle."""
    y = corners[..., 1]
    top, bottom = y.min(axis=1) // _STEPS, -(-y.max(axis=1) // _STEPS) - 1
    triangle, row = _expand(np.maximum(top, 0), np.minimum(bottom, size - 1))
    first, last = np.full(len(row), size), np.full(len(row), -1)

    def reach(x, scale, where):
        """Widens the rows' spans to the points x/scale."""
        np.minimum(first, x // scale, out=first, where=where)
        np.maximum(last, -(-x // scale) - 1, out=last, where=where)

    # The widest points of a triangle within a row are its corners there and where its edges cross the row's two lines.
    for corner in range(3):
        start = corners[triangle, corner]
        dx, dy = (corners[triangle, (corner + 1) % 3] - start).T
        x, y = start.T
        reach(x, _STEPS, where=(y >= row * _STEPS) & (y <= (row + 1) * _STEPS))
        for line in (row * _STEPS, (row + 1) * _STEPS):
            crosses = (np.minimum(y, y + dy) < line) & (line < np.maximum(y, y + dy))
            fraction = np.sign(dy) * (x * dy + (line - y) * dx)
            reach(fraction, np.where(crosses, np.abs(dy), 1) * _STEPS, where=crosses)
    return triangle, row, first, last


def _nearest_triangles(corners: np.ndarray, shown: np.ndarray, size: int):
    """Returns texels not shown yet whose squares overlap triangles, with the nearest triangle and the weights there."""
    triangle, texel = _fill(*_rows_of_squares(corners, size), size)
    at_border = shown[texel] < 0
    triangle, texel = triangle[at_border], texel[at_border]
    centre = np.stack([texel % size + 0.5, texel // size + 0.5], axis=1) * _STEPS
    distance, weights = np.full(len(texel), np.inf), np.zeros((len(texel), 2))
    for corner in range(3):
        start = corners[triangle, corner]
        edge = corners[triangle, (corner + 1) % 3] - start
        along = np.sum((centre - start) * edge, axis=1) / np.maximum(np.sum(edge * edge, axis=1), 1)
        along = np.clip(along, 0.0, 1.0)
        to_edge = np.hypot(*(start + along[:, None] * edge - centre).T)
        weight = np.zeros((len(texel), 3))
        weight[:, corner], weight[:, (corner + 1) % 3] = 1.0 - along, along
        closer = to_edge < distance
        distance[closer], weights[closer] = to_edge[closer], weight[closer, 1:]
    nearest = np.lexsort((triangle, distance, texel))
    texel, first = np.unique(texel[nearest], return_index=True)
    return texel, triangle[nearest[first]], weights[nearest[first]]
