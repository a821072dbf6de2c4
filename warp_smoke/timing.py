"""Measures how long each pass takes."""

from collections import defaultdict
from contextlib import contextmanager
from time import perf_counter

from warp_smoke.launch import Launcher


class Timings:
    """Seconds and calls of each pass, by name.

    Attributes:
        seconds: total time of each pass [s].
        calls: how often each pass ran.
    """

    def __init__(self, launcher: Launcher):
        self._launcher = launcher
        self.seconds, self.calls = defaultdict(float), defaultdict(int)

    @contextmanager
    def measure(self, name: str):
        """Adds the time of a `with` block to the pass `name`."""
        start = perf_counter()
        yield
        self._launcher.synchronize()
        self.seconds[name] += perf_counter() - start
        self.calls[name] += 1
