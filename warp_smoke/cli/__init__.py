"""The command line: turns arguments into calls, with one file for each command.

Exit status: 0 done, 1 failed, 2 bad input (one line), 130 stopped by Ctrl-C, 143 by SIGTERM.
"""

import os
import signal
import sys

from cyclopts import App, CycloptsError, Parameter
from rich.markup import escape

import warp_smoke
from warp_smoke.cli.console import err
from warp_smoke.cli.info import info
from warp_smoke.cli.plan import plan
from warp_smoke.cli.preview import preview
from warp_smoke.cli.render import render
from warp_smoke.cli.run import run
from warp_smoke.cli.study import study
from warp_smoke.cli.validate import validate
from warp_smoke.interrupt import Interrupted

app = App(
    name="warp-smoke",
    help="Smoke, its shadows and baked lighting for USD stages: only the effects that a scene calls for.",
    version=lambda: warp_smoke.__version__,
    help_format="rich",
    default_parameter=Parameter(negative=()),
    suppress_keyboard_interrupt=False,
)
for _command in (run, plan, preview, render, study, validate, info):
    app.command(_command)

_BAD_INPUT = (
    CycloptsError,
    ValueError,
    NotImplementedError,
    FileNotFoundError,
    FileExistsError,
    IsADirectoryError,
    NotADirectoryError,
    PermissionError,
)
_FAILED = (*_BAD_INPUT, OSError, ImportError, MemoryError, FloatingPointError)


def main() -> None:
    """Runs `warp-smoke`, and exits with its status."""
    try:
        status = app(sys.argv[1:], exit_on_error=False, print_error=False)
    except BrokenPipeError:  # the reader has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    except _FAILED as error:
        err.print(f"[red]error[/red] {escape(_one_line(error))}", soft_wrap=True, markup=True, highlight=False)
        status = 2 if isinstance(error, _BAD_INPUT) else 1
    except KeyboardInterrupt as stop:
        err.print(f"{stop}; --resume continues from there." if isinstance(stop, Interrupted) else "Stopped.")
        status = 128 + getattr(stop, "signal", signal.SIGINT)
    sys.exit(status or 0)


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__
