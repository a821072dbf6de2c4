"""One run at a time in a folder: a lock that the operating system releases however its process ends."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic, sleep

from warp_smoke.record import FieldError

try:
    import fcntl
except ImportError:  # Windows, where runs do not keep each other out
    fcntl = None

_NAME = ".run.lock"
_PATIENCE = 0.3  # [s]


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Locks a folder for this block; the lock file, which names the process, is removed at its end.

    Raises:
        FieldError: another process, or another block in this process, holds the lock.
    """
    if fcntl is None:
        yield
        return
    lock = _take(folder)
    try:
        os.truncate(lock, 0)
        os.write(lock, str(os.getpid()).encode())
        yield
    finally:
        (folder / _NAME).unlink(missing_ok=True)  # while locked: afterwards the file may belong to another run
        os.close(lock)


def check_unlocked(folder: Path) -> None:
    """Raises FieldError if a folder is locked."""
    if fcntl is None:
        return
    try:
        lock = os.open(folder / _NAME, os.O_RDONLY)
    except FileNotFoundError:
        return
    try:
        _lock(lock, fcntl.LOCK_SH, folder)
    finally:
        os.close(lock)


def _take(folder: Path) -> int:
    """Locks a folder and returns the descriptor of the open lock file."""
    file = folder / _NAME
    while True:
        lock = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _lock(lock, fcntl.LOCK_EX, folder)
        except FieldError:
            os.close(lock)
            raise
        if _is_at(file, lock):
            return lock
        os.close(lock)  # another process has just ended and removed the file


def _lock(opened: int, kind: int, folder: Path) -> None:
    """Locks an open file, with a short wait: a lock that `check_unlocked` holds is soon released."""
    until = monotonic() + _PATIENCE
    while True:
        try:
            return fcntl.flock(opened, kind | fcntl.LOCK_NB)
        except BlockingIOError:
            if monotonic() > until:
                break
        sleep(0.01)
    process = os.pread(opened, 32, 0).decode()
    allowed = "a folder that no other run writes to"
    raise FieldError(str(folder), "output folder", f"in use by process {process}", allowed)


def _is_at(file: Path, opened: int) -> bool:
    try:
        return os.path.samestat(os.fstat(opened), file.stat())
    except FileNotFoundError:
        return False
