"""The folder of a run's results: where its files are, and a lock that admits one run at a time."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from warp_smoke.files import check_folder, make_folders, remove_empty
from warp_smoke.folder_lock import check_unlocked, locked
from warp_smoke.record import FieldError
from warp_smoke.scene import Scene
from warp_smoke.usd.find import RESULTS_SUFFIX


@dataclass(frozen=True)
class OutputFolder:
    """A folder that holds the results of one run.

    Attributes:
        path: path of the folder, which need not exist yet.
        name: base name of the layers and the checkpoint.
    """

    path: Path
    name: str

    @staticmethod
    def of(scene: Scene, path: str | Path | None = None) -> "OutputFolder":
        """Returns the output folder of a scene.

        Args:
            scene: the scene to run.
            path: path of the folder; `out/NAME` unless given.

        Raises:
            FieldError: the path is not a folder or not writable, another run writes to it, or the scene's stage would
                be overwritten.
        """
        name = scene.source.stem if scene.source else "scene"
        folder = OutputFolder(Path("out", name) if path is None else Path(path), name)
        if scene.source and folder.stage.resolve() == scene.source.resolve():
            allowed = "another one, since the results would overwrite the stage"
            raise FieldError(str(scene.source), "output folder", folder.path, allowed)
        check_folder(folder.path)
        check_unlocked(folder.path)
        return folder

    @property
    def stage(self) -> Path:
        """The root layer's file."""
        return self.path / f"{self.name}.usda"

    @property
    def results(self) -> Path:
        """The sublayer with the results."""
        return self.path / f"{self.name}{RESULTS_SUFFIX}"

    @property
    def checkpoint(self) -> Path:
        """The checkpoint from which an interrupted run resumes."""
        return self.path / f"{self.name}.checkpoint"

    @property
    def report(self) -> Path:
        """The report of a finished run."""
        return self.path / "report.json"

    def read_report(self) -> dict:
        """Reads the report; empty if there is none, or if it is damaged."""
        try:
            report = json.loads(self.report.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return report if isinstance(report, dict) else {}

    @contextmanager
    def held(self) -> Iterator[None]:
        """Makes the folder and keeps other runs out of it; at the end, removes folders that it made if still empty.

        Raises:
            FieldError: another run writes to it, or it holds the results of another stage.
        """
        made = make_folders([*reversed(self.path.parents), self.path])
        try:
            with locked(self.path):
                self._check_results()
                yield
        finally:
            remove_empty(made)

    def _check_results(self) -> None:
        others = [path.name for path in self.path.glob(f"*{RESULTS_SUFFIX}") if path != self.results]
        if others:
            allowed = "another one: a folder holds one result"
            raise FieldError(str(self.path), "output folder", f"that of {others[0]}", allowed)
