"""The window's slider: the frame it is drawn to is the frame that is shown."""

import shutil

import numpy as np
import pytest

from warp_smoke.preview.stage import PreviewStage
from warp_smoke.preview.view import StageView
from warp_smoke.preview.window import Window

SIZE = (160, 120)


@pytest.fixture
def window_of(open_plotter):
    """Makes windows on stages, off-screen: window, and its view."""

    def make(path, frame):
        stage = PreviewStage(path)
        view = StageView(stage, open_plotter(SIZE), 1.0)
        return Window(stage, view, frame), view

    return make


def _seen(window, view):
    """The floor's grey once the window has caught up with its slider."""
    for _ in range(200):
        window.poll()
    return view.picture()[100, 20].tolist()


def test_slider_shows_the_frame_it_is_moved_to(results, window_of):
    """The first frame is there at once; one moved to, also between two time codes, is there when it is read."""
    window, view = window_of(results, 3)
    assert view.picture()[100, 20].tolist() == [200] * 3
    window.seek(3.6)
    assert _seen(window, view) == [100] * 3
    window.seek(3.0)
    assert _seen(window, view) == [200] * 3
    window.close()


def test_damaged_frame_is_said_in_the_window(results, tmp_path, window_of):
    """A frame that cannot be read leaves the last one standing with a line of text, and the window goes on."""
    folder = tmp_path / "damaged"
    shutil.copytree(results.parent, folder)
    (folder / "volumes" / "4.vdb").write_bytes(b"nothing")
    window, view = window_of(folder, 3)
    whole = view.picture()
    window.seek(4)
    assert _seen(window, view) == [200] * 3
    assert not np.array_equal(view.picture(), whole)
    window.seek(3)
    _seen(window, view)
    np.testing.assert_array_equal(view.picture(), whole)
    window.close()
