"""Writes docs/cli.md from the command line's own help."""

import re
import sys
from pathlib import Path
from unittest.mock import patch

from warp_smoke.cli import app

ROOT = Path(__file__).parents[1]
HEAD = """# Command line

Written by `python scripts/cli_reference.py` from the commands' own help, which `--help` shows too.

Exit status: 0 done; 1 failed, or `validate` found errors; 2 bad input, reported in one line; 130 stopped by Ctrl-C,
143 by SIGTERM.

"""


def cli_reference() -> str:
    """Returns the reference as Markdown: a table of contents, then one section for each command."""
    with patch.object(sys, "argv", ["warp-smoke"]):  # the name shown in each command's usage
        text = app.generate_docs(output_format="markdown")
    # The program's own section repeats the README and, in another order, the table of contents.
    commands = text[text.index("- [`") : text.index("**Commands**")] + text[text.index("## warp-smoke ") :]
    return HEAD + re.sub(r"[ \t]+\n", "\n", commands).rstrip() + "\n"


if __name__ == "__main__":
    (ROOT / "docs/cli.md").write_text(cli_reference(), encoding="utf-8")
