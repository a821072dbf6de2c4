"""The window: a view of a stage with sliders, and keys that play it and change what is shown."""

import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from math import log2
from time import monotonic

from warp_smoke.preview.frames import FrameLoader
from warp_smoke.preview.overlay import Overlay
from warp_smoke.preview.relight import Switches
from warp_smoke.preview.slices import QUANTITIES
from warp_smoke.preview.stage import Frame, PreviewStage
from warp_smoke.preview.view import StageView

POLL = 30  # [ms]
# VTK's event loop holds Python's lock, so frames are only read during this wait. [s]
READING = 0.02
# Factors 2^x on the smoke's extinction, and stops of exposure.
THICKNESS_RANGE, EXPOSURE_RANGE = (-4.0, 4.0), (-4.0, 4.0)

CHANGED = "The stage has changed on disk; r: read it again"
LONG = 0.5  # time to wait for a frame before saying so [s]
# Time between checks of the stage's files. [s]
LOOK_AT_FILES = 1.0


class Window:
    """A stage on the screen; its frames are read in the background.

    Args:
        stage: what is shown.
        view: draws it.
        frame: the frame shown first.
        clock: returns the time [s].
    """

    def __init__(self, stage: PreviewStage, view: StageView, frame: int, clock: Callable[[], float] = monotonic):
        self._plotter, self._overlay, self._clock = view.plotter, Overlay(view.plotter), clock
        self._thickness, self._quantity, self._switches = 1.0, None, Switches()
        self._plays_since: float | None = None
        self._helps = self._interrupted = self._waits = False
        self._asked = clock()
        self._looked_at_files = clock()
        self._keys = {
            "space": self._play_or_pause,
            "Left": lambda: self.seek(self._wanted - 1),
            "Right": lambda: self.seek(self._wanted + 1),
            "Home": lambda: self.seek(self._frames[0]),
            "End": lambda: self.seek(self._frames[-1]),
            "s": partial(self._toggle, "smoke"),
            "b": partial(self._toggle, "baked"),
            "m": partial(self._toggle, "materials"),
            "d": self._switch_shadows,
            "l": self._switch_lights,
            **{f"F{n}": partial(self._switch_light, n) for n in range(1, 13)},
            "g": partial(self._toggle, "marks"),
            "c": self._switch_camera,
            "0": partial(self.show_quantity, None),
            **{str(n): partial(self.show_quantity, name) for n, name in enumerate(QUANTITIES, 1)},
            "r": self._reopen,
            "h": self._help,
            "q": self._end,
        }
        self._show(stage, view, stage.load(frame))

    def _show(self, stage: PreviewStage, view: StageView, loaded: Frame) -> None:
        """Shows a stage at a frame, with the controls that it needs."""
        self._stage, self._view, self._frames = stage, view, stage.scene.frames
        self._wanted = self._requested = frame = loaded.number
        self._loading: Future[Frame] | None = None
        self._loader = FrameLoader(self._load(), self._frames)
        view.show(loaded)
        self._slider, add_slider = None, self._overlay.add_slider
        if len(self._frames) > 1:
            limits = self._frames[0], self._frames[-1]
            self._slider = add_slider(self.seek, limits, frame, (0.3, 0.7), shown_as="%.0f")
        if stage.volumes:
            add_slider(self.set_thickness, THICKNESS_RANGE, log2(self._thickness), (0.03, 0.2), "density 2^x")
        add_slider(self.set_exposure, EXPOSURE_RANGE, view.drawn.exposure, (0.8, 0.97), "exposure [stops]")
        self._stale = False
        self._hint()

    def run(self) -> None:
        """Shows the window until the user closes it.

        Raises:
            KeyboardInterrupt: Ctrl-C in the terminal.
        """
        interactor = self._plotter.iren
        for key, act in self._keys.items():
            interactor.add_key_event(key, act)
        interactor.add_observer("TimerEvent", lambda *_: self.poll())
        interactor.enable_terrain_style(mouse_wheel_zooms=True, shift_pans=True)  # keeps the view upright
        interactor.initialize()
        style = interactor.interactor.GetInteractorStyle()
        # VTK's style gives some of the keys other meanings; this observer replaces them.
        style.AddObserver("CharEvent", lambda *_: None)
        style.AddObserver("StartInteractionEvent", lambda *_: self._view.leave_camera())
        interactor.create_timer(POLL)
        try:
            with _on_ctrl_c(self._interrupt):
                self._plotter.show()
        finally:
            self.close()
        if self._interrupted:
            raise KeyboardInterrupt

    def close(self) -> None:
        """Stops reading frames."""
        self._loader.close()

    def press(self, key: str) -> None:
        """Does what a key does."""
        self._keys[key]()

    def seek(self, value: float) -> None:
        """Requests the frame nearest to a time code; it is drawn as soon as it is loaded."""
        self._wanted = min(max(round(value), self._frames[0]), self._frames[-1])
        if self._slider is not None:
            self._slider.GetRepresentation().SetValue(self._wanted)

    def set_thickness(self, doublings: float) -> None:
        """Multiplies the smoke's extinction by 2^doublings."""
        self._thickness = 2.0**doublings
        self._read_again()

    def set_exposure(self, stops: float) -> None:
        """Multiplies all light by 2^stops."""
        self._view.restyle(replace(self._view.drawn, exposure=round(stops, 1)))
        self._plotter.render()

    def show_quantity(self, quantity: str | None) -> None:
        """Shows a quantity on a slice through the smoke, or (None) the smoke again."""
        self._quantity = quantity
        self._read_again()

    def _switch_shadows(self) -> None:
        self._switch(replace(self._switches, shadows=not self._switches.shadows))

    def _switch_lights(self) -> None:
        """Switches all lights off, or back on if any is off."""
        off = frozenset() if self._switches.off else frozenset(light.path for light in self._stage.lights)
        self._switch(replace(self._switches, off=off))

    def _switch_light(self, number: int) -> None:
        """Switches one light off or on again, counted from 1."""
        for light in self._stage.lights[number - 1 : number]:
            self._switch(replace(self._switches, off=self._switches.off ^ {light.path}))

    def _switch(self, switches: Switches) -> None:
        self._switches = switches
        self._hint()
        self._read_again()

    def _read_again(self) -> None:
        self._loader.change(self._load())
        self._requested = self._loading = None

    def _load(self) -> Callable[[int], Frame]:
        asked = {"thickness": self._thickness, "quantity": self._quantity, "switches": self._switches}
        return partial(self._stage.load, **asked)

    def _reopen(self) -> None:
        """Shows the stage as its files are now, in the same look and from the same viewpoint."""
        self._loader.close()  # USD does not allow reads while a stage is reloaded
        try:
            stage = self._stage.reopened()
            frame = min(max(self._wanted, stage.scene.start), stage.scene.end)
            loaded = stage.load(frame, self._thickness, self._quantity, self._switches)
        except (ValueError, OSError) as error:
            self._loader = FrameLoader(self._load(), self._frames)
            if self._loading is not None:  # the request was cancelled, unless it had begun
                self._requested = self._loading = None
            self._say_error(str(error))
            return
        self._overlay.remove_sliders()
        self._show(stage, self._view.succeeded_by(stage), loaded)
        self._plotter.render()

    def _end(self) -> None:
        self._plotter.iren.terminate_app()

    def _interrupt(self) -> None:
        self._interrupted = True
        self._end()

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
        self._overlay.help(self._helps)
        self._plotter.render()

    def poll(self) -> None:
        """Draws the wanted frame once it is loaded; while the slider is dragged, frames appear as they come in."""
        self._look_at_files()
        self._play()
        if self._loading is None and self._wanted != self._requested:
            self._requested, self._asked = self._wanted, self._clock()
            self._loading = self._loader.request(self._wanted)
        self._loader.wait(READING)
        if self._loading is not None and self._loading.done():
            loading, self._loading = self._loading, None
            self._draw(loading)
        waits = self._loading is not None and self._clock() - self._asked > LONG
        if waits != self._waits:
            self._waits = waits
            self._hint()
            self._plotter.render()

    def _play(self) -> None:
        """Requests the next frame when it is due and the previous one is drawn; after the last comes the first."""
        pause = 1.0 / self._stage.scene.time_codes_per_second
        if self._plays_since is None or self._loading is not None or self._clock() - self._plays_since < pause:
            return
        self._plays_since = self._clock()
        self.seek(self._wanted + 1 if self._wanted < self._frames[-1] else self._frames[0])

    def _draw(self, loaded: Future[Frame]) -> None:
        try:
            self._view.show(loaded.result())
            self._say_error("")
        # USD raises RuntimeErrors for prims that are gone after a failed reload of their stage.
        except (ValueError, OSError, RuntimeError) as error:
            self._say_error(str(error))

    def _look_at_files(self) -> None:
        """Says, once, that the stage's files have changed."""
        if self._stale or self._clock() - self._looked_at_files < LOOK_AT_FILES:
            return
        self._looked_at_files = self._clock()
        if self._stage.changed_on_disk():
            self._stale = True
            self._hint()
            self._plotter.render()

    def _hint(self) -> None:
        off = [light.path for light in self._stage.lights if light.path in self._switches.off]
        said = ["h: help"]
        if not self._switches.shadows:
            said.append("no shadows")
        if off:
            said.append("no lights" if len(off) == len(self._stage.lights) else f"without {', '.join(off)}")
        if self._stale:
            said.append(CHANGED)
        if self._waits:
            said.append("...")
        self._overlay.hint("   ".join(said))

    def _say_error(self, message: str) -> None:
        self._overlay.error(message)
        self._plotter.render()


@contextmanager
def _on_ctrl_c(act: Callable[[], None]) -> Iterator[None]:
    """Makes Ctrl-C call `act`; VTK's event loop would end the process at Python's own KeyboardInterrupt."""
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.SIG_IGN or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, lambda *_: act())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
