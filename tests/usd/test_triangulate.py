import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from warp_smoke.usd.triangulate import clip_ears, triangulate


def area_of(points, triangles):
    """Signed area seen from +z of triangles over points in the xy plane."""
    a, b, c = (points[triangles[:, k], :2] for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def test_triangles_stay_as_they_are():
    """A mesh of triangles comes back with its corners in the same order."""
    indices = np.array([2, 0, 1, 1, 3, 2])
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    corners, polygon = triangulate(points, np.array([3, 3]), indices)
    assert np.array_equal(corners, [[0, 1, 2], [3, 4, 5]])
    assert np.array_equal(polygon, [0, 1])


def test_mixed_polygons():
    """Convex polygons become fans, faces without area to speak of (one or two corners) are left out."""
    turn = 2 * np.pi * np.arange(5) / 5
    points = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    corners, polygon = triangulate(points, np.array([5, 2, 1, 0, 4]), np.array([0, 1, 2, 3, 4, 0, 1, 3, 0, 1, 2, 3]))
    assert np.array_equal(corners, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [8, 9, 10], [8, 10, 11]])
    assert np.array_equal(polygon, [0, 0, 0, 4, 4])


def test_arrow_is_cut_inside_its_outline():
    """A quad with a dent, for which the fan from its first corner would leave the outline."""
    points = np.array([[0, 0, 0], [2, 1, 0], [0, 2, 0], [1.0, 1, 0]])
    for start in range(4):
        indices = np.roll(np.arange(4), start)
        corners, _ = triangulate(points, np.array([4]), indices)
        area = area_of(points, indices[corners])
        assert np.all(area > 0)
        assert area.sum() == 1.0


def test_keeps_winding_in_any_plane():
    """A dented polygon tilted in space: every triangle faces the way the polygon does."""
    flat = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [2, 1, 0], [0, 4, 0.0]])
    tilt = np.linalg.qr(np.array([[1.0, 2, 3], [0, 1, 4], [5, 6, 0]]))[0]
    points = flat @ tilt + 1000.0
    for order in (np.arange(5), np.arange(5)[::-1]):
        corners, _ = triangulate(points, np.array([5]), order)
        p = points[order[corners]]
        normals = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        side = np.sign(np.linalg.det(tilt)) * (1 if order[0] == 0 else -1)
        assert np.all(normals @ tilt[2] * side > 0)
        assert np.isclose(np.abs(normals @ tilt[2]).sum() / 2, 10.0)


@given(st.lists(st.integers(1, 1000), min_size=4, max_size=24), st.integers(0, 23))
def test_star_shaped_polygons(radii, start):
    """A polygon around a centre with any radii is cut into n − 2 triangles of its area, none turned over."""
    turn = 2 * np.pi * np.arange(len(radii)) / len(radii)
    polygon = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1) * np.array(radii)[:, None]
    polygon = np.roll(polygon, start, axis=0)
    triangles = clip_ears(polygon)
    x, y = polygon[:, 0], polygon[:, 1]
    whole = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    area = area_of(polygon, triangles)
    assert len(triangles) == len(radii) - 2
    assert np.all(area >= 0)
    assert np.isclose(area.sum(), whole)


def test_crossing_outline_still_gives_triangles():
    """A bow tie has no inside to speak of; it gives n − 2 triangles and no error."""
    bow = np.array([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0.0]])
    assert clip_ears(bow).shape == (2, 3)
