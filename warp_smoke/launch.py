"""The one way kernels are launched: runs of cells, slabs over CPU threads, one cell per thread on CUDA.

A grid kernel covers `rows.run` cells along k for each (i, j, c) of its launch:

    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, a.shape[2])
    while k < end: ...

On the CPU a run is a whole row, so that LLVM can vectorise the loop, and slabs of i go to threads if the launch takes
long enough to be worth it; on CUDA a run is one cell. A list kernel covers one item, `rows.first + wp.tid()`. Kernels
write each element from one thread only and use no atomics, so results are bit-identical however a launch is divided.
"""

import os
import threading
from collections import Counter
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from math import prod
from queue import SimpleQueue
from time import perf_counter

import numpy as np
import psutil
import warp as wp

from warp_smoke.native_words import leaving_out

wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
wp.set_module_options({"enable_backward": False})

# Waking a thread and waiting for it took 100 to 190 µs on two shared cores: it needs at least that much work.
_SECONDS_WORTH_A_THREAD = 150e-6
# Assumed cost of a cell, a mesh query and a list item until a kernel has been timed.
_SECONDS_A_CELL, _SECONDS_A_QUERY, _SECONDS_AN_ITEM = 10e-9, 600e-9, 150e-9
# The shortest time so far counts, as a busy machine only adds to it, but may grow this much a launch, as work may.
_GROWTH = 1.25
# Recorded launches to keep, each with its last arrays: more than a step of the busiest scene needs.
_MOST_RECORDED = 4096


@wp.struct
class Rows:
    """The part of a launch that one host thread covers: rows from `first` on, `run` cells along k per kernel thread."""

    first: int
    run: int


@wp.func
def dense(a: wp.array3d[float]):
    """Returns the same array [nx, ny, nz] with strides derived from its shape, so LLVM sees contiguous inner loops."""
    return wp.array(ptr=a.ptr, shape=(a.shape[0], a.shape[1], a.shape[2]), dtype=float)


@wp.func
def dense_store(a: wp.array3d[float]):
    """Like `dense`, but as integers: a store `b[i, j, k] = bits(x)` cannot alias a float that is loaded later.

    This lets LLVM vectorise kernels that gather or read many arrays. Only for arrays that the launch does not read.
    """
    return wp.array(ptr=a.ptr, shape=(a.shape[0], a.shape[1], a.shape[2]), dtype=wp.int32)


@wp.func
def bits(x: float):
    """Returns the bits of a float as an integer, for `dense_store`."""
    return wp.cast(x, wp.int32)


@cache
def _start_warp() -> None:
    """Starts Warp, without its message about a missing CUDA driver, as expected on a machine without a GPU."""
    with leaving_out("Could not find or load the NVIDIA CUDA driver"):
        wp.init()


def available_threads() -> int:
    """Returns how many CPU threads this process may run at once."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


class _Worker:
    """A thread that runs one recorded launch at a time."""

    def __init__(self):
        self._todo, self._done = SimpleQueue(), SimpleQueue()
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self):
        while (command := self._todo.get()) is not None:
            try:
                command.launch()
            except BaseException as error:
                self._done.put(error)
            else:
                self._done.put(None)

    def start(self, command: wp.Launch) -> None:
        self._todo.put(command)

    def join(self) -> None:
        if (error := self._done.get()) is not None:
            raise error

    def stop(self) -> None:
        self._todo.put(None)


class _Recorded:
    """Launches of one kernel over one shape, one for each slab, replayed with new arguments."""

    def __init__(self, commands: list, args: tuple):
        self.commands, self._args = commands, list(args)

    def set(self, args: tuple) -> None:
        for index, (old, new) in enumerate(zip(self._args, args, strict=True)):
            if new is old or (type(new) in (int, float) and new == old):
                continue
            for command in self.commands:
                command.set_param_at_index(index + 1, new)
            self._args[index] = new


class Launcher:
    """Launches kernels on one device, allocates there, and counts both.

    Raises:
        ValueError: the device does not exist, or threads is less than 1.

    Attributes:
        device: the Warp device.
        threads: CPU threads (1 on CUDA).
        launches: launches so far, by kernel name; a replay counts as one launch of "recorded passes".
        allocated: bytes allocated so far, by label.
    """

    def __init__(self, device: str = "cpu", threads: int | None = None):
        _start_warp()
        allowed = [each.alias for each in wp.get_devices()] + ["cuda"] * wp.is_cuda_available()
        if device not in allowed:
            raise ValueError(f"device is {device}; allowed here: {', '.join(allowed)}")
        if threads is not None and threads < 1:
            raise ValueError(f"threads is {threads}; allowed: whole numbers from 1")
        self.device = wp.get_device(device)
        self.threads = (threads or available_threads()) if self.device.is_cpu else 1
        self.launches, self.allocated = Counter(), Counter()
        self._recorded = {}
        self._recording = False
        self._seconds = {}  # time for a cell or item, by kernel and bit length of their number
        self._workers = [_Worker() for _ in range(self.threads - 1)]

    def __del__(self):
        for worker in getattr(self, "_workers", ()):
            worker.stop()

    def available_bytes(self) -> int:
        """Returns the free memory of the device [bytes]."""
        if self.device.is_cuda:
            return self.device.free_memory
        return psutil.virtual_memory().available

    def zeros(self, shape, label: str, dtype=float) -> wp.array:
        """Allocates a contiguous array of zeros, counted under a label.

        Raises:
            MemoryError: the device has no room for it.
        """
        try:
            array = wp.zeros(shape, dtype=dtype, device=self.device)
        except RuntimeError:
            raise MemoryError(f"no room on {self.device} for {label}, an array of {shape}") from None
        self.allocated[label] += array.capacity
        return array

    def array(self, values: np.ndarray, label: str, dtype=None) -> wp.array:
        """Copies a NumPy array to the device, counted under a label."""
        array = wp.array(values, dtype=dtype or wp.dtype_from_numpy(values.dtype), device=self.device)
        self.allocated[label] += array.capacity
        return array

    def launch(self, kernel: wp.Kernel, shape: tuple[int, int, int], *args) -> None:
        """Runs a grid kernel over `shape` [ni, nj, nk] cells; its first parameter, Rows, is filled in.

        Arrays must be contiguous; structs must not be changed after their first launch.
        """
        ni, nj, nk = shape
        run = max(nk, 1) if self.device.is_cpu else 1
        self._launch(kernel, ni, (nj, -(-nk // run)), run, _SECONDS_A_CELL, args)

    def launch_queries(self, kernel: wp.Kernel, shape: tuple[int, int, int], *args) -> None:
        """Like `launch`, for kernels that query a mesh in each cell."""
        ni, nj, nk = shape
        run = max(nk, 1) if self.device.is_cpu else 1
        self._launch(kernel, ni, (nj, -(-nk // run)), run, _SECONDS_A_QUERY, args)

    def launch_each(self, kernel: wp.Kernel, count: int, *args) -> None:
        """Runs a list kernel with one thread per item; its first parameter, Rows, is filled in."""
        self._launch(kernel, count, (), 1, _SECONDS_AN_ITEM, args)

    def record(self, passes: Callable[[], None]) -> Callable[[], None]:
        """Runs passes on this thread, and returns a function that replays them with the same arrays and numbers.

        On the CPU a replay takes 1 µs per launch instead of 9. Recording takes about 0.1 ms per launch; meanwhile no
        other thread may launch anything, as Warp would record that too.
        """
        passes()  # so that no kernel is compiled while recording
        self._recording = True
        try:
            with wp.ScopedCapture(self.device, force_module_load=False) as capture:
                passes()
        finally:
            self._recording = False

        def replay():
            self.launches["recorded passes"] += 1
            wp.capture_launch(capture.graph)

        return replay

    def _launch(self, kernel, rows: int, inner: tuple, run: int, seconds: float, args: tuple) -> None:
        """Launches `rows` rows of `inner` runs; a cell or item is assumed to take `seconds` until it has been timed."""
        if rows == 0 or 0 in inner:
            return
        self.launches[kernel.key] += 1
        row = prod(inner) * run
        size = kernel, (rows * row).bit_length()
        expected = self._seconds.get(size, seconds) * rows * row
        threads = 1 if self._recording else self.threads
        slabs = min(threads, rows, max(1, int(expected / _SECONDS_WORTH_A_THREAD)))
        key = (kernel, rows, inner, run, slabs)
        recorded = self._recorded.get(key)
        if recorded is None:
            if len(self._recorded) >= _MOST_RECORDED:  # moving boxes keep bringing new shapes: drop the oldest
                del self._recorded[next(iter(self._recorded))]
            bounds = [rows * n // slabs for n in range(slabs + 1)]
            commands = []
            for first, end in pairwise(bounds):
                part = Rows()
                part.first, part.run = first, run
                dim = (end - first, *inner)
                commands.append(wp.launch(kernel, dim, inputs=[part, *args], device=self.device, record_cmd=True))
            recorded = self._recorded[key] = _Recorded(commands, args)
        recorded.set(args)
        first, *others = recorded.commands
        for worker, command in zip(self._workers, others, strict=False):
            worker.start(command)
        began = perf_counter()
        try:
            first.launch()
        finally:
            took = (perf_counter() - began) / (rows // slabs * row)
            for worker, _ in zip(self._workers, others, strict=False):
                worker.join()
        if not self._recording:
            self._seconds[size] = min(took, _GROWTH * self._seconds.get(size, took))

    def synchronize(self) -> None:
        """Waits for the device before a clock is read (the CPU needs no wait)."""
        if self.device.is_cuda:
            wp.synchronize_device(self.device)


def load_kernels(modules: list[str], device: str = "cpu") -> None:
    """Compiles and loads the kernels of Python modules in parallel; Warp caches them after the first time."""
    wp.force_load(device=device, modules=[wp.get_module(name) for name in modules], max_workers=available_threads())
