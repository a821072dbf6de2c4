"""The window: a view of a stage with sliders, and keys that play it and change what is seen."""

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from functools import partial
from textwrap import fill
from time import monotonic

from warp_smoke.preview.frames import FrameLoader
from warp_smoke.preview.slices import QUANTITIES
from warp_smoke.preview.stage import Frame, PreviewStage
from warp_smoke.preview.view import StageView

TEXT_COLOR, ERROR_COLOR = "#e8e8e8", "#ff8f7a"
WIDTH = 100  # of a message [characters]
POLL = 30  # [ms]
# VTK's event loop holds Python's lock, so that frames are only read while this waits for them. [s]
READING = 0.02
# Factors 2^x on the smoke's extinction, and stops of exposure.
THICKNESS_RANGE, EXPOSURE_RANGE = (-4.0, 4.0), (-4.0, 4.0)

HELP = """space        play, pause
left, right  a frame back, on
home, end    first, last frame
s            smoke
b            baked light and shadows, or the materials under the stage's lights
m            materials, or plain grey (where no baked light is shown)
l            marks of lights
c            through the stage's camera, or the whole stage
0            smoke as it looks
1, 2, 3      a cut that shows density, temperature, speed
h            this help
q            close
mouse        left turns, middle or shift moves, right or wheel zooms"""


class Window:
    """A stage on the screen; its frames are read in the background.

    Args:
        stage: what is shown.
        view: draws it.
        frame: shown first.
        clock: seconds that pass while it plays.
    """

    def __init__(self, stage: PreviewStage, view: StageView, frame: int, clock: Callable[[], float] = monotonic):
        self._stage, self._view, self._plotter, self._clock = stage, view, view.plotter, clock
        self._frames = stage.scene.frames
        self._loader = FrameLoader(stage.load, self._frames)
        self._wanted = frame
        self._requested: int | None = frame
        self._loading: Future[Frame] | None = None
        self._thickness, self._quantity = 1.0, None
        self._plays_since: float | None = None
        self._helps = False
        view.show(self._loader.request(frame).result())
        self._slider = None
        if len(self._frames) > 1:
            self._slider = self._add_slider(self.seek, (self._frames[0], self._frames[-1]), frame, 0.3, 0.7, "", "%.0f")
        if stage.volumes:
            self._add_slider(self.set_thickness, THICKNESS_RANGE, 0.0, 0.03, 0.2, "density 2^x", "%.1f")
        self._add_slider(self.set_exposure, EXPOSURE_RANGE, 0.0, 0.8, 0.97, "exposure [stops]", "%.1f")
        self._say("hint", "h: help", (0.01, 0.96))
        self._keys = {
            "space": self._play_or_pause,
            "Left": lambda: self.seek(self._wanted - 1),
            "Right": lambda: self.seek(self._wanted + 1),
            "Home": lambda: self.seek(self._frames[0]),
            "End": lambda: self.seek(self._frames[-1]),
            "s": partial(self._toggle, "smoke"),
            "b": partial(self._toggle, "baked"),
            "m": partial(self._toggle, "materials"),
            "l": partial(self._toggle, "marks"),
            "c": self._switch_camera,
            "0": partial(self.show_quantity, None),
            **{str(n): partial(self.show_quantity, name) for n, name in enumerate(QUANTITIES, 1)},
            "h": self._help,
        }

    def run(self) -> None:
        """Returns when the user closes the window."""
        interactor = self._plotter.iren
        for key, act in self._keys.items():
            interactor.add_key_event(key, act)
        interactor.add_observer("TimerEvent", lambda *_: self.poll())
        interactor.initialize()
        # VTK's style has other meanings for some of the keys; an observer stands in for them.
        interactor.interactor.GetInteractorStyle().AddObserver("CharEvent", lambda *_: None)
        interactor.create_timer(POLL)
        try:
            self._plotter.show()
        finally:
            self.close()

    def close(self) -> None:
        """Ends the reading of frames."""
        self._loader.close()

    def press(self, key: str) -> None:
        """Does what a key does."""
        self._keys[key]()

    def seek(self, value: float) -> None:
        """Asks for the frame nearest to a time code; it is drawn as soon as it is there."""
        self._wanted = min(max(round(value), self._frames[0]), self._frames[-1])
        if self._slider is not None:
            self._slider.GetRepresentation().SetValue(self._wanted)

    def set_thickness(self, doublings: float) -> None:
        """Makes smoke thicker: each doubling of its extinction counts one."""
        self._thickness = 2.0**doublings
        self._read_again()

    def set_exposure(self, stops: float) -> None:
        """Makes all light brighter: each stop doubles it."""
        self._view.restyle(replace(self._view.drawn, exposure=round(stops, 1)))
        self._plotter.render()

    def show_quantity(self, quantity: str | None) -> None:
        """Shows a quantity in a cut through the smoke, or the smoke again."""
        self._quantity = quantity
        self._read_again()

    def _read_again(self) -> None:
        self._loader.change(partial(self._stage.load, thickness=self._thickness, quantity=self._quantity))
        self._requested = self._loading = None

    def _play_or_pause(self) -> None:
        self._plays_since = self._clock() if self._plays_since is None else None

    def _toggle(self, part: str) -> None:
        look = self._view.drawn
        self._view.restyle(replace(look, **{part: not getattr(look, part)}))
        self._plotter.render()

    def _switch_camera(self) -> None:
        self._view.look_through_camera(not self._view.follows_camera)
        self._plotter.render()

    def _help(self) -> None:
        self._helps = not self._helps
        self._say("help", HELP if self._helps else "", (0.05, 0.4))
        self._plotter.render()

    def poll(self) -> None:
        """Draws the frame that is wanted once it is there; a slider that is dragged shows what comes in on its way."""
        self._play()
        if self._loading is None and self._wanted != self._requested:
            self._requested = self._wanted
            self._loading = self._loader.request(self._wanted)
        self._loader.wait(READING)
        if self._loading is not None and self._loading.done():
            loading, self._loading = self._loading, None
            self._draw(loading)

    def _play(self) -> None:
        """Asks for the next frame when it is time for it and the last one is drawn; after the last comes the first."""
        pause = 1.0 / self._stage.scene.time_codes_per_second
        if self._plays_since is None or self._loading is not None or self._clock() - self._plays_since < pause:
            return
        self._plays_since = self._clock()
        self.seek(self._wanted + 1 if self._wanted < self._frames[-1] else self._frames[0])

    def _draw(self, loaded: Future[Frame]) -> None:
        message = ""
        try:
            self._view.show(loaded.result())
        except (ValueError, OSError) as error:
            message = fill(str(error), WIDTH)
        self._say("error", message, (0.02, 0.85), ERROR_COLOR)
        self._plotter.render()

    def _say(self, name: str, text: str, position: tuple[float, float], color: str = TEXT_COLOR) -> None:
        said = self._plotter.add_text(
            text, position=position, viewport=True, name=name, color=color, font_size=8, font="courier", render=False
        )
        said.prop.background_color, said.prop.background_opacity = "black", 0.6 if "\n" in text else 0.0

    def _add_slider(self, act: Callable, limits: tuple, value: float, left: float, right: float, title: str, fmt: str):
        return self._plotter.add_slider_widget(
            act,
            limits,
            value=value,
            pointa=(left, 0.07),
            pointb=(right, 0.07),
            title=title,
            title_height=0.018,
            color=TEXT_COLOR,
            fmt=fmt,
            slider_width=0.02,
            tube_width=0.004,
            interaction_event="always",
        )
