"""Launching: the same bits for any number of threads, slabs that cover every cell once, counts."""

import numpy as np
import pytest
import warp as wp

from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _blur_rows(rows: Rows, a: wp.array3d[float], weight: float, a_out: wp.array3d[float]):
    """a_out[i,j,k] = a[i,j,k] + weight · (a[i−1,j,k] + a[i+1,j,k]), indices clamped."""
    i, j, c = wp.tid()
    i += rows.first
    src = dense(a)
    dst = dense_store(a_out)
    left = wp.max(i - 1, 0)
    right = wp.min(i + 1, a.shape[0] - 1)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, a.shape[2])
    while k < end:
        dst[i, j, k] = bits(src[i, j, k] + weight * (src[left, j, k] + src[right, j, k]))
        k += 1


@wp.kernel
def _count_visits(rows: Rows, visits_inout: wp.array[int]):
    """visits_inout[n] += 1."""
    n = rows.first + wp.tid()
    visits_inout[n] = visits_inout[n] + 1


@pytest.mark.usefixtures("divided_launches")
@pytest.mark.parametrize("shape", [(70, 64, 64), (3, 5, 7), (1, 1, 1), (129, 33, 31)])
def test_same_bits_for_any_number_of_threads(shape):
    """1, 2 and 7 threads write bit-equal arrays, equal to NumPy's where the sum has one order."""
    values = np.random.default_rng(1).standard_normal(shape).astype(np.float32)
    results = []
    for threads in (1, 2, 7):
        launcher = Launcher("cpu", threads)
        a, out = launcher.array(values, "test"), launcher.zeros(shape, "test")
        launcher.launch(_blur_rows, shape, a, 0.25, out)
        results.append(out.numpy().copy())
    for result in results[1:]:
        np.testing.assert_array_equal(result.view(np.int32), results[0].view(np.int32))
    padded = np.concatenate([values[:1], values, values[-1:]])
    expected = values + np.float32(0.25) * (padded[:-2] + padded[2:])
    np.testing.assert_allclose(results[0], expected, rtol=3e-7, atol=1e-6)


@pytest.mark.usefixtures("divided_launches")
@pytest.mark.parametrize("threads", [1, 2, 7])
@pytest.mark.parametrize("count", [1, 6, 7, 4096, 10_001])
def test_list_launch_visits_each_item_once(threads, count):
    """Slabs of a list neither overlap nor leave gaps."""
    launcher = Launcher("cpu", threads)
    visits = launcher.zeros(count, "test", dtype=int)
    launcher.launch_each(_count_visits, count, visits)
    np.testing.assert_array_equal(visits.numpy(), 1)


def test_replay_takes_new_arguments(launcher):
    """A launch recorded once is replayed with the arrays and scalars of each call, not with the first ones."""
    shape = (4, 4, 8)
    one, two = (launcher.array(np.full(shape, v, np.float32), "test") for v in (1.0, 2.0))
    out, other = launcher.zeros(shape, "test"), launcher.zeros(shape, "test")
    launcher.launch(_blur_rows, shape, one, 0.5, out)
    launcher.launch(_blur_rows, shape, two, 1.0, other)
    launcher.launch(_blur_rows, shape, two, 0.0, out)
    np.testing.assert_array_equal(out.numpy(), 2.0)
    np.testing.assert_array_equal(other.numpy(), 6.0)


@pytest.mark.parametrize("name", ["gpu", "cuda:99"])
def test_unknown_device(name):
    """A device that is not there is named with those that are."""
    with pytest.raises(ValueError, match=f"device is {name}; allowed here: cpu"):
        Launcher(name)


def test_rows_of_another_length_are_recorded_anew(launcher):
    """Grids that differ only along k are covered whole, in either order."""
    for cells in (3, 8, 3):
        a = launcher.array(np.ones((2, 1, cells), np.float32), "test")
        out = launcher.zeros((2, 1, cells), "test")
        launcher.launch(_blur_rows, (2, 1, cells), a, 0.5, out)
        np.testing.assert_array_equal(out.numpy(), 2.0)


def test_keeps_so_many_recorded_launches(device, monkeypatch):
    """Ever new shapes do not keep ever more arrays alive, and launches that were dropped are recorded again."""
    monkeypatch.setattr("warp_smoke.launch._MOST_RECORDED", 3)
    launcher = Launcher(device)
    for count in (1, 2, 3, 4, 5, 1):
        visits = launcher.zeros(count, "test", dtype=int)
        launcher.launch_each(_count_visits, count, visits)
        np.testing.assert_array_equal(visits.numpy(), 1)
    assert len(launcher._recorded) == 3


def test_counts_launches_and_bytes(device):
    """Every launch and every byte is counted by name, and an empty launch does nothing."""
    launcher = Launcher(device, 2)
    visits = launcher.zeros(10, "visits", dtype=int)
    for _ in range(3):
        launcher.launch_each(_count_visits, 10, visits)
    launcher.launch_each(_count_visits, 0, visits)
    assert launcher.launches == {"_count_visits": 3}
    assert launcher.allocated == {"visits": 40}


@pytest.mark.parametrize(("seconds_a_row", "slabs"), [(1e-6, 1), (100e-6, 2)])
def test_only_long_launches_are_divided(monkeypatch, seconds_a_row, slabs):
    """By a clock that says how long rows take, 64 of them go to two threads if that is worth it, and else to one."""
    handed_over = []

    class Clock:
        now, rows = 0.0, 0

        def __call__(self):
            Clock.now += seconds_a_row * Clock.rows
            return Clock.now

    class Command:
        def __init__(self, rows):
            self.rows = rows

        def launch(self):
            Clock.rows = self.rows

    monkeypatch.setattr("warp_smoke.launch.perf_counter", Clock())
    monkeypatch.setattr("warp_smoke.launch._Worker.start", lambda worker, command: handed_over.append(command))
    monkeypatch.setattr("warp_smoke.launch._Worker.join", lambda worker: None)
    monkeypatch.setattr("warp_smoke.launch.wp.launch", lambda kernel, dim, **_: Command(dim[0]))
    launcher = Launcher("cpu", 2)
    for _ in range(2):
        handed_over.clear()
        Clock.rows = 0
        launcher.launch(_blur_rows, (64, 64, 64))
    assert len(handed_over) == slabs - 1


def test_recorded_passes_run_again(launcher):
    """Replaying passes does what launching them does, on what the arrays hold by then; also among other launches."""
    shape = (33, 32, 32)
    a, b, other = (launcher.zeros(shape, "test") for _ in range(3))

    def passes():
        launcher.launch(_blur_rows, shape, a, 0.25, b)
        launcher.launch(_blur_rows, shape, b, 0.5, a)

    replay = launcher.record(passes)
    values = np.random.default_rng(2).standard_normal(shape).astype(np.float32)
    results = []
    for run in (passes, replay):
        a.assign(values)
        launcher.launch(_blur_rows, shape, a, 0.75, other)
        run()
        results.append(a.numpy().copy())
    np.testing.assert_array_equal(*results)
