"""Frozen records compared by value, arrays included, and the one error that a bad field raises."""

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

# Beyond this, force × time and area × area would overflow the single precision of the fields.
LARGEST = 1e9
SMALLEST = 1e-9
# For values that are bounded where they are used: light, and distances that stand for "no end".
VAST = 1e38


class FieldError(ValueError):
    """A value that is not allowed: one line naming the prim path, the field, the value and what is allowed."""

    def __init__(self, path: str, field: str, value: object, allowed: str):
        super().__init__(f"{path}: {field} is {' '.join(str(value).split())}; allowed: {allowed}")
        self.path, self.field, self.value, self.allowed = path, field, value, allowed


def _equal(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(np.asarray(a), np.asarray(b))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_equal, a, b))
    return a == b


def _brief(value: object) -> str:
    """Returns a short text for a value: a shape for an array, a count for a long tuple."""
    if isinstance(value, np.ndarray):
        return f"<{value.dtype} {list(value.shape)}>"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key!r}: {_brief(each)}" for key, each in value.items()) + "}"
    if isinstance(value, tuple) and len(value) > 8:
        return f"<{len(value)} of {type(value[0]).__name__}>"
    if isinstance(value, tuple):
        return "(" + ", ".join(map(_brief, value)) + ("," if len(value) == 1 else "") + ")"
    return repr(value)


def _quoted(value: object) -> object:
    """Returns a value for an error message about its type, with text in quotes, as "1" would read like a number."""
    return f'"{value}"' if isinstance(value, str) else value


@dataclass(frozen=True, eq=False)
class Record:
    """Base of the scene's dataclasses: equal if every field is equal."""

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return all(_equal(getattr(self, f.name), getattr(other, f.name)) for f in fields(self) if f.compare)

    __hash__ = None

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        cls.__repr__ = Record.__repr__  # in place of the one that @dataclass would write, which prints whole arrays

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{f.name}={_brief(getattr(self, f.name))}' for f in fields(self))})"

    def _store(self, field: str, value: object) -> None:
        """Sets a field of the frozen record; for `__post_init__` only."""
        object.__setattr__(self, field, value)


@dataclass(frozen=True, eq=False)
class Samples(Record):
    """A value that changes over time: linear between samples (booleans are held), constant outside them.

    Attributes:
        times: time codes, strictly increasing, [t].
        values: the value at each time code, [t, ...].
    """

    times: np.ndarray
    values: np.ndarray

    def __post_init__(self):
        self._store("times", read_only(self.times, np.float64))
        self._store("values", read_only(self.values, None))
        if self.times.ndim != 1 or not len(self.times) or len(self.times) != len(self.values):
            raise ValueError(
                f"times has shape {self.times.shape} and values {self.values.shape}; allowed: [t] and [t, ...]"
            )
        if not np.all(np.diff(self.times) > 0):
            raise ValueError(f"times is {self.times}; allowed: strictly increasing time codes")

    def at(self, time: float) -> np.ndarray:
        """Returns the value at a time code."""
        right = int(np.searchsorted(self.times, time, side="right"))
        if right == 0 or right == len(self.times) or self.values.dtype == bool:
            return self.values[max(right - 1, 0)]
        t0, t1 = self.times[right - 1 : right + 1]
        weight = (time - t0) / (t1 - t0)
        return ((1.0 - weight) * self.values[right - 1] + weight * self.values[right]).astype(self.values.dtype)


def value_at(value: object, time: float) -> object:
    """Returns a field's value at a time code, whether it changes over time (`Samples`) or not."""
    return value.at(time) if isinstance(value, Samples) else value


def each_value(value: object) -> np.ndarray:
    """Returns all samples of a field, [t, ...], for checks and bounds."""
    return value.values if isinstance(value, Samples) else np.asarray(value)[None]


def read_only(value: object, dtype: type | None) -> np.ndarray:
    """Returns a read-only contiguous view of the values, copied only if needed."""
    array = np.ascontiguousarray(value, dtype=dtype)
    array = array.view()
    array.flags.writeable = False
    return array


def finite(path: str, field: str, value: object, shape: tuple[int, ...] = (), largest: float = LARGEST) -> object:
    """Checks a finite number or an array of `shape`, from −largest to largest; may change over time.

    Returns:
        A float for an empty shape, else a tuple of floats ([3]) or a read-only float64 array; Samples stay Samples.
    """
    expected = "a finite number" if shape == () else f"{' × '.join(map(str, shape))} finite numbers"
    try:
        values = np.asarray(each_value(value), np.float64)
    except (TypeError, ValueError):
        raise FieldError(path, field, _quoted(value), expected) from None
    if values.shape[1:] != shape or not np.all(np.isfinite(values)):
        raise FieldError(path, field, value, expected)
    if np.any(np.abs(values) > largest):
        raise FieldError(path, field, value, f"−{largest:g} to {largest:g}")
    if isinstance(value, Samples):
        return Samples(value.times, values)
    if shape == ():
        return float(values[0])
    return tuple(values[0].tolist()) if len(shape) == 1 else read_only(values[0], np.float64)


def at_least(
    path: str,
    field: str,
    value: object,
    low: float = 0.0,
    shape: tuple[int, ...] = (),
    largest: float = LARGEST,
) -> object:
    """Like `finite`, with every number ≥ low."""
    checked = finite(path, field, value, shape, largest)
    if np.any(each_value(checked) < low):
        raise FieldError(path, field, value, f"≥ {low:g}")
    return checked


def positive(path: str, field: str, value: object, shape: tuple[int, ...] = (), largest: float = LARGEST) -> object:
    """Like `finite`, with every number > 0 and large enough to have a useful inverse."""
    checked = finite(path, field, value, shape, largest)
    if np.any(each_value(checked) <= 0.0):
        raise FieldError(path, field, value, "> 0")
    if np.any(each_value(checked) < SMALLEST):
        raise FieldError(path, field, value, f"≥ {SMALLEST:g}")
    return checked


def whole(path: str, field: str, value: object, low: int, high: int) -> int:
    """Checks a whole number from low to high."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
        raise FieldError(path, field, _quoted(value), f"whole numbers from {low} to {high}")
    return int(value)


def one_of(path: str, field: str, value: object, allowed: tuple[str, ...]) -> str:
    """Checks that a value is one of the allowed tokens."""
    if not isinstance(value, str) or value not in allowed:
        raise FieldError(path, field, value, ", ".join(allowed))
    return value


def tokens(path: str, field: str, value: object, allowed: tuple[str, ...]) -> tuple[str, ...]:
    """Checks a list of allowed tokens."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise FieldError(path, field, _quoted(value), "a list of " + ", ".join(allowed))
    return tuple(one_of(path, field, token, allowed) for token in value)


def paths(path: str, field: str, value: object) -> tuple[str, ...]:
    """Checks a list of prim paths."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise FieldError(path, field, _quoted(value), "a list of prim paths")
    found = tuple(value)
    if not all(isinstance(each, str) for each in found):
        raise FieldError(path, field, found, "a list of prim paths")
    return found


def flag(path: str, field: str, value: object) -> bool:
    """Checks a boolean that may not change over time."""
    if not isinstance(value, bool | np.bool_):
        raise FieldError(path, field, _quoted(value), "true or false")
    return bool(value)


def switch(path: str, field: str, value: object) -> bool | Samples:
    """Checks a boolean that may change over time."""
    values = np.asarray(each_value(value))
    if values.dtype != bool or values.ndim != 1:
        raise FieldError(path, field, _quoted(value), "true or false")
    return value if isinstance(value, Samples) else bool(values[0])
