"""SIGINT (Ctrl-C) and SIGTERM while frames are made: the first waits for the frame in hand, the second ends at once."""

import logging
import signal
import threading
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_log = logging.getLogger(__name__)


class Interrupted(KeyboardInterrupt):
    """A run that was told to stop, and did between two frames.

    Attributes:
        signal: what told it.
    """

    def __init__(self, message: str, number: int):
        super().__init__(message)
        self.signal = number


class Interruption:
    """A context in which SIGINT and SIGTERM are noted; the handlers from before take the second one, and all after it.

    Outside of the main thread, where Python has no signals, and for signals that are ignored, it does nothing.

    Attributes:
        signal: the one that came, or None.
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
