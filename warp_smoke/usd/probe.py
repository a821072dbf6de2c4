"""Tests a binary stage in a child process first: some damaged files make USD crash, or use up time or memory.

USD's binary format has no checksum: one damaged byte may turn a count into billions. If the child fails, the stage is
not opened here. Text layers are safe to read, and are not tested.
"""

import contextlib
import os
import re
import signal
import sys
from pathlib import Path
from time import monotonic, sleep

import psutil
from pxr import Tf, Usd

from warp_smoke.usd.read import usd_message

_BINARY = (b"PXR-USDC", b"PK\x03\x04")  # the second marks packages, which hold binary layers
_LAYER = re.compile(rb"@([^@\n]+\.usd[acz]?)\b[^@\n]*@")
# What opening an intact file may need, with a margin: processor time [s] and memory [bytes], as a constant and for each
# byte of its layers.
_SECONDS, _SECONDS_PER_BYTE = 10.0, 2e-6
_BYTES, _BYTES_PER_BYTE = 2**29, 256
_LARGE = 2**26  # bytes of layers beyond which testing on costs more than it is worth
_ASLEEP = 1.0  # how long a child may be idle [s]: on a slow disk, or in a deadlock
_TRIES = 3
_LONGEST_LINE = 4096  # bytes that a pipe takes at once
_CRASH = "it is damaged: USD crashes on it"


def check_readable(path: Path) -> None:
    """Checks that a stage can be opened and its values read, if it or a layer that it names is binary.

    This forks on Linux; elsewhere it does nothing. If other threads are running, a child may inherit a lock that is
    never released, and hang or crash by chance: it is then tried again. If it hangs every time, the stage passes.

    Args:
        path: the file.

    Raises:
        ValueError: it cannot be opened or read.
    """
    if sys.platform != "linux" or not _is_binary(path, set()):
        return
    for _ in range(_TRIES):
        said = _in_child(path)
        if said is not None and not said.startswith(_CRASH):
            break
    if said:
        raise ValueError(f"{path}: not a USD stage: {said}")


def _in_child(path: Path) -> str | None:
    """Tests a stage in a child process; returns what is wrong, empty if nothing is, or None if the child hangs."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            _answer(path, theirs)
        finally:  # other errors are reported by whoever reads the stage next
            os._exit(0)
    os.close(theirs)
    with open(ours, "rb") as pipe:
        ended = _watch(child)
        return pipe.read().decode(errors="replace") or ended


def _is_binary(path: Path, seen: set[Path]) -> bool:
    """Returns whether a layer, or one that it names, is binary."""
    if path in seen or not path.is_file():
        return False
    seen.add(path)
    with path.open("rb") as file:
        if file.read(8).startswith(_BINARY):
            return True
        file.seek(0)
        named = set(_LAYER.findall(file.read()))
    return any(_is_binary(path.parent / os.fsdecode(name), seen) for name in named)


def _answer(path: Path, pipe: int) -> None:
    """Runs in the child, without output: writes to the pipe why the stage cannot be read, or nothing."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    os.write(pipe, _try(path).encode()[:_LONGEST_LINE])


def _try(path: Path) -> str:
    """Opens a stage and reads values of all its attributes; returns what is wrong, empty if nothing is."""
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        return usd_message(error.args[0])
    except UnicodeDecodeError:
        return "its names are not UTF-8"
    attributes = (attribute for prim in stage.TraverseAll() for attribute in prim.GetAuthoredAttributes())
    return next(filter(None, map(_torn, attributes)), "")


def _torn(attribute: Usd.Attribute) -> str:
    """Returns USD's message on values that it cannot unpack; other errors are left to those who need the attribute."""
    try:
        times = attribute.GetTimeSamples()
        for time in (Usd.TimeCode.Default(), *times[:1], *times[-1:]):
            attribute.Get(time)
    except Tf.ErrorException as error:
        said = usd_message(error.args[0])
        return said if "unpacking" in said else ""
    except TypeError:  # a value of a type that Python does not know
        pass
    return ""


def _watch(child: int) -> str | None:
    """Waits for the child, or ends it; returns what is wrong, empty if nothing is, or None if the child hangs."""
    process, before, pause = psutil.Process(child), psutil.Process().memory_info().data, 0.001
    worked, woke = 0.0, monotonic()
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return _crash(os.WTERMSIG(status)) if os.WIFSIGNALED(status) else ""
        sleep(pause)
        pause = min(2.0 * pause, 0.02)
        with contextlib.suppress(psutil.Error):  # it has just ended
            used, grown = process.cpu_times(), process.memory_info().data - before
            seconds = used.user + used.system
            if seconds > worked or process.status() == psutil.STATUS_RUNNING:
                worked, woke = seconds, monotonic()
            asleep = monotonic() - woke > _ASLEEP
            enough = seconds > _SECONDS or grown > _BYTES
            said = _judge(seconds, grown, _bytes_read(process)) if enough and not asleep else None
            if asleep or said is not None:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return said


def _crash(number: int) -> str:
    return f"{_CRASH} ({signal.Signals(number).name})"


def _judge(seconds: float, grown: int, size: int) -> str | None:
    """Judges a file that takes much time or memory: what is wrong, empty if it is too large to test, None to go on.

    Args:
        seconds: processor time used so far.
        grown: memory allocated so far [bytes].
        size: size of the layers read so far [bytes].
    """
    if size > _LARGE:
        return ""
    if grown > _BYTES + _BYTES_PER_BYTE * size:
        return f"it is damaged: USD takes {grown / 2**30:.1f} GiB of memory to open it"
    if seconds > _SECONDS + _SECONDS_PER_BYTE * size:
        return f"it is damaged: USD does not finish opening it in {seconds:.0f} s"
    return None


def _bytes_read(process: psutil.Process) -> int:
    """Returns the bytes of the layers that the child has read or memory-mapped."""
    mapped = {each.path: each.size for each in process.memory_maps() if ".usd" in each.path}
    return process.io_counters().read_chars + sum(mapped.values())
