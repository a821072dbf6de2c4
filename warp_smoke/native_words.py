"""Filters known, harmless lines from what native libraries write to standard error."""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def leaving_out(words: str) -> Iterator[None]:
    """Drops lines written to standard error in this block that contain `words`, and passes on all others at its end.

    Native code bypasses `sys.stderr`, so the file descriptor itself is redirected.
    """
    sys.stderr.flush()
    stderr = os.dup(2)
    with tempfile.TemporaryFile() as said:
        os.dup2(said.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            said.seek(0)
            for line in said:
                if words.encode() not in line:
                    sys.stderr.write(line.decode(errors="replace"))
