"""The suite of surface shadows: closed forms hold, errors are areas, and wrong maps are caught."""

from types import SimpleNamespace

import numpy as np
import pytest

from warp_smoke.shadow.cube import CubeShadow
from warp_smoke.study import surface_shadow
from warp_smoke.study.measure import measure_case


def rows_of(launcher, problem, method, sizes):
    """The suite's rows of a problem and method, at some resolutions or numbers of rays."""
    chosen = [case for case in surface_shadow.cases(full=False) if (case.problem, case.method) == (problem, method)]
    return [
        measure_case(launcher, case, 10.0) for case in chosen if case.parameters.get("rays", case.resolution) in sizes
    ]


def test_keys_are_unique():
    """No two cases are taken for one when a study goes on."""
    for full in (False, True):
        keys = [case.key for case in surface_shadow.cases(full)]
        assert len(set(keys)) == len(keys)


def test_errors_are_areas():
    """Of areas 1, 2, 4 and 8, the first two lit: what a look-up says wrong is added up, as a share of the shadow."""
    scene = SimpleNamespace(
        areas=np.array([1.0, 2.0, 4.0, 8.0]),
        truth=np.array([1.0, 1.0, 0.0, 0.0]),
        lit=np.array([True, True, False, False]),
        shadowed=np.array([False, False, False, True]),
    )
    right = surface_shadow.shadow_errors(scene, scene.truth)
    assert set(right.values()) == {0.0}
    found = surface_shadow.shadow_errors(scene, np.array([0.0, 1.0, 0.5, 1.0]))
    assert found["misclassified_area"] == pytest.approx((1 + 2 + 8) / 12)
    assert found["acne_area"] == pytest.approx(1 / 3)
    assert found["detached_area"] == 1.0
    assert found["l1"] == pytest.approx(11 / 15)
    assert found["linf"] == 1.0


@pytest.fixture
def ball(launcher):
    """Rows of the ball with hard shadows and exact rays."""
    rows = rows_of(launcher, surface_shadow.BALL, "hard", (64, 128, 256, 512))
    return rows + rows_of(launcher, surface_shadow.BALL, "exact", (1,))


def test_ball_above_a_plane(ball):
    """The area that hard shadows get wrong falls at first order; exact rays see the closed form's disk."""
    assert surface_shadow.unexpected(ball) == []
    assert surface_shadow.order(ball)[surface_shadow.BALL, "hard"] == pytest.approx(1.0, abs=0.2)


def test_a_wrong_map_is_caught(launcher, monkeypatch):
    """A map that stays at 64 texels whatever is asked for does not converge."""

    def of_64_texels(launcher, light, *args):
        object.__setattr__(light, "shadow_map_size", 64)
        return CubeShadow(launcher, light, *args)

    monkeypatch.setitem(surface_shadow.SURFACE_SHADOWS, "cube", of_64_texels)
    found = surface_shadow.unexpected(rows_of(launcher, surface_shadow.BALL, "hard", (64, 128, 256)))
    assert len(found) == 1
    assert "falls at order" in found[0]


def test_penumbra_of_an_edge(launcher):
    """64 rays come within 3 of them of the closed form; pcss is far nearer than a hard edge at the same penumbra."""
    area = rows_of(launcher, surface_shadow.EDGE, "area", (16, 64))
    assert surface_shadow.unexpected(area) == []
    (pcss,) = rows_of(launcher, surface_shadow.EDGE, "pcss", (256,))
    (hard,) = rows_of(launcher, surface_shadow.EDGE, "hard", (256,))
    assert pcss.errors["misclassified_area"] < 0.2 * hard.errors["misclassified_area"]


def test_bunny(launcher):
    """The automatic bias is free of acne where none has it, and keeps the shadow attached; rays are their own truth."""
    (auto,) = rows_of(launcher, surface_shadow.BIAS, "hard, auto", (512,))
    (none,) = rows_of(launcher, surface_shadow.BIAS, "hard, none", (512,))
    (exact,) = rows_of(launcher, surface_shadow.FILTERS, "exact", (1,))
    assert surface_shadow.unexpected([auto, none, exact]) == []
    assert auto.errors["acne_area"] < 1e-3 < 0.01 < none.errors["acne_area"]
    assert auto.errors["detached_area"] < 0.02
    assert exact.errors["misclassified_area"] == 0.0
    assert "exact rays take" in surface_shadow.explain(
        [exact, *rows_of(launcher, surface_shadow.FILTERS, "hard", (512,))]
    )
