"""Marks of what has no surface: where they are, and how large."""

import numpy as np
import pytest
from scenes import at, shining

import warp_smoke as ws
from warp_smoke.preview.marks import mark_emitter, mark_light
from warp_smoke.preview.stage import PreviewStage
from warp_smoke.preview.view import StageView
from warp_smoke.usd.author import author_scene


def test_points_are_marked_in_their_spheres():
    """Each point has an octahedron of its own whose corners lie on its sphere, moved by the emitter's transform."""
    points = ws.Points([(0.0, 0.0, 0.0), (3.0, 1.0, 0.0)], [0.5, 2.0])
    actor = mark_emitter(ws.Emitter(path="/Puffs", mesh=points, transform=at(0, 5, 0)), 1.0)
    corners = actor.mapper.dataset.points.reshape(2, 6, 3)
    np.testing.assert_allclose(corners.mean(axis=1), points.points, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(corners - points.points[:, None], axis=2), [[0.25] * 6, [1.0] * 6])
    assert actor.mapper.dataset.n_cells == 16
    assert actor.mapper.dataset.triangulate().is_manifold
    assert actor.center[1] == pytest.approx(5.0 + (2.0 - 0.25) / 2)


def test_points_that_emit_are_seen_before_a_run(tmp_path, open_plotter):
    """A stage with points as its emitter is drawn, its points in orange, and where they are at each frame."""
    times = np.array([1.0, 2.0])
    path = ws.Samples(times, np.array([[(-0.6, 0.0, 0.0)], [(0.6, 0.0, 0.0)]]))
    puff = ws.Emitter(path="/World/Puff", mesh=ws.Points(path, [0.5]))
    author_scene(ws.Scene(domains=[ws.SmokeDomain(path="/World/Box")], emitters=[puff], end=2), tmp_path / "mine.usda")
    stage = PreviewStage(tmp_path / "mine.usda")
    view = StageView(stage, open_plotter((160, 120)), 1.0)
    middles = []
    for frame in (1, 2):
        view.show(stage.load(frame))
        orange = view.picture().astype(int) @ [1, 0, -1] > 20
        assert orange.sum() > 20
        middles.append(np.nonzero(orange)[1].mean())
    assert middles[0] < 75
    assert middles[1] > 85


def test_a_spot_light_shows_its_cone():
    """The lines end at the cone's angle from the light's direction, a light without a cone has none."""
    spot = ws.SpotLight(path="/Spot", transform=shining((1, -2, 0.5)), cone_angle=25.0)
    actor = mark_light(spot, np.zeros(3), 2.0, 1.0)
    ends = actor.mapper.dataset.points
    ends = ends[np.linalg.norm(ends, axis=1) > 0.1]
    assert len(ends) == 8
    cosines = ends @ spot.direction_at(1.0) / np.linalg.norm(ends, axis=1)
    np.testing.assert_allclose(np.degrees(np.arccos(cosines)), 25.0, atol=1e-3)
    ball = mark_light(ws.PointLight(path="/Lamp"), np.zeros(3), 2.0, 1.0)
    assert np.linalg.norm(ball.mapper.dataset.points, axis=1).max() < 0.1
