"""The suite of shading: every known order and closed form holds, and wrong shading is caught."""

import numpy as np
import pytest

from warp_smoke.geometry import normalized
from warp_smoke.study import relief, shading
from warp_smoke.study.measure import measure_case


@pytest.fixture(scope="module")
def rows(launcher):
    """All rows of the quick suite."""
    return [measure_case(launcher, case, 10.0) for case in shading.cases(full=False)]


def test_known_answers(rows):
    """Nothing fails, nothing is unexpected, no two cases are taken for one."""
    assert [row.failure for row in rows] == [None] * len(rows)
    assert shading.unexpected(rows) == []
    assert len({row.key for row in rows}) == len(rows)
    slopes = shading.order(rows)
    for line in (
        (shading.NORMALS, "from heights"),
        (shading.HIGHLIGHT, "each pixel"),
        ("albedo, exponent 64", "blinnPhong"),
    ):
        assert slopes[line] == pytest.approx(2.0, abs=0.1)


def test_parallax_follows_the_relief(rows):
    """Offsets get worse the flatter the view, marching does not; both are nearer than nothing."""
    missed = {
        (r.method, r.parameters["degrees"]): r.errors["relative_l2"] for r in rows if r.problem == shading.PARALLAX
    }
    offset = [missed["offset", degrees] for degrees in (20, 40, 60, 75)]
    assert offset == sorted(offset)
    assert offset[0] < 0.1 < 0.5 < offset[-1] < 1.0
    assert max(missed["occlusion", degrees] for degrees in (20, 40, 60, 75)) < 0.01


def test_what_is_said(rows):
    """Two sentences, with figures of the rows."""
    text = shading.explain(rows)
    assert text.count(". ") == 1
    assert "light at each vertex is 11 % off and at each pixel 1.5 %" in text
    assert shading.explain([]).endswith("further left is faster.")


def forward_differences(heights, width, height):
    """Normals by one-sided differences, of first order."""
    rows, columns = heights.shape
    along_x = (np.roll(heights, -1, 1) - heights) * columns / width
    along_y = (np.roll(heights, 1, 0) - heights) * rows / height
    return normalized(np.stack([-along_x, -along_y, np.ones_like(heights)], axis=2))


def test_a_first_order_normal_map_is_caught(launcher, monkeypatch):
    """One-sided differences converge at order 1."""
    monkeypatch.setattr(relief, "height_normals", forward_differences)
    chosen = [case for case in shading.cases(full=False) if case.method == "from heights"]
    found = shading.unexpected([measure_case(launcher, case, 10.0) for case in chosen])
    assert len(found) == 1
    assert "from heights: order 1.0" in found[0]


def test_light_at_vertices_that_passes_for_pixels_is_caught(launcher, monkeypatch):
    """Interpolated light under the name of each pixel's is no nearer than light at each vertex."""
    monkeypatch.setattr(shading, "measure_pixels", shading.measure_vertices)
    chosen = [case for case in shading.cases(full=False) if case.problem == shading.HIGHLIGHT]
    found = shading.unexpected([measure_case(launcher, case, 10.0) for case in chosen])
    assert any("no nearer than light at each vertex" in line for line in found)


def test_marching_that_stops_at_once_is_caught(launcher, monkeypatch):
    """Offset parallax under the name of marched heights is off by more than a tenth of the shift."""
    measure = shading.measure_parallax
    monkeypatch.setattr(shading, "measure_parallax", lambda _, *args: measure("offset", *args))
    chosen = [case for case in shading.cases(full=False) if case.method == "occlusion"]
    found = shading.unexpected([measure_case(launcher, case, 10.0) for case in chosen])
    assert any("marched heights are within a tenth" in line for line in found)
