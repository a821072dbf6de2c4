"""Machines without a display or without OpenGL: one clear line, no crash."""

import ctypes
import os
import sys

import pytest

from warp_smoke.preview import opengl

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="elsewhere OpenGL is part of the system")


@pytest.fixture
def without(monkeypatch):
    """Makes one system library missing."""

    def hide(missing):
        load = ctypes.CDLL

        def load_others(name, *args, **kwargs):
            if name == missing:
                raise OSError(f"{name}: cannot open shared object file")
            return load(name, *args, **kwargs)

        monkeypatch.setattr(ctypes, "CDLL", load_others)

    return hide


def test_picture_without_egl_names_the_packages(without):
    """Without libEGL a picture is refused in one line that says what to install."""
    without("libEGL.so.1")
    with pytest.raises(ImportError, match=r"libEGL\.so\.1.*apt install libegl1 libgl1-mesa-dri$"):
        opengl.open_off_screen((8, 8))


@pytest.mark.parametrize("library", ["libX11.so.6", "libGL.so.1"])
def test_window_without_a_library_names_the_packages(monkeypatch, without, library):
    """Without libX11 or libGL a window is refused in one line that says what to install."""
    monkeypatch.setenv("DISPLAY", ":98765")
    without(library)
    with pytest.raises(ImportError, match=r"apt install libgl1 libx11-6$"):
        opengl.open_window((8, 8), "a stage")


@pytest.mark.parametrize("display", [None, ":98765"])
def test_window_without_a_display_points_to_screenshot(monkeypatch, display):
    """With no display, or one that does not answer, the error says how to get a picture."""
    monkeypatch.delenv("DISPLAY", raising=False)
    if display:
        pytest.importorskip("ctypes").CDLL("libX11.so.6")
        monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(ValueError, match="--screenshot"):
        opengl.open_window((8, 8), "a stage")


def test_environment_is_left_as_it_was(monkeypatch, open_plotter):
    """Drawing off-screen does not keep later windows of the same process from the screen."""
    monkeypatch.delenv("VTK_DEFAULT_OPENGL_WINDOW", raising=False)
    open_plotter((8, 8))
    assert "VTK_DEFAULT_OPENGL_WINDOW" not in os.environ
