"""Measures one case: the result is a row, whatever happens."""

from math import isfinite
from time import perf_counter

import numpy as np

from warp_smoke.launch import Launcher
from warp_smoke.study.case import REPEATS, Case, Row


def measure_case(launcher: Launcher, case: Case, gigabytes_per_second: float) -> Row:
    """Runs a case.

    Args:
        launcher: where it runs.
        case: what runs.
        gigabytes_per_second: read and written by a memory copy.

    Returns:
        The case's row. An exception that the case raises, or a number that is not finite, becomes its `failure`.
    """
    about = {
        "suite": case.suite,
        "problem": case.problem,
        "method": case.method,
        "parameters": dict(case.parameters),
        "resolution": case.resolution,
        "dt": case.dt,
        "key": case.key,
        "reference": case.reference,
    }
    began = perf_counter()
    try:
        measured = case.measure(launcher, REPEATS)
    except Exception as error:  # whatever a method does wrong is a result of the study
        failure = " ".join(f"{type(error).__name__}: {error}".split())
        return Row(**about, errors={}, **_NO_TIMES, set_up=perf_counter() - began, failure=failure)
    took = perf_counter() - began
    low, median, high = np.percentile(measured.seconds, (25, 50, 75)).tolist()
    wrong = [f"{name} is {value}" for name, value in measured.errors.items() if not isfinite(value)]
    per_cell = 1e9 * median / (measured.cells * measured.steps) if measured.cells else None
    return Row(
        **about,
        errors={name: float(value) for name, value in measured.errors.items() if isfinite(value)},
        median=median,
        quartile_low=low,
        quartile_high=high,
        repeats=len(measured.seconds),
        set_up=max(0.0, took - sum(measured.seconds) / measured.parts),
        ns_per_cell=per_cell,
        copy_share=8.0 / gigabytes_per_second / per_cell if per_cell else None,
        failure=", ".join(wrong) or None,
        passes=dict(measured.passes),
    )


_NO_TIMES = {
    "median": None,
    "quartile_low": None,
    "quartile_high": None,
    "repeats": 0,
    "ns_per_cell": None,
    "copy_share": None,
}
