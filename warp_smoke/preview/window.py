"""The window: a view of a stage with a slider over its frames."""

import pyvista as pv

from warp_smoke.preview.frames import FrameLoader
from warp_smoke.preview.stage import PreviewStage
from warp_smoke.preview.view import StageView

TEXT_COLOR, ERROR_COLOR = "#e8e8e8", "#ff8f7a"
POLL = 30  # [ms]


class Window:
    """A stage on the screen; its frames are read in the background.

    Args:
        stage: what is shown.
        plotter: the window; see `warp_smoke.preview.opengl`.
        view: draws the stage in it.
        frame: shown first.
    """

    def __init__(self, stage: PreviewStage, plotter: pv.Plotter, view: StageView, frame: int):
        self._plotter, self._view = plotter, view
        self._loader = FrameLoader(stage.load, stage.scene.frames)
        self._number, self._waiting = frame, self._loader.request(frame)
        view.show(self._waiting.result())
        self._waiting = None
        first, last = stage.scene.start, stage.scene.end
        if first < last:
            self._add_slider(first, last)

    def run(self) -> None:
        """Returns when the user closes the window."""
        interactor = self._plotter.iren
        interactor.add_observer("TimerEvent", lambda *_: self._poll())
        interactor.initialize()
        interactor.create_timer(POLL)
        try:
            self._plotter.show()
        finally:
            self._loader.close()

    def _add_slider(self, first: int, last: int) -> None:
        self._plotter.add_slider_widget(
            self.seek,
            (first, last),
            value=self._number,
            pointa=(0.3, 0.06),
            pointb=(0.7, 0.06),
            color=TEXT_COLOR,
            fmt="%.0f",
            style="modern",
            interaction_event="always",
        )

    def seek(self, value: float) -> None:
        """Asks for the frame nearest to a time code; it is drawn as soon as it is there."""
        number = round(value)
        if number != self._number:
            self._number, self._waiting = number, self._loader.request(number)

    def _poll(self) -> None:
        """Draws the frame that was asked for last, once it is there."""
        if self._waiting is None or not self._waiting.done():
            return
        waiting, self._waiting = self._waiting, None
        try:
            self._view.show(waiting.result())
            self._plotter.add_text("", name="error", render=False)
        except (ValueError, OSError) as error:
            self._plotter.add_text(str(error), name="error", color=ERROR_COLOR, font_size=9, render=False)
        self._plotter.render()
