"""The system libraries that VTK draws with, checked before VTK is used: it crashes where one is missing.

On Linux, VTK's wheel opens libEGL to draw without a display, and libX11 and libGL to draw in a window. On macOS and
Windows what it needs is part of the system.
"""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from pyvista import Plotter
from vtkmodules.vtkCommonCore import vtkLogger

_CHOICE = "VTK_DEFAULT_OPENGL_WINDOW"
# libegl1 alone brings no driver: libgl1-mesa-dri has the one that draws on the CPU.
_PICTURE_PACKAGES = "libegl1 libgl1-mesa-dri"
_WINDOW_PACKAGES = "libgl1 libx11-6"


def open_off_screen(size: tuple[int, int]) -> Plotter:
    """Opens a plotter without a window or antialiasing, with or without a display.

    Raises:
        ImportError: a system library or driver is missing.
    """
    if sys.platform != "linux":
        return Plotter(off_screen=True, window_size=list(size), lighting=None)
    _load("libEGL.so.1", _PICTURE_PACKAGES)
    with _off_screen_window():
        plotter = Plotter(off_screen=True, window_size=list(size), lighting=None)
    if not plotter.render_window.IsA("vtkEGLRenderWindow"):
        raise ImportError(f"the preview finds no OpenGL driver: on Debian and Ubuntu, apt install {_PICTURE_PACKAGES}")
    plotter.render_window.SetMultiSamples(0)
    return plotter


def open_window(size: tuple[int, int], title: str) -> Plotter:
    """Opens a plotter in a window with a title.

    Raises:
        ValueError: there is no display.
        ImportError: a system library is missing.
    """
    if sys.platform == "linux":
        _check_display()
    return Plotter(off_screen=False, window_size=list(size), lighting=None, title=title)


@contextmanager
def _off_screen_window() -> Iterator[None]:
    """Makes VTK open windows with EGL. By default it looks for a display first, and crashes without libX11."""
    before, verbosity = os.environ.get(_CHOICE), vtkLogger.GetCurrentVerbosityCutoff()
    os.environ[_CHOICE] = "vtkEGLRenderWindow"
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(verbosity)
        if before is None:
            del os.environ[_CHOICE]
        else:
            os.environ[_CHOICE] = before


def _check_display() -> None:
    display = os.environ.get("DISPLAY")
    if display:
        x11 = _load("libX11.so.6", _WINDOW_PACKAGES)
        _load("libGL.so.1", _WINDOW_PACKAGES)
        x11.XOpenDisplay.restype = ctypes.c_void_p
        connection = x11.XOpenDisplay(None)
        if connection:
            x11.XCloseDisplay(ctypes.c_void_p(connection))
            return
    raise ValueError(f"DISPLAY is {display}: no display to open a window on; --screenshot FILE.png saves a picture")


def _load(library: str, packages: str) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(library)
    except OSError:
        raise ImportError(f"the preview needs {library}: on Debian and Ubuntu, apt install {packages}") from None
