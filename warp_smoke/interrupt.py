"""SIGINT (Ctrl-C) and SIGTERM during a run: the first stops after the current frame, the second stops at once."""

import logging
import signal
import threading
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_log = logging.getLogger(__name__)


class Interrupted(KeyboardInterrupt):
    """Raised when a signal has stopped a run between two frames.

    Attributes:
        signal: the number of that signal.
    """

    def __init__(self, message: str, number: int):
        super().__init__(message)
        self.signal = number


class Interruption:
    """A context that notes the first SIGINT or SIGTERM; later ones go to the previous handlers.

    It does nothing outside the main thread, where Python cannot handle signals, or for signals that are ignored.

    Attributes:
        signal: the number of the signal received, or None.
    """

    def __init__(self):
        self.signal: int | None = None
        self._handlers = {}

    def __enter__(self) -> "Interruption":
        if threading.current_thread() is threading.main_thread():
            handlers = {number: signal.getsignal(number) for number in _SIGNALS}
            self._handlers = {number: each for number, each in handlers.items() if each not in (signal.SIG_IGN, None)}
            for number in self._handlers:
                signal.signal(number, self._note)
        return self

    def __exit__(self, *error) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.signal is None:
            self.signal = number
            _log.warning("Stopping after the current frame; a second signal stops at once.")
        else:
            self.__exit__()
            signal.raise_signal(number)
