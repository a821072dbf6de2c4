"""Opens a binary stage in a child process first: some damaged files make USD crash, or run out of time or memory.

USD's binary format has no checksum: one byte may turn a count into billions. What a child goes through first is not
done again where it goes wrong. Text is read safely, and is not tried.
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

_BINARY = (b"PXR-USDC", b"PK\x03\x04")  # the latter are packages, which hold binary layers
_LAYER = re.compile(rb"@([^@\n]+\.usd[acz]?)\b[^@\n]*@")
# What opening a sound file may take, with room to spare: of the processor's time [s], of memory [bytes], and for each
# byte of the layers.
_SECONDS, _SECONDS_PER_BYTE = 10.0, 2e-6
_BYTES, _BYTES_PER_BYTE = 2**29, 256
_LARGE = 2**26  # bytes of layers: trying longer would cost more than it is worth
_ASLEEP = 1.0  # how long a child may wait without working [s]: for a disk that is slow, or for ever
_TRIES = 3
_LONGEST_LINE = 4096  # what a pipe takes at once
_CRASH = "it is damaged: USD crashes on it"


def check_readable(path: Path) -> None:
    """Tries whether a stage can be opened and its values read, if it or a layer that it names is binary.

    It forks, on Linux alone; elsewhere it does nothing. Where other threads are at work, a child may inherit a lock
    that nobody will open, and sleep or crash by chance: it is then tried again. What sleeps each time is left to those
    who read the stage.

    Args:
        path: the file.

    Raises:
        ValueError: it cannot.
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
    """Tries a stage in a child process; says what is wrong, or nothing, or None if the child fell asleep."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            _answer(path, theirs)
        finally:  # what else is wrong is told by whoever reads the stage afterwards
            os._exit(0)
    os.close(theirs)
    with open(ours, "rb") as pipe:
        ended = _watch(child)
        return pipe.read().decode(errors="replace") or ended


def _is_binary(path: Path, seen: set[Path]) -> bool:
    """Whether a layer, or one that it names, is binary."""
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
    """What the child does, in silence: it writes why the stage cannot be read, or nothing."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    os.dup2(nothing, 2)
    os.write(pipe, _try(path).encode()[:_LONGEST_LINE])


def _try(path: Path) -> str:
    """Opens a stage and reads values of all its attributes; says what is wrong."""
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        return usd_message(error.args[0])
    except UnicodeDecodeError:
        return "its names are not UTF-8"
    attributes = (attribute for prim in stage.TraverseAll() for attribute in prim.GetAuthoredAttributes())
    return next(filter(None, map(_torn, attributes)), "")


def _torn(attribute: Usd.Attribute) -> str:
    """What USD says of values whose bytes it cannot unpack; all else is for those to say who need the attribute."""
    try:
        times = attribute.GetTimeSamples()
        for time in (Usd.TimeCode.Default(), *times[:1], *times[-1:]):
            attribute.Get(time)
    except Tf.ErrorException as error:
        said = usd_message(error.args[0])
        return said if "unpacking" in said else ""
    except TypeError:  # a value of a kind that Python does not know
        pass
    return ""


def _watch(child: int) -> str | None:
    """Waits for the child, or ends it; says what it was that it could not do, None if it sleeps."""
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
    """What is wrong with a file that takes long, or much; nothing if it may be as good as any; None if it is early.

    Args:
        seconds: time of the processor that it has taken.
        grown: memory that it has taken [bytes].
        size: of the layers so far [bytes].
    """
    if size > _LARGE:
        return ""
    if grown > _BYTES + _BYTES_PER_BYTE * size:
        return f"it is damaged: USD takes {grown / 2**30:.1f} GiB of memory for it"
    if seconds > _SECONDS + _SECONDS_PER_BYTE * size:
        return f"it is damaged: USD does not come to its end in {seconds:.0f} s"
    return None


def _bytes_read(process: psutil.Process) -> int:
    """Bytes of the files that the child has read, or has in its memory as they are."""
    mapped = {each.path: each.size for each in process.memory_maps() if ".usd" in each.path}
    return process.io_counters().read_chars + sum(mapped.values())
