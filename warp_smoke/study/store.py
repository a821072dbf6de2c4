"""The results on disk: rewritten after each row, so that an interrupted study resumes where it stopped."""

import csv
import json
from dataclasses import asdict
from io import StringIO
from pathlib import Path

from warp_smoke.files import write_text
from warp_smoke.record import FieldError
from warp_smoke.study.case import Row
from warp_smoke.study.disclosure import IDENTITY

RESULTS = "results.json"
_COLUMNS = ("suite", "problem", "method", "parameters", "resolution", "dt", "reference")
_TIMES = ("median", "quartile_low", "quartile_high", "repeats", "set_up", "ns_per_cell", "copy_share")


class Store:
    """The rows stored in a folder.

    Attributes:
        folder: where they are.
        disclosure: of the machine and versions that they were measured with.
        rows: by key.
    """

    def __init__(self, folder: Path, disclosure: dict):
        """Creates the folder, or continues with the results in it.

        Args:
            folder: of the study.
            disclosure: of this run.

        Raises:
            FieldError: the folder holds results from another machine, version or stage; nothing is changed.
            OSError: the folder cannot be written.
        """
        self.folder, self.disclosure, self.rows = folder, disclosure, {}
        file = folder / RESULTS
        if file.exists():
            stored, rows = read_results(file)
            for name in (*IDENTITY, "stage", "scene"):
                if stored.get(name) != disclosure.get(name):
                    allowed = f"{disclosure.get(name)}, as in this run; choose another folder, or remove this file"
                    raise FieldError(str(file), name, stored.get(name), allowed)
            self.rows = {row.key: row for row in rows}
        folder.mkdir(parents=True, exist_ok=True)
        self._write()

    def add(self, row: Row) -> None:
        """Stores a row, in memory and on disk."""
        self.rows[row.key] = row
        self._write()

    def _write(self) -> None:
        content = {"disclosure": self.disclosure, "rows": [asdict(row) for row in self.rows.values()]}
        write_text(self.folder / RESULTS, json.dumps(content, indent=1, allow_nan=False) + "\n")


def read_results(file: Path) -> tuple[dict, list[Row]]:
    """Reads what a study has stored: its disclosure and its rows.

    Raises:
        FieldError: the file does not hold the results of a study.
    """
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        return content["disclosure"], [Row(**row) for row in content["rows"]]
    except (ValueError, KeyError, TypeError):
        raise FieldError(str(file), "content", "damaged or of another kind", "the results of a study") from None


def csv_text(disclosure: dict, rows: list[Row]) -> str:
    """Returns the rows as a table of comma-separated values, with the disclosure on each."""
    names = list(dict.fromkeys(name for row in rows for name in row.errors))
    stream = StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow([*_COLUMNS, *names, *_TIMES, "failure", *disclosure])
    for row in rows:
        chosen = "; ".join(f"{name}={value}" for name, value in row.parameters.items())
        about = [row.suite, row.problem, row.method, chosen, row.resolution, row.dt, row.reference]
        errors, times = [row.errors.get(name) for name in names], [getattr(row, name) for name in _TIMES]
        table.writerow([*about, *errors, *times, row.failure, *disclosure.values()])
    return stream.getvalue()
