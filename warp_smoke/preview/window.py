"""The window: a view of a stage with a slider over its frames."""

from concurrent.futures import Future
from textwrap import fill

from warp_smoke.preview.frames import FrameLoader
from warp_smoke.preview.stage import Frame, PreviewStage
from warp_smoke.preview.view import StageView

TEXT_COLOR, ERROR_COLOR = "#e8e8e8", "#ff8f7a"
WIDTH = 100  # of a message [characters]
POLL = 30  # [ms]
# VTK's event loop holds Python's lock, so that frames are only read while this waits for them. [s]
READING = 0.02


class Window:
    """A stage on the screen; its frames are read in the background.

    Args:
        stage: what is shown.
        view: draws it.
        frame: shown first.
    """

    def __init__(self, stage: PreviewStage, view: StageView, frame: int):
        self._view, self._plotter = view, view.plotter
        self._loader = FrameLoader(stage.load, stage.scene.frames)
        self._wanted = self._requested = frame
        self._loading: Future[Frame] | None = None
        view.show(self._loader.request(frame).result())
        first, last = stage.scene.start, stage.scene.end
        if first < last:
            self._add_slider(first, last, frame)

    def run(self) -> None:
        """Returns when the user closes the window."""
        interactor = self._plotter.iren
        interactor.add_observer("TimerEvent", lambda *_: self.poll())
        interactor.initialize()
        interactor.create_timer(POLL)
        try:
            self._plotter.show()
        finally:
            self.close()

    def close(self) -> None:
        """Ends the reading of frames."""
        self._loader.close()

    def _add_slider(self, first: int, last: int, frame: int) -> None:
        self._plotter.add_slider_widget(
            self.seek,
            (first, last),
            value=frame,
            pointa=(0.3, 0.06),
            pointb=(0.7, 0.06),
            color=TEXT_COLOR,
            fmt="%.0f",
            slider_width=0.02,
            tube_width=0.004,
            interaction_event="always",
        )

    def seek(self, value: float) -> None:
        """Asks for the frame nearest to a time code; it is drawn as soon as it is there."""
        self._wanted = round(value)

    def poll(self) -> None:
        """Draws the frame that is wanted once it is there; a slider that is dragged shows what comes in on its way."""
        if self._loading is None and self._wanted != self._requested:
            self._requested = self._wanted
            self._loading = self._loader.request(self._wanted)
        self._loader.wait(READING)
        if self._loading is not None and self._loading.done():
            loading, self._loading = self._loading, None
            self._draw(loading)

    def _draw(self, loaded: Future[Frame]) -> None:
        message = ""
        try:
            self._view.show(loaded.result())
        except (ValueError, OSError) as error:
            message = fill(str(error), WIDTH)
        self._plotter.add_text(
            message, position=(0.02, 0.9), viewport=True, name="error", color=ERROR_COLOR, font_size=9, render=False
        )
        self._plotter.render()
