"""What the commands print: results on standard output, everything else on standard error."""

from collections.abc import Callable, Iterable
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape

if TYPE_CHECKING:
    from rich.progress import Progress

    from warp_smoke.study.case import Row

# Names and values are printed verbatim: a prim named :bone: does not become an emoji.
out, err = (Console(stderr=stderr, markup=False, emoji=False) for stderr in (False, True))

# In a log, which cannot show a progress bar, a line now and then reports progress.
_SECONDS_BETWEEN_LINES = 10


def warn(warnings: Iterable[str]) -> None:
    """Prints warnings, one a line."""
    for warning in warnings:
        err.print(f"[yellow]warning[/yellow] {escape(warning)}", soft_wrap=True, markup=True, highlight=False)


def say_written(files: Iterable[Path]) -> None:
    """Prints the files that a command has written."""
    for file in files:
        out.print(f"Wrote {file}", soft_wrap=True, highlight=False)


def progress_bar() -> "Progress":
    """Returns a progress bar on the terminal; it shows nothing if there is no terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, TimeRemainingColumn(), console=err, transient=True, disable=not err.is_terminal)


class SlowLines:
    """Progress lines for a log, which has no bar: at most one every ten seconds."""

    def __init__(self, bar: "Progress"):
        self._wanted, self._said = bar.disable, monotonic()

    def say(self, line: str) -> None:
        """Prints the line if it is time for one."""
        if self._wanted and monotonic() - self._said > _SECONDS_BETWEEN_LINES:
            self._said = monotonic()
            err.print(line, highlight=False)


def say_rows(bar: "Progress") -> Callable[["Row", int, int], None]:
    """Returns a function that shows a study's progress, given each row, its number and the count of rows."""
    task = bar.add_task("Measuring (kernels are compiled on first use)", total=None)
    lines = SlowLines(bar)

    def show(row: "Row", number: int, count: int) -> None:
        bar.update(task, completed=number, total=count, description=f"{row.suite}: {row.problem}, {row.method}")
        lines.say(f"{number} of {count}: {row.suite}, {row.problem}, {row.method}")

    return show
