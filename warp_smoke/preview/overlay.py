"""The overlay of a window: lines of text and sliders."""

from collections.abc import Callable
from textwrap import fill

import pyvista as pv

from warp_smoke.preview.view import TEXT_COLOR

ERROR_COLOR = "#ff8f7a"
CHARACTER = 10  # width of a character, with some room [pixels]
LEAST_WIDTH = 40  # of a message, even in a window that is too narrow for it [characters]
HELP = """space        play, pause
left, right  a frame back, on
home, end    first, last frame
s            smoke
d            shadows on surfaces
l            all lights
F1, F2, ...  one light
b            baked light and shadows, or lit materials
m            materials, or plain grey, where not baked
g            marks of lights
c            the stage's camera, or the whole stage
0            smoke as it looks
1, 2, 3      a cut: density, temperature, speed
r            read the stage again
h            this help
q            close
mouse        left turns, middle moves, wheel zooms"""


class Overlay:
    """Text and sliders over what a plotter draws; the caller renders after a change."""

    def __init__(self, plotter: pv.Plotter):
        self._plotter = plotter

    def hint(self, text: str) -> None:
        """Shows a line of text at the top."""
        self._say("hint", text, (0.01, 0.99))

    def help(self, shown: bool) -> None:
        """Shows or hides what the keys do."""
        self._say("help", HELP if shown else "", (0.02, 0.9))

    def error(self, message: str) -> None:
        """Shows an error message; an empty one removes it."""
        width = 0.96 * self._plotter.window_size[0]
        self._say("error", fill(message, max(int(width / CHARACTER), LEAST_WIDTH)), (0.02, 0.91), ERROR_COLOR)

    def _say(self, name: str, text: str, position: tuple[float, float], color: str = TEXT_COLOR) -> None:
        said = self._plotter.add_text(
            text, position=position, viewport=True, name=name, color=color, font_size=8, font="courier", render=False
        )
        said.prop.justification_vertical = "top"
        said.prop.background_color, said.prop.background_opacity = "black", 0.6 if "\n" in text else 0.0

    def add_slider(
        self,
        act: Callable[[float], None],
        limits: tuple[float, float],
        value: float,
        ends: tuple[float, float],
        title: str = "",
        shown_as: str = "%.1f",
    ):
        """Adds a slider at the bottom.

        Args:
            act: called with each value that the slider is dragged to.
            limits: least and greatest value.
            value: initial value.
            ends: of the slider, as shares of the window's width.
            title: above it.
            shown_as: format of its value.

        Returns:
            VTK's widget.
        """
        left, right = ends
        return self._plotter.add_slider_widget(
            act,
            limits,
            value=value,
            pointa=(left, 0.07),
            pointb=(right, 0.07),
            title=title,
            title_height=0.018,
            color=TEXT_COLOR,
            fmt=shown_as,
            slider_width=0.02,
            tube_width=0.004,
            interaction_event="always",
        )

    def remove_sliders(self) -> None:
        """Removes all sliders."""
        self._plotter.clear_slider_widgets()
