"""Frames in the background: the right ones, in the right order, few of them kept."""

from threading import Event

import pytest

from warp_smoke.preview.frames import KEPT, FrameLoader


@pytest.fixture
def loader_of():
    """Makes loaders and closes them."""
    loaders = []

    def make(load, frames):
        loaders.append(FrameLoader(load, frames))
        return loaders[-1]

    yield make
    for loader in loaders:
        loader.close()


def test_next_frame_is_loaded_ahead(loader_of):
    """A request loads that frame and then the next one; there is none after the last."""
    loaded = []
    loader = loader_of(loaded.append, range(1, 4))
    loader.request(2).result()
    loader.request(3).result()
    assert loaded == [2, 3]


def test_requests_that_wait_are_forgotten(loader_of):
    """While a frame is being loaded, only the request made last stays: a dragged slider does not queue its way."""
    started, go, loaded = Event(), Event(), []

    def load(number):
        started.set()
        go.wait()
        loaded.append(number)
        return number

    loader = loader_of(load, range(100))
    loader.request(0)
    started.wait()
    for number in range(10, 90):
        last = loader.request(number)
    go.set()
    assert last.result() == 89
    assert loader.request(90).result() == 90
    assert loaded[:3] == [0, 89, 90]


def test_few_frames_are_kept(loader_of):
    """A frame seen lately is not loaded again; one long past is."""
    loaded = []
    loader = loader_of(loaded.append, range(100))
    for number in [*range(KEPT + 5), KEPT + 4]:
        loader.request(number).result()
    loader.request(KEPT + 5).result()
    assert sorted(loaded)[: KEPT + 6] == list(range(KEPT + 6))
    loader.request(0).result()
    assert loaded.count(0) == 2


def test_failed_frame_says_why(loader_of):
    """What goes wrong while a frame is loaded is raised by its result."""

    def load(number):
        raise ValueError(f"frame {number} is damaged")

    with pytest.raises(ValueError, match="frame 1 is damaged"):
        loader_of(load, range(3)).request(1).result()
