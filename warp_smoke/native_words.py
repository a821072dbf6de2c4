"""What native libraries say on standard error, without what is known to be no news."""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def leaving_out(words: str) -> Iterator[None]:
    """Leaves out lines with some words, and passes on whatever else is said meanwhile.

    Native code writes past Python, so the file descriptor is watched.
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
