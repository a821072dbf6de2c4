"""Texel coverage against exact brute force: no hole, no double, border texels from the nearest point."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warp_smoke.geometry import Mesh
from warp_smoke.shading.uv_raster import cover_texels


def to_uvs(xy, size):
    """Corners in texels (x right, y down) as texture coordinates."""
    xy = np.asarray(xy, float) / size
    return np.stack([xy[..., 0], 1.0 - xy[..., 1]], axis=-1)


def points_seen(coverage, uvs, size):
    """Where on the picture each texel's weights lie, in texels (x right, y down), [n, 2]."""
    a, b, c = uvs[coverage.triangle].transpose(1, 0, 2)
    uv = a + coverage.weights[:, :1] * (b - a) + coverage.weights[:, 1:] * (c - a)
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1) * size


def centres(coverage, size):
    """Centres of the texels covered."""
    return np.stack([coverage.texel % size, coverage.texel // size], axis=1) + 0.5


@pytest.mark.parametrize("size", [1, 2, 7, 64])
@pytest.mark.parametrize("divisions", [1, 3, 8])
def test_full_square(size, divisions):
    """A patch over [0, 1]² has each texel once, seen at its centre exactly, also along the diagonals."""
    mesh = Mesh.grid((0, 0, 0), (1, 0, 0), (0, 0, -1), divisions)
    coverage = cover_texels(mesh.uvs, size)
    np.testing.assert_array_equal(coverage.texel, np.arange(size * size))
    assert coverage.overlapping == 0
    # Corners at thirds of a texel are rounded to 1/65536.
    np.testing.assert_allclose(points_seen(coverage, mesh.uvs, size), centres(coverage, size), atol=2**-15)


def test_rows_run_from_the_top():
    """A chart over the upper right quarter (u > ½, v > ½) fills the first rows and last columns, and nothing else."""
    square = np.array([[4, 0], [8, 0], [8, 4], [4, 4]])
    uvs = to_uvs([square[[0, 1, 2]], square[[0, 2, 3]]], 8)
    assert uvs.min() == 0.5
    coverage = cover_texels(uvs, 8)
    expected = (np.arange(4)[:, None] * 8 + np.arange(4, 8)).ravel()
    np.testing.assert_array_equal(coverage.texel, expected)


@st.composite
def partitions(draw):
    """A planar grid of triangles over the whole picture, corners on quarter texels, order and winding at random."""
    cells, size = draw(st.sampled_from([(1, 3), (2, 4), (3, 6), (4, 5)]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    at = np.stack(np.meshgrid(np.arange(cells + 1), np.arange(cells + 1), indexing="ij"), axis=-1) * (size / cells)
    reach = int(4 * size / cells / 3)  # a third of a cell keeps all triangles upright
    at[1:-1, 1:-1] += rng.integers(-reach, reach + 1, (cells - 1, cells - 1, 2)) / 4
    at = np.round(at * 4) / 4
    triangles = []
    for i in range(cells):
        for j in range(cells):
            a, b, c, d = at[i, j], at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]
            triangles += [(a, b, c), (a, c, d)] if rng.random() < 0.5 else [(a, b, d), (b, c, d)]
    triangles = [np.asarray(triangle)[rng.permutation(3)] for triangle in triangles]
    return np.asarray(triangles)[rng.permutation(len(triangles))], size


@settings(max_examples=60, deadline=None)
@given(partitions())
def test_no_holes_and_no_doubles(partition):
    """Every texel of a partitioned picture is found on exactly one triangle, though corners and edges hit centres."""
    corners, size = partition
    coverage = cover_texels(to_uvs(corners, size), size)
    np.testing.assert_array_equal(coverage.texel, np.arange(size * size))
    assert coverage.overlapping == 0
    assert np.all(coverage.weights >= 0)
    assert np.all(coverage.weights.sum(axis=1) <= 1)
    np.testing.assert_allclose(points_seen(coverage, to_uvs(corners, size), size), centres(coverage, size), atol=1e-9)


def clipped_area(triangle, column, row):
    """Area that a triangle shares with a texel's square, in exact fractions (Sutherland–Hodgman)."""
    polygon = [tuple(map(Fraction, corner)) for corner in triangle.tolist()]
    for axis, sign, bound in ((0, 1, column), (0, -1, column + 1), (1, 1, row), (1, -1, row + 1)):
        inside = [sign * (corner[axis] - bound) for corner in polygon]
        clipped = []
        for k, corner in enumerate(polygon):
            before = polygon[k - 1]
            if (inside[k] >= 0) != (inside[k - 1] >= 0):
                t = inside[k - 1] / (inside[k - 1] - inside[k])
                clipped.append(tuple(p + t * (q - p) for p, q in zip(before, corner, strict=True)))
            if inside[k] >= 0:
                clipped.append(corner)
        polygon = clipped
    twice = sum(p[0] * q[1] - p[1] * q[0] for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True))
    return abs(twice) / 2


def nearest_on_triangles(corners, point):
    """Distance from a point to the outlines of triangles, by 2,000 samples of each edge."""
    along = np.linspace(0, 1, 2001)[:, None]
    edges = [a + along * (b - a) for t in corners for a, b in zip(t, np.roll(t, -1, axis=0), strict=True)]
    return np.linalg.norm(np.concatenate(edges) - point, axis=1).min()


@settings(max_examples=40, deadline=None)
@given(st.lists(st.lists(st.tuples(st.integers(0, 24), st.integers(0, 24)), min_size=3, max_size=3), max_size=3))
def test_border_texels(triangles):
    """Covered is what shares area with a triangle; without its centre inside, it shows the nearest point of those."""
    size = 6
    corners = np.asarray(triangles, float).reshape(-1, 3, 2) / 4
    uvs = to_uvs(corners, size)
    coverage = cover_texels(uvs, size)
    touched = [
        row * size + column
        for row in range(size)
        for column in range(size)
        if any(clipped_area(triangle, column, row) > 0 for triangle in corners)
    ]
    np.testing.assert_array_equal(coverage.texel, touched)
    seen, middle = points_seen(coverage, uvs, size), centres(coverage, size)
    offset = np.linalg.norm(seen - middle, axis=1)
    for distance, centre in zip(offset, middle, strict=True):
        if distance > 1e-9:
            solid = [triangle for triangle in corners if clipped_area(triangle, *np.floor(centre).astype(int)) > 0]
            # Edges are up to 8.5 texels long, so their samples lie within 0.0022 of any point on them.
            assert distance == pytest.approx(nearest_on_triangles(solid, centre), abs=0.0022)


def test_overlap_is_counted():
    """Two charts on top of each other: each shared texel is counted once and shows the first triangle."""
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]])
    charts = np.array([square[[0, 1, 2]], square[[0, 2, 3]]])
    coverage = cover_texels(to_uvs(np.concatenate([charts, charts / 2]), 4), 4)
    assert coverage.overlapping == 4
    assert set(coverage.triangle) == {0, 1}


def test_mirrored_chart():
    """A mirrored chart covers the same texels, and sees the mirrored points of the surface."""
    uvs = Mesh.grid((0, 0, 0), (1, 0, 0), (0, 0, -1)).uvs
    mirrored = uvs * np.float32([-1, 1]) + np.float32([1, 0])
    coverage = cover_texels(mirrored, 16)
    np.testing.assert_array_equal(coverage.texel, np.arange(256))
    plain = points_seen(coverage, uvs, 16)
    np.testing.assert_allclose(plain, centres(coverage, 16) * (-1, 1) + (16, 0), atol=1e-6)


def test_no_area():
    """Triangles that are a line or a point in the texture cover nothing, nor do no triangles at all."""
    line = to_uvs([[[0, 0], [2, 2], [4, 4]], [[1, 1], [1, 1], [1, 1]]], 4)
    for uvs in (line, np.zeros((0, 3, 2))):
        coverage = cover_texels(uvs, 4)
        assert len(coverage.texel) == len(coverage.triangle) == len(coverage.weights) == coverage.overlapping == 0


def test_slivers_are_not_lost():
    """A chart thinner than a texel, between two rows of centres, still covers the row it runs through."""
    coverage = cover_texels(to_uvs([[[0, 2.6], [8, 2.6], [8, 2.7]]], 8), 8)
    np.testing.assert_array_equal(coverage.texel, 2 * 8 + np.arange(8))


@pytest.mark.slow  # for its 1.3 GB
def test_largest_texture():
    """Coordinates of a 16384² texture do not overflow: a triangle at its far corner covers the texels there."""
    size = 16384
    corners = np.array([[[size, size], [size - 3, size], [size, size - 3]]])
    big = np.concatenate([corners, [[[0, 0], [size, 0], [0, 1]]]])
    coverage = cover_texels(to_uvs(big, size), size)
    last = coverage.texel[coverage.triangle == 0]
    np.testing.assert_array_equal(size - 1 - last // size, [2, 1, 1, 0, 0, 0])
    assert np.count_nonzero(coverage.triangle == 1) == size
