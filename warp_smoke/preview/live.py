"""A preview of a run in progress, at a bounded cost: frames that would take too much of its time are not drawn."""

from collections import deque
from collections.abc import Callable
from time import perf_counter

import numpy as np
import pyvista as pv

from warp_smoke.preview.live_stage import LiveStage
from warp_smoke.preview.view import StageView
from warp_smoke.scene import Scene
from warp_smoke.simulation import Frame as SimulatedFrame

# Time that drawing may add, as a share of the run's time without it.
SHARE = 0.1
# Voxels between samples: drawing takes a third of the time that it takes with one voxel.
STEP = 3.0
REMEMBERED = 4  # drawings


class LivePreview:
    """Draws the frames of a run as they are made; give it to `run` as `on_frame`.

    Args:
        scene: what is run.
        plotter: where it is drawn; see `warp_smoke.preview.opengl`.
        clock: seconds.

    Attributes:
        drawn: numbers of the frames that were drawn.
        spent: time that the run has waited for drawing [s].
        closed: whether the window was closed; then nothing more is drawn, and the run continues.
    """

    def __init__(self, scene: Scene, plotter: pv.Plotter, clock: Callable[[], float] = perf_counter):
        self._clock, self._plotter = clock, plotter
        self._stage = LiveStage(scene)
        self._view = StageView(self._stage, plotter, STEP)
        self.closed = self._told_to_close = False
        plotter.iren.add_observer("ExitEvent", self._note_close)
        # The first picture takes longest, since the driver compiles its shaders: before the run, not within it.
        self._view.show(self._stage.full_frame())
        plotter.show(interactive_update=True, auto_close=False)
        began = clock()
        self._view.show(self._stage.full_frame())
        plotter.update()
        # The next drawing may cost as much as the slowest of the last ones, since the machine is busy with other work.
        self._costs = deque([clock() - began], maxlen=REMEMBERED)
        self._view.show(self._stage.empty_frame())
        plotter.update()
        self.drawn: list[int] = []
        self.spent = 0.0
        self._began = clock()

    def __call__(self, made: SimulatedFrame) -> None:
        """Draws a frame, unless that would add more than `SHARE` to the time that the run has taken so far.

        When a frame is not drawn, the window still handles its events while that limit allows.
        """
        began = self._clock()
        allowed = SHARE * (began - self._began - self.spent)
        if self.closed or self.spent > allowed:
            return
        if self.spent + max(self._costs) > allowed:
            self._plotter.iren.process_events()
            self.spent += self._clock() - began
        else:
            self._view.show(self._stage.frame(made))
            self._plotter.update()
            self._costs.append(self._clock() - began)
            self.spent += self._costs[-1]
            self.drawn.append(made.number)
        if self._told_to_close:
            self.close()

    def _note_close(self, *_: object) -> None:
        self._told_to_close = True

    def picture(self) -> np.ndarray:
        """Returns the picture in the window, [h, w, 3] uint8 sRGB, top row first."""
        return self._view.picture()

    def close(self) -> None:
        """Closes the window."""
        self.closed = True
        self._plotter.close()
