"""Suppression of what USD prints to standard error while a stage is composed."""

from collections.abc import Iterator
from contextlib import contextmanager

from pxr import UsdUtils


@contextmanager
def usd_kept_quiet() -> Iterator[None]:
    """Keeps USD from printing; also a decorator. The reader reports what is wrong with a stage once, in one line."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        del delegate
