"""Numbers in words, for the sentences above the diagrams."""

from collections.abc import Iterable, Sequence

import numpy as np

from warp_smoke.study.case import Row


def by_problem(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Returns the rows without failures, by problem."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        if row.failure is None:
            found.setdefault(row.problem, []).append(row)
    return found


def by_method(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Returns the rows by method."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.method, []).append(row)
    return found


def best_at(rows: Sequence[Row], error: str) -> tuple[float, str, dict[str, float]]:
    """Finds the fastest method of a problem at an error that at least half of the methods reach.

    Times between two points of a line are interpolated on the diagram's logarithmic axes.

    Returns:
        The error (the median of the methods' least errors), the fastest method, and the time of each method that
        reaches it [s].
    """
    lines = {method: _descending(points, error) for method, points in by_method(rows).items()}
    target = float(np.median([line[-1][0] for line in lines.values()]))
    times = {}
    for method, line in lines.items():
        if line[-1][0] <= target:
            errors, seconds = np.log([point[0] for point in line][::-1]), np.log([point[1] for point in line][::-1])
            times[method] = float(np.exp(np.interp(np.log(target), errors, seconds)))
    return target, min(times, key=times.get), times


def _descending(points: Sequence[Row], error: str) -> list[tuple[float, float]]:
    """Returns the error and time of those points of a line that beat all faster points on it."""
    kept: list[tuple[float, float]] = []
    for row in sorted(points, key=lambda row: row.median):
        if not kept or row.errors[error] < kept[-1][0]:
            kept.append((row.errors[error], row.median))
    return kept


def number(value: float, form: str) -> str:
    """Formats a number, with a true minus sign."""
    return format(value, form).replace("-", "\N{MINUS SIGN}")


def percent(share: float) -> str:
    """Formats a share with two digits, in percent unless it is tiny, with its sign."""
    size, sign = abs(share), "−" if share < 0 else ""
    if 0 < size < 1e-6:
        return f"{sign}{size:.1e}"
    return f"{sign}{100 * size:.0f} %" if size >= 0.0995 else f"{sign}{100 * size:.2g} %"


def duration(seconds: float) -> str:
    """Formats a time with three digits and its unit, with its sign."""
    size = abs(seconds)
    unit, factor = next((each for each in _UNITS if size >= each[1]), _UNITS[-1])
    return f"{'−' if seconds < 0 else ''}{size / factor:.3g} {unit}"


_UNITS = (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9))
