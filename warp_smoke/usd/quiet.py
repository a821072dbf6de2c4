"""What USD prints while a stage is composed, kept from standard error."""

from collections.abc import Iterator
from contextlib import contextmanager

from pxr import UsdUtils


@contextmanager
def usd_kept_quiet() -> Iterator[None]:
    """Keeps USD from printing, also as a decorator: what is wrong with a stage the reader tells, once and in a line."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        del delegate
