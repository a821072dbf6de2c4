"""Cases and rows: identity, times, orders, failures."""

from dataclasses import replace
from time import sleep

import numpy as np
import pytest
from study_rows import make_row

from warp_smoke.study.case import Case, Measured, fit_orders, time_repeats, time_steps
from warp_smoke.study.measure import measure_case
from warp_smoke.study.words import best_at, duration, percent


def _case(measure, **fields):
    about = {"suite": "s", "problem": "p", "method": "m", "parameters": {"a": 1.0}, "resolution": 8, "dt": 0.5}
    return Case(**(about | fields), measure=measure)


def test_key_tells_all_choices_apart():
    """All that a case is, and what it is measured from, is in the key; the order of parameters is not."""
    case = _case(None)
    changes = [{"suite": "x"}, {"problem": "x"}, {"method": "x"}, {"parameters": {}}, {"resolution": 9}, {"dt": None}]
    changes.append({"reference": "the finest run"})
    assert len({replace(case, **change).key for change in changes} | {case.key}) == len(changes) + 1
    assert _case(None, parameters={"a": 1, "b": 2}).key == _case(None, parameters={"b": 2, "a": 1}).key


def test_repeats_leave_the_first_call_out(launcher):
    """The action runs once more than there are times."""
    calls = []
    assert len(time_repeats(launcher, lambda: calls.append(1), 5)) == 5
    assert len(calls) == 6


@pytest.mark.parametrize("steps", [5, 7, 23])
def test_steps_run_once_each(launcher, steps):
    """The parts of a timed run make every step once and in order, whether or not they divide it evenly."""
    done = []
    assert len(time_steps(launcher, done.append, steps, 5)) == 5
    assert done == list(range(steps))


def test_fitted_order_is_that_of_a_power_law():
    """Errors C h^p give p to round-off, each line by itself; fewer than three resolutions give none."""
    rows = [
        make_row(method=method, resolution=n, errors={"l2": 3.0 * n**-p})
        for method, p in (("first", 1.0), ("second", 2.0))
        for n in (16, 32, 64)
    ]
    rows += [make_row(method="short", resolution=n, errors={"l2": 1 / n}) for n in (16, 32)]
    orders = fit_orders(rows, "l2")
    assert orders == pytest.approx({("p", "first"): 1.0, ("p", "second"): 2.0}, abs=1e-12)


def test_time_of_a_run_is_no_set_up(launcher):
    """Of a run of 60 ms in steps, whose parts are each scaled to the whole, what is left is the 40 ms before it."""

    def measure(launcher, repeats):
        sleep(0.04)
        seconds = time_steps(launcher, lambda _: sleep(0.012), 5, repeats)
        return Measured({}, seconds, 10, 5, repeats)

    row = measure_case(launcher, _case(measure), 10.0)
    assert row.set_up >= 0.039
    assert row.median >= 0.059


def test_row_has_median_quartiles_and_rates(launcher):
    """Times 1 … 5 s have median 3 and quartiles 2 and 4; per cell and step it is 3 s / (10 · 3), and 8 bytes / that."""
    measured = Measured({"l2": 0.5}, (5.0, 1.0, 3.0, 2.0, 4.0), cells=10, steps=3)
    row = measure_case(launcher, _case(lambda launcher, repeats: measured), 16.0)
    assert (row.quartile_low, row.median, row.quartile_high, row.repeats) == (2.0, 3.0, 4.0, 5)
    assert row.ns_per_cell == pytest.approx(1e8)
    assert row.copy_share == pytest.approx(0.5 / 1e8)  # a copy at 16 GB/s takes half a nanosecond for a float
    assert row.failure is None


def _raise(launcher, repeats):
    raise FloatingPointError("velocity is not\nfinite")


def test_failures_are_rows(launcher):
    """A case that raises an error, and one whose error is not a number, become rows that say so."""
    row = measure_case(launcher, _case(_raise), 16.0)
    assert (row.failure, row.median, row.errors) == ("FloatingPointError: velocity is not finite", None, {})
    measured = Measured({"l2": np.nan, "linf": 1.0}, (1.0,) * 5, None)
    row = measure_case(launcher, _case(lambda launcher, repeats: measured), 16.0)
    assert (row.failure, row.errors) == ("l2 is nan", {"linf": 1.0})


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.5, "50 %"),
        (0.998, "100 %"),
        (0.0994, "9.9 %"),
        (1.234, "123 %"),
        (-0.1, "−10 %"),
        (3.21e-5, "0.0032 %"),
        (0.0, "0 %"),
        (2e-8, "2.0e-08"),
    ],
)
def test_shares_in_words(share, text):
    """Two digits, in percent unless that is tiny."""
    assert percent(share) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(12.34, "12.3 s"), (0.0021, "2.1 ms"), (-4e-6, "−4 µs"), (7e-10, "0.7 ns"), (0.0, "0 ns")]
)
def test_times_in_words(seconds, text):
    """Three digits with the unit that suits."""
    assert duration(seconds) == text


def test_best_at_interpolates_on_logarithmic_axes():
    """Of 1/n in n s and 1/n² in 4 n s, the second is the first at the smaller error, in a time between its points."""
    rows = [make_row(method="one", key=f"a{n}", median=float(n), errors={"l2": 1 / n}) for n in (1, 4, 16)]
    rows += [make_row(method="two", key=f"b{n}", median=4.0 * n, errors={"l2": n**-2.0}) for n in (1, 16)]
    target, fastest, times = best_at(rows, "l2")
    assert target == pytest.approx((1 / 16 + 1 / 256) / 2)  # the median of two least errors is their mean
    assert times == pytest.approx({"two": 4 * target**-0.5})
    assert fastest == "two"
