"""The command `warp-smoke`: answers Ctrl-C from the start, while everything else is still being loaded."""

import gc
import os
import signal
from functools import partial
from types import FrameType


def main() -> None:
    """Entry point of `warp-smoke`."""
    numbers = [each for each in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(each) != signal.SIG_IGN]
    stderr = os.dup(2)  # where the user looks, while 2 is kept from a library that says too much
    for number in numbers:
        signal.signal(number, partial(_stop, stderr))
    gc.disable()  # while all is loaded, which stays
    from warp_smoke.cli import main

    gc.enable()
    try:
        main()
    finally:
        for number in numbers:  # all is done: Python, on its way out, would only drop its own handlers
            signal.signal(number, signal.SIG_IGN)
        gc.freeze()  # nor look through all that was imported for garbage, which takes 0.2 s


def _stop(stderr: int, number: int, frame: FrameType | None) -> None:
    """Ends the process at once: an exception could come up in the middle of an import, or of a native library.

    Nothing is lost: files appear under their names only when they are whole, and runs keep a checkpoint.
    """
    show_cursor = b"\r\x1b[K\x1b[?25h" if os.isatty(stderr) else b""  # which a progress bar hides
    os.write(stderr, show_cursor + b"Stopped.\n")
    os._exit(128 + number)


if __name__ == "__main__":
    main()
