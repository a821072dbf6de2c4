"""A run watched while it works."""

import numpy as np
import pytest
from scenes import plume

from warp_smoke.preview.live import SHARE, LivePreview
from warp_smoke.preview.stage import PreviewStage
from warp_smoke.run import run
from warp_smoke.simulation import Frame


class Clock:
    """Seconds that pass as they are told to."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        """The time now."""
        return self.now


@pytest.fixture
def watch(open_plotter):
    """Makes live previews of a scene with a clock; drawing takes `cost` seconds."""

    def make(scene, cost):
        clock, plotter = Clock(), open_plotter()
        live = LivePreview(scene, plotter, clock)
        update = plotter.update

        def slow_update():
            clock.now += cost
            update()

        plotter.update = slow_update
        return live, clock

    return make


@pytest.mark.parametrize("cost", [0.001, 0.03, 0.4])
def test_drawing_never_takes_more_than_its_share(watch, cost):
    """Frames of 50 ms: whatever a drawing costs, all drawings together stay below a tenth of the rest."""
    live, clock = watch(plume(), cost)
    live(Frame(0, {}, {}, {}))  # nothing is known of the cost yet, and no time has passed
    for number in range(1, 200):
        clock.now += 0.05
        live(Frame(number, {}, {}, {}))
        # The first drawing comes before its cost is known.
        assert live.spent <= SHARE * (clock.now - live.spent) + 1e-9 or len(live.drawn) == 1
    # As many as the share allows, but for the last that was not yet due.
    assert live.spent + cost >= min(SHARE * 200 * 0.05, 200 * cost) - cost


def test_no_smoke_is_seen_before_the_first_frame(watch):
    """The full box that is drawn to learn what that takes is not what the user looks at until there is smoke."""
    live, _ = watch(plume(), 0.001)
    before = live.picture()
    live._view.show(live._stage.frame(Frame(1, {}, {}, {})))
    np.testing.assert_array_equal(live.picture(), before)
    live._view.show(live._stage.full_frame())
    assert np.abs(live.picture().astype(int) - before).max() > 50


def test_a_window_that_was_closed_draws_no_more(watch):
    """Told to close, it does at the next frame, and takes frames without a word after that."""
    live, clock = watch(plume(), 0.001)
    clock.now += 1.0
    live._note_close()
    live(Frame(1, {}, {}, {}))
    assert live.closed
    drawn, spent = list(live.drawn), live.spent
    clock.now += 100.0
    live(Frame(2, {}, {}, {}))
    assert (live.drawn, live.spent) == (drawn, spent)


def test_frames_of_a_run_look_like_its_results(watch, tmp_path):
    """What is seen at a frame while it is made is what the files show after the run, to the files' half precision."""
    scene = plume(frames=4)
    frames = []
    live, _ = watch(scene, 0.0)
    result = run(scene, tmp_path, on_frame=lambda made: frames.append(live._stage.frame(made)))
    stage = PreviewStage(result.stage)
    for made in frames:
        (shown,) = stage.load(made.number).smoke
        (smoke,) = made.smoke
        assert smoke.extinction == pytest.approx(shown.extinction, rel=1e-3)
        lower, upper = ([s.to_world[3, :3] for s in (smoke, shown)], [s.rgba.shape for s in (smoke, shown)])
        np.testing.assert_allclose(*lower, atol=1e-5)
        assert upper[0] == upper[1]
        assert np.abs(smoke.rgba / 257.0 - shown.rgba / 257.0).max() <= 2
        pictures = stage.load(made.number).pictures
        np.testing.assert_array_equal(made.pictures["/World/Floor"], pictures["/World/Floor"])
