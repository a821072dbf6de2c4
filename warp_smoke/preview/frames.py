"""Frames loaded in the background, so that the window stays responsive; the last few are kept."""

from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait

from warp_smoke.preview.stage import Frame

KEPT = 6


class FrameLoader:
    """Loads frames one after the other in a background thread.

    Args:
        load: reads a frame; it is called only from that thread.
        frames: numbers of all frames.
    """

    def __init__(self, load: Callable[[int], Frame], frames: range):
        self._load, self._frames = load, frames
        self._pool = ThreadPoolExecutor(1, "preview")
        self._futures: OrderedDict[int, Future[Frame]] = OrderedDict()

    def request(self, number: int) -> Future[Frame]:
        """Returns the future of a frame; the frame after it is loaded next, and requests still waiting are dropped."""
        for waiting in [key for key, future in self._futures.items() if future.cancel()]:
            del self._futures[waiting]
        future = self._submit(number)
        if number + 1 in self._frames:
            self._submit(number + 1)
            self._futures.move_to_end(number)
        while len(self._futures) > KEPT:
            self._futures.popitem(last=False)
        return future

    def change(self, load: Callable[[int], Frame]) -> None:
        """Forgets all frames; from here on they are read by `load`."""
        for future in self._futures.values():
            future.cancel()
        self._futures.clear()
        self._load = load

    def wait(self, seconds: float) -> None:
        """Waits until all requested frames are loaded, but no longer than this."""
        wait(self._futures.values(), timeout=seconds)

    def _submit(self, number: int) -> Future[Frame]:
        if number not in self._futures:
            self._futures[number] = self._pool.submit(self._load, number)
        self._futures.move_to_end(number)
        return self._futures[number]

    def close(self) -> None:
        """Drops waiting requests and ends the thread."""
        self._pool.shutdown(cancel_futures=True)
