"""VTK's ray caster as it is set up here: opacity after Beer and Lambert, whatever the voxels and the samples."""

from dataclasses import replace

import numpy as np
import pytest

from warp_smoke.preview.smoke import SmokeVoxels
from warp_smoke.preview.volume import SmokeActor

TOLERANCE = 1  # the picture has 8 bits


def _slab(shape, depth, turn, code=255):
    """White voxels 1 unit thick along z, `depth` deep in all where their code is 255, turned about z by `turn`."""
    rgba = np.full((*shape, 4), 65535, np.uint16)
    rgba[..., 3] = 257 * code
    to_world = np.eye(4)
    side = 1.0 / (shape[2] - 1)  # between the outermost samples
    c, s = np.cos(turn), np.sin(turn)
    to_world[:2, :2] = side * np.array([[c, s], [-s, c]])
    to_world[2, 2] = side
    to_world[3, :3] = -0.5 * (np.array(shape) - 1) @ to_world[:3, :3]
    return SmokeVoxels(rgba, to_world, depth)


@pytest.mark.parametrize(
    ("cells", "step", "turn", "depth", "code"),
    [(9, 1, 0, 1, 255), (33, 1, 0, 1, 255), (65, 2, 0, 1, 255), (33, 0.5, 0.4, 3, 255), (33, 1, 0, 4, 64)],
)
def test_opacity_is_that_of_the_smoke_passed(open_plotter, cells, step, turn, depth, code):
    """Seen along its thickness, a slab of optical depth τ covers 1 − e^(−τ) for any voxel size, step and turn."""
    plotter = open_plotter((40, 40))
    SmokeActor(plotter, step).show(_slab((cells, cells, cells), depth, turn, code))
    plotter.camera.parallel_projection = True
    plotter.camera_position = [(0, 0, 4), (0, 0, 0), (0, 1, 0)]
    plotter.camera.parallel_scale = 0.3
    seen = plotter.screenshot(None, return_img=True)[5:35, 5:35].astype(float).mean()
    assert seen == pytest.approx(255 * (1 - np.exp(-depth * code / 255)), abs=TOLERANCE)


@pytest.mark.parametrize("depth", [3.0, 4.5, 30.0])
def test_a_ray_that_ends_early_misses_little(open_plotter, depth):
    """Before a white wall no pixel is further from 1 − e^(−τ) than what a ray leaves out at its end: 0.02 · 255."""
    plotter = open_plotter((40, 40))
    plotter.set_background("white")
    black = _slab((33, 33, 33), depth, 0.0)
    black.rgba[..., :3] = 0
    SmokeActor(plotter, 2.0).show(black)
    plotter.camera.parallel_projection = True
    plotter.camera_position = [(0, 0, 4), (0, 0, 0), (0, 1, 0)]
    plotter.camera.parallel_scale = 0.3
    seen = plotter.screenshot(None, return_img=True)[5:35, 5:35].astype(float)
    assert np.abs(seen - 255 * np.exp(-depth)).max() <= 0.02 * 255 + TOLERANCE


@pytest.mark.parametrize("exposure", [0.0, -2.0])
def test_light_beyond_white_is_clipped_last(open_plotter, exposure):
    """Thin smoke of light that is four times white in sRGB is as bright as its share of that, not as one of white."""
    plotter = open_plotter((40, 40))
    lit = replace(_slab((33, 33, 33), 0.2, 0.0), brightest=4.0)
    SmokeActor(plotter, 1.0).show(lit, exposure)
    plotter.camera.parallel_projection = True
    plotter.camera_position = [(0, 0, 4), (0, 0, 0), (0, 1, 0)]
    plotter.camera.parallel_scale = 0.3
    seen = plotter.screenshot(None, return_img=True)[5:35, 5:35].astype(float).mean()
    value = 1.055 * (2.0**exposure * ((4.0 + 0.055) / 1.055) ** 2.4) ** (1 / 2.4) - 0.055
    assert seen == pytest.approx(255 * value * (1 - np.exp(-0.2)), abs=4.0 * TOLERANCE)


def test_smoke_that_ends_is_no_longer_drawn(open_plotter):
    """None draws nothing, and smoke after it is drawn again."""
    plotter = open_plotter((40, 40))
    actor = SmokeActor(plotter, 1.0)
    plotter.camera_position = [(0, 0, 4), (0, 0, 0), (0, 1, 0)]
    seen = []
    for smoke in (_slab((9, 9, 9), 3.0, 0.0), None, _slab((5, 5, 5), 3.0, 0.0)):
        actor.show(smoke)
        plotter.render()
        seen.append(plotter.screenshot(None, return_img=True).max())
    assert seen[0] > 200
    assert seen[1] == 0
    assert seen[2] > 200
