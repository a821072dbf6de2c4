"""The output folder: frames and checkpoints written in the background, then the layers and the report."""

import json
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from warp_smoke.checkpoint import Checkpoint
from warp_smoke.file_names import FileNames, computed_materials
from warp_smoke.files import make_folders, remove_empty, remove_partial, replacing, sync, write_png, write_text
from warp_smoke.fingerprint import digest
from warp_smoke.output_folder import OutputFolder
from warp_smoke.plan import DepthPlan, DomainPlan, LightPlan, ReceiverPlan, When
from warp_smoke.record import FieldError
from warp_smoke.report import environment, step_warnings
from warp_smoke.scene import Procedural
from warp_smoke.shading.procedural import make_picture
from warp_smoke.simulation import Frame, Simulation, Smoke
from warp_smoke.usd.export import result_files
from warp_smoke.usd.material import BakeResult, DepthMapResult, VertexBakeResult
from warp_smoke.usd.volume import VolumeResult, write_volume
from warp_smoke.usd.write import write_results

# Frames that may wait to be written; more would only cost memory when the disk is slower than the simulation.
_FRAMES_IN_HAND = 2
# By default a checkpoint is written if the last one took less than this share of the time since it was started.
_CHECKPOINT_SHARE = 0.05


@dataclass(frozen=True)
class Result:
    """What a run produced.

    Attributes:
        folder: the output folder.
        stage: the root layer in it.
        report: the content of report.json.
    """

    folder: Path
    stage: Path
    report: dict


class Output:
    """A context that writes frames; if it fails, it removes folders that it made and that are still empty.

    Results of an earlier run are removed first, so that no stage mixes two runs. Every file appears complete or not at
    all. A run that is cut short leaves a checkpoint and a stage with the frames made so far: both are written from time
    to time (`checkpoint_every`), and the stage also when an error ends the run.
    """

    def __init__(
        self,
        folder: OutputFolder,
        simulation: Simulation,
        fingerprint: dict[str, str],
        checkpoint_every: int | None = None,
        before: Checkpoint | None = None,
    ):
        """Prepares to write; nothing is touched before the context is entered.

        Args:
            folder: folder for the results, locked by the caller.
            simulation: makes the frames.
            fingerprint: fingerprint of the run.
            checkpoint_every: frames between checkpoints; 0 = only on interruption, None = as often as costs little.
            before: checkpoint from which the run resumes, or None.
        """
        self._place, self._folder, self._simulation, self._plan = folder, folder.path, simulation, simulation.plan
        self._fingerprint, self._every, self._before = fingerprint, checkpoint_every, before
        self._began = self._saved_at = perf_counter()
        self._saves: list[Future] = []
        self._cost = 0.0  # of the last checkpoint [s]
        self._unsynced: list[Path] = []
        self._frames: list[dict] = []
        self._names = FileNames(self._plan)
        self._volumes: dict[str, dict[int, str]] = {each.domain.path: {} for each in self._plan.domains}
        # By receiver and bake: a file, or the values at the points of a receiver without a picture, for each frame.
        self._bakes: dict[tuple[str, str], dict[int, str | np.ndarray]] = {}
        self._depth_maps: dict[str, dict[int, str]] = {path: {} for path in self._plan.depth_maps}  # by light

    def __enter__(self) -> "Output":
        pictures = self._plan.receivers or self._plan.depths or self._names.procedurals()
        inside = ["volumes"] * bool(self._plan.domains) + ["textures"] * bool(pictures)
        self._made = make_folders([self._folder / name for name in inside])
        for folder in (self._folder, self._folder / "volumes", self._folder / "textures"):
            remove_partial(folder)
        if self._before:
            self._take_over(self._before)
        else:
            self._clear()
        self._pool = ThreadPoolExecutor(1, "write")
        self._waiting: list[list[Future]] = []
        return self

    def __exit__(self, *error) -> None:
        self._pool.shutdown()
        if error[0]:
            with suppress(OSError):  # report the first error, not this one
                self._write_layers(self._whole_frames())
            remove_empty(self._made)

    def _clear(self) -> None:
        """Removes the results of an earlier run: the layers first, then the files they name."""
        place = self._place
        named = result_files(place.results)
        for path in (place.stage, place.results, place.report, place.checkpoint):
            path.unlink(missing_ok=True)
        for path in (*named, *(self._folder / "textures").glob(".*.npy")):
            path.unlink(missing_ok=True)

    def _take_over(self, before: Checkpoint) -> None:
        """Takes over the files of the frames up to a checkpoint.

        Raises:
            ValueError: one of them is missing.
        """
        self._frames = before.report["frames"]
        for made in self._frames:
            number = made["frame"]
            for each in self._plan.domains:
                path = each.domain.path
                self._volumes[path][number] = f"./{self._there(self._names.volume(path, number))}"
            for each in self._plan.receivers:
                for bake, when in each.bakes.items():
                    if when == When.FRAME or number == self._plan.scene.start:
                        values, picture = self._names.bake(each, bake, number)
                        here = (self._folder / values).exists()
                        found = np.load(self._folder / values) if here else f"./{self._there(picture)}"
                        self._bakes.setdefault((each.surface.path, bake), {})[number] = found
            for path, when in self._plan.depth_maps.items():
                if when == When.FRAME or number == self._plan.scene.start:
                    file = self._names.depth_map(path, when, number)
                    self._depth_maps[path][number] = f"./{self._there(file)}"
        seconds = before.report["seconds"]
        self._began -= seconds["frames"]
        for name, spent in seconds["passes"].items():
            self._simulation.timings.seconds[name] += spent

    def _there(self, file: str) -> str:
        path = self._folder / file
        if not path.exists():
            allowed = "a folder with all files up to the checkpoint, or no resume"
            raise FieldError(str(path), "a file of a frame before the checkpoint", "missing", allowed)
        return file

    def write(self, frame: Frame) -> None:
        """Starts writing a frame's results."""
        started = []
        if not self._frames:
            started = self._write_procedurals()
        for each in self._plan.domains:
            path = each.domain.path
            file = self._names.volume(path, frame.number)
            self._volumes[path][frame.number] = f"./{file}"
            started.append(self._start(_write_smoke, file, each, frame.smoke[path]))
        for each in self._plan.receivers:
            for bake in each.bakes:
                if (each.surface.path, bake) in frame.pictures:
                    pixels = frame.pictures[each.surface.path, bake]
                    values, picture = self._names.bake(each, bake, frame.number)
                    if pixels.dtype in (np.uint8, np.uint16):
                        started.append(self._start(write_png, picture, pixels))
                        pixels = f"./{picture}"
                    else:
                        started.append(self._start(_write_values, values, pixels))
                    self._bakes.setdefault((each.surface.path, bake), {})[frame.number] = pixels
        for path, when in self._plan.depth_maps.items():
            if (path, "depth") in frame.pictures:
                file = self._names.depth_map(path, when, frame.number)
                self._depth_maps[path][frame.number] = f"./{file}"
                started.append(self._start(write_png, file, frame.pictures[path, "depth"]))
        self._waiting.append(started)
        self._frames.append({"frame": frame.number, "domains": {path: asdict(s) for path, s in frame.steps.items()}})
        with self._simulation.timings.measure("wait_for_files"):
            self._settle(_FRAMES_IN_HAND)
        if frame.number < self._plan.scene.end and self._is_due():
            self._save()

    def _start(self, write: Callable[..., object], file: str, *content) -> Future:
        """Starts writing a file in the folder."""
        self._unsynced.append(self._folder / file)
        return self._pool.submit(write, self._folder / file, *content)

    def _is_due(self) -> bool:
        """Returns whether a checkpoint is due after the latest frame."""
        if self._every is not None:
            return self._every > 0 and len(self._frames) % self._every == 0
        return not self._saves and self._cost < _CHECKPOINT_SHARE * (perf_counter() - self._saved_at)

    def _save(self) -> None:
        """Copies the simulation's state and starts writing a checkpoint and a stage of the frames so far."""
        began = self._saved_at = perf_counter()
        with self._simulation.timings.measure("write_checkpoint"):
            passes = dict(self._simulation.timings.seconds)
            report = {
                "chosen": self._chosen(),
                "frames": list(self._frames),
                "seconds": {"frames": began - self._began, "passes": passes},
            }
            fields, last = self._simulation.save(), self._frames[-1]["frame"]
            checkpoint = Checkpoint(self._fingerprint, last, report, fields)
        copied = perf_counter() - began
        files, self._unsynced = self._unsynced, []
        before = [each for started in self._waiting for each in started]
        self._saves.append(self._pool.submit(self._write_checkpoint, checkpoint, before, files, copied))

    def _write_checkpoint(self, checkpoint: Checkpoint, before: list[Future], files: list[Path], copied: float) -> None:
        """Writes a checkpoint, once all files it relies on are on the disk, and then the stage up to its frame."""
        began = perf_counter()
        for written in before:
            written.result()
        for file in files:
            sync(file)
        checkpoint.write(self._place.checkpoint)
        self._write_layers(checkpoint.frame)
        self._cost = copied + perf_counter() - began

    def stop(self) -> int:
        """Writes a checkpoint of the frames so far and waits for all files.

        Returns:
            The number of the last frame.
        """
        self._save()
        self._settle(0)
        return self._frames[-1]["frame"]

    def _settle(self, allowed: int) -> None:
        """Waits until at most `allowed` frames remain to be written; raises any error from writing them."""
        while len(self._waiting) > allowed:
            for future in self._waiting[0]:
                future.result()
            del self._waiting[0]
        while self._saves and (allowed == 0 or self._saves[0].done()):
            self._saves.pop(0).result()

    def write_depth_maps(self) -> None:
        """Writes the current shadow maps, one grey picture per light: a cross of six faces for a cube map.

        Maps that never change and were already written for a receiver's `depth` bake are left as they are.
        """
        last = self._plan.scene.end
        for path, picture in self._simulation.depth_pictures().items():
            if self._plan.depth_maps.get(path) != When.ONCE:
                write_png(self._folder / self._names.depth_map(path, When.ONCE, last), picture)

    def finish(self, set_up: float) -> Result:
        """Writes the layers and the report once every other file is written.

        Args:
            set_up: time for loading and setting up before the first frame [s].
        """
        timings = self._simulation.timings
        with timings.measure("wait_for_files"):
            self._settle(0)
        with timings.measure("write_stage"):
            stage = self._write_layers(self._plan.scene.end)
        report = self._report(set_up, perf_counter() - self._began)
        write_text(self._place.report, json.dumps(report, indent=2) + "\n")
        for path in (self._place.checkpoint, *(self._folder / "textures").glob(".*.npy")):
            path.unlink(missing_ok=True)
        return Result(self._folder, stage, report)

    def _whole_frames(self) -> int:
        """Returns the last frame up to which every file is written; the one before the first if there is none."""
        whole = [not any(each.exception() for each in started) for started in self._waiting]
        count = whole.index(False) if False in whole else len(whole)
        return self._plan.scene.start - 1 + len(self._frames) - len(whole) + count

    def _write_layers(self, last: int) -> Path:
        """Writes the stage with the frames up to `last`; nothing if that is before the first."""
        scene = self._plan.scene
        if last < scene.start:
            return self._place.stage
        volumes = [
            VolumeResult(
                domain=d.domain, lattice=d.lattice, grids=d.grids, files=_up_to(last, self._volumes[d.domain.path])
            )
            for d in self._plan.domains
        ]
        bakes = [self._bake_result(each, bake, last) for each in self._plan.receivers for bake in each.bakes]
        bakes += [self._depth_result(each, light, last) for each in self._plan.depths for light in each.lights]
        scene = scene if last == scene.end else replace(scene, end=last)
        pictures = {path: f"./{file}" for path, file in self._names.procedurals().items()}
        return write_results(self._folder, self._place.name, scene, volumes, bakes, pictures)

    def _write_procedurals(self) -> list[Future]:
        """Starts writing the procedural textures."""
        files = self._names.procedurals()
        return [
            self._start(_write_procedural, files[material.path], material.procedural)
            for material in computed_materials(self._plan.scene)
        ]

    def _bake_result(self, each: ReceiverPlan, bake: str, last: int) -> BakeResult | VertexBakeResult:
        made = _up_to(last, self._bakes[each.surface.path, bake])
        first = next(iter(made.values()))
        made = made if each.bakes[bake] == When.FRAME else first
        if isinstance(first, str):
            return BakeResult(surface=each.surface, bake=bake, files=made)
        return VertexBakeResult(surface=each.surface, bake=bake, values=made)

    def _depth_result(self, each: DepthPlan, light: LightPlan, last: int) -> DepthMapResult:
        path = light.light.path
        made = _up_to(last, self._depth_maps[path])
        files = made if light.when == When.FRAME else next(iter(made.values()))
        return DepthMapResult(surface=each.surface, light=self._names.light(path), files=files)

    def _chosen(self) -> dict | None:
        return asdict(self._plan.chosen) if self._plan.chosen else None

    def _report(self, set_up: float, frames: float) -> dict:
        launcher, scene = self._simulation.launcher, self._plan.scene
        passes = {name: round(seconds, 6) for name, seconds in self._simulation.timings.seconds.items()}
        seconds = {"total": set_up + frames, "set_up": set_up, "frames": frames, "passes": passes}
        return {
            "stage": str(scene.source) if scene.source else None,
            "device": str(launcher.device),
            "threads": launcher.threads,
            "environment": environment(),
            "chosen": self._chosen(),
            "on_substep": self._simulation.on_substep is not None,
            "plan": [each.name + (f" [{each.method}]" if each.method else "") for each in self._plan.passes],
            "device_bytes": sum(launcher.allocated.values()),
            "seconds": seconds,
            "warnings": [
                *scene.warnings,
                *self._plan.warnings,
                *self._simulation.warnings,
                *step_warnings(self._frames),
            ],
            "resumed_after": self._before.frame if self._before else None,
            "fingerprint": digest(self._fingerprint),
            "frames": self._frames,
        }


def _write_smoke(path: Path, each: DomainPlan, smoke: Smoke) -> int:
    fields = (smoke.density, smoke.temperature, smoke.velocity, smoke.light)
    return write_volume(path, each.domain, each.lattice, *fields)


def _write_values(path: Path, values: np.ndarray) -> None:
    with replacing(path) as partial:
        np.save(partial, values)


def _write_procedural(path: Path, procedural: Procedural) -> None:
    write_png(path, make_picture(procedural).codes)


def _up_to(last: int, by_frame: dict) -> dict:
    return {number: value for number, value in list(by_frame.items()) if number <= last}  # others are still added
