"""UsdGeomPoints as emitters: widths of each kind, motion, what is refused, and the way back."""

import numpy as np
import pytest
from stage_text import scene_of

from warp_smoke.geometry import Points
from warp_smoke.record import Samples
from warp_smoke.scene import Emitter, Scene

POINTS = 'def Points "P" ( prepend apiSchemas = ["SmokeEmitterAPI"] ) {'


def points_of(folder, attributes):
    """The points of the only emitter."""
    (emitter,) = scene_of(folder, f"{POINTS} {attributes} }}").emitters
    return emitter.mesh


@pytest.mark.parametrize(
    ("widths", "expected"),
    [
        ("float[] widths = [0.5, 0.25]", [0.5, 0.25]),
        ('float[] widths = [0.5] ( interpolation = "constant" )', [0.5, 0.5]),
        ('float[] primvars:widths = [0.5, 1] ( interpolation = "vertex" )', [0.5, 1.0]),
    ],
)
def test_widths(tmp_path, widths, expected):
    """One width for all or one a point, as attribute or primvar."""
    found = points_of(tmp_path, f"point3f[] points = [(0, 1, 2), (3, 4, 5)]\n{widths}\n")
    assert found == Points([[0, 1, 2], [3, 4, 5]], expected)
    assert not found.deforms


def test_points_and_widths_over_time(tmp_path):
    """Points and widths are sampled each at their own times."""
    found = points_of(
        tmp_path,
        """point3f[] points.timeSamples = { 1: [(0, 0, 0)], 3: [(0, 4, 0)] }
        float[] widths.timeSamples = { 1: [1], 2: [2] }
        """,
    )
    assert found.deforms
    np.testing.assert_array_equal(found.points_at(2.0), [[0, 2, 0]])
    np.testing.assert_array_equal(found.widths_at(1.5), [1.5])
    np.testing.assert_array_equal(found.widths_at(4.0), [2.0])


@pytest.mark.parametrize("widths", ["", "float[] widths = [1, 2, 3]", "float[] widths = [1, -1]"])
def test_widths_that_are_refused(tmp_path, widths):
    """A width for each point is needed, at least 0; the error names prim and attribute."""
    with pytest.raises(ValueError, match="/World/P: widths is"):
        points_of(tmp_path, f"point3f[] points = [(0, 1, 2), (3, 4, 5)]\n{widths}\n")


@pytest.mark.parametrize("moves", [False, True])
def test_round_trip(tmp_path, moves):
    """Points written and read again are equal."""
    rng = np.random.default_rng(0)
    points, widths = rng.normal(size=(2, 5, 3)).astype(np.float32), rng.uniform(0, 1, (2, 5)).astype(np.float32)
    shape = Points(points[0], widths[0])
    if moves:
        shape = Points(Samples([1, 2.5], points), Samples([0, 3], widths))
    scene = Scene(emitters=[Emitter(path="/World/P", mesh=shape, rate=2.0)])
    scene.save(tmp_path / "points.usda")
    read = Scene.open(tmp_path / "points.usda")
    assert read == scene
    assert not read.warnings
