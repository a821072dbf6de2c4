"""The output folder: frames written in the background, then the layers and the report."""

import json
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from warp_smoke.files import write_png, write_text
from warp_smoke.plan import DomainPlan, ReceiverPlan, When
from warp_smoke.record import FieldError
from warp_smoke.report import environment
from warp_smoke.scene import Material, Scene
from warp_smoke.shading.procedural import make_picture
from warp_smoke.simulation import Frame, Simulation, Smoke
from warp_smoke.usd.export import result_files
from warp_smoke.usd.material import BakeResult, VertexBakeResult
from warp_smoke.usd.volume import VolumeResult, write_volume
from warp_smoke.usd.write import RESULTS_SUFFIX, write_results

# Frames that may wait to be written; more would only cost memory when the disk is slower than the simulation.
_FRAMES_IN_HAND = 2


@dataclass(frozen=True)
class Result:
    """What a run left behind.

    Attributes:
        folder: the output folder.
        stage: its root layer.
        report: the content of report.json.
    """

    folder: Path
    stage: Path
    report: dict


class Output:
    """A context in which frames are written; folders that it made and that stay empty are removed if it fails.

    The stage and report of an earlier run go first and come last, so that a run that is cut short leaves no stage that
    mixes two runs. Volumes and textures that the earlier results named and the new ones do not are removed.
    """

    def __init__(self, folder: Path, name: str, simulation: Simulation):
        self._folder, self._name, self._simulation, self._plan = folder, name, simulation, simulation.plan
        self._began = perf_counter()
        self._frames: list[dict] = []
        self._stems = _file_stems([each.domain.path for each in self._plan.domains])
        self._stems |= _file_stems([each.surface.path for each in self._plan.receivers])
        self._volumes: dict[str, dict[int, str]] = {each.domain.path: {} for each in self._plan.domains}
        # By receiver and bake: a file, or the values at the points of a receiver without a picture, for each frame.
        self._bakes: dict[tuple[str, str], dict[int, str | np.ndarray]] = {}

    def __enter__(self) -> "Output":
        _check_folder(self._folder, self._name)
        pictures = self._plan.receivers or computed_materials(self._plan.scene)
        inside = ["volumes"] * bool(self._plan.domains) + ["textures"] * bool(pictures)
        self._made = _make_folders(self._folder, inside)
        self._earlier = result_files(self._folder / f"{self._name}{RESULTS_SUFFIX}")
        for earlier in (f"{self._name}.usda", f"{self._name}.results.usdc", "report.json"):
            (self._folder / earlier).unlink(missing_ok=True)
        self._pool = ThreadPoolExecutor(1, "write")
        self._waiting: list[list[Future]] = []
        return self

    def __exit__(self, *error) -> None:
        self._pool.shutdown(cancel_futures=True)
        if error[0]:
            for folder in reversed(self._made):
                if not any(folder.iterdir()):
                    folder.rmdir()

    def write(self, frame: Frame) -> None:
        """Takes a frame's results and starts writing them."""
        started = []
        for each in self._plan.domains:
            path = each.domain.path
            file = f"volumes/{self._stems[path]}.{frame.number:04d}.vdb"
            self._volumes[path][frame.number] = f"./{file}"
            started.append(self._pool.submit(_write_smoke, self._folder / file, each, frame.smoke[path]))
        for each in self._plan.receivers:
            for bake, when in each.bakes.items():
                if (each.surface.path, bake) in frame.pictures:
                    pixels = frame.pictures[each.surface.path, bake]
                    number = f".{frame.number:04d}" if when == When.FRAME else ""
                    baked = f"textures/{self._stems[each.surface.path]}.{bake}{number}.png"
                    if pixels.dtype in (np.uint8, np.uint16):
                        started.append(self._pool.submit(write_png, self._folder / baked, pixels))
                        pixels = f"./{baked}"
                    self._bakes.setdefault((each.surface.path, bake), {})[frame.number] = pixels
        self._waiting.append(started)
        self._frames.append({"frame": frame.number, "domains": {path: asdict(s) for path, s in frame.steps.items()}})
        with self._simulation.timings.measure("wait_for_files"):
            self._settle(_FRAMES_IN_HAND)

    def _settle(self, allowed: int) -> None:
        """Waits until no more than `allowed` frames wait to be written; raises what went wrong with one."""
        while len(self._waiting) > allowed:
            for future in self._waiting.pop(0):
                future.result()

    def write_depth_maps(self) -> None:
        """Writes the shadow maps as they now stand, one grey picture a light: a cross of six faces for a cube map."""
        pictures = self._simulation.depth_pictures()
        for path, stem in _file_stems(list(pictures)).items():
            write_png(self._folder / f"textures/{stem}.depth.png", pictures[path])

    def finish(self, set_up: float) -> Result:
        """Writes the layers and the report once every other file is there.

        Args:
            set_up: time that loading and setting up took before the first frame [s].
        """
        timings = self._simulation.timings
        with timings.measure("wait_for_files"):
            self._settle(0)
        with timings.measure("write_stage"):
            volumes = [
                VolumeResult(domain=d.domain, lattice=d.lattice, grids=d.grids, files=self._volumes[d.domain.path])
                for d in self._plan.domains
            ]
            bakes = [self._bake_result(each, bake) for each in self._plan.receivers for bake in each.bakes]
            pictures = self._write_procedurals()
            stage = write_results(self._folder, self._name, self._plan.scene, volumes, bakes, pictures)
            for left in self._earlier - result_files(self._folder / f"{self._name}{RESULTS_SUFFIX}"):
                left.unlink(missing_ok=True)
        report = self._report(set_up, perf_counter() - self._began)
        write_text(self._folder / "report.json", json.dumps(report, indent=2) + "\n")
        return Result(self._folder, stage, report)

    def _write_procedurals(self) -> dict[str, str]:
        """Writes the pictures that materials ask to be computed; gives their files by the material's path."""
        found = {material.path: material.procedural for material in computed_materials(self._plan.scene)}
        files = {path: f"textures/{stem}.procedural.png" for path, stem in _file_stems(list(found)).items()}
        for path, file in files.items():
            write_png(self._folder / file, make_picture(found[path]).codes)
        return {path: f"./{file}" for path, file in files.items()}

    def _bake_result(self, each: ReceiverPlan, bake: str) -> BakeResult | VertexBakeResult:
        made = self._bakes[each.surface.path, bake]
        first = next(iter(made.values()))
        made = made if each.bakes[bake] == When.FRAME else first
        if isinstance(first, str):
            return BakeResult(surface=each.surface, bake=bake, files=made)
        return VertexBakeResult(surface=each.surface, bake=bake, values=made)

    def _report(self, set_up: float, frames: float) -> dict:
        launcher, scene = self._simulation.launcher, self._plan.scene
        passes = {name: round(seconds, 6) for name, seconds in self._simulation.timings.seconds.items()}
        seconds = {"total": set_up + frames, "set_up": set_up, "frames": frames, "passes": passes}
        return {
            "stage": str(scene.source) if scene.source else None,
            "device": str(launcher.device),
            "threads": launcher.threads,
            "environment": environment(),
            "plan": [each.name + (f" [{each.method}]" if each.method else "") for each in self._plan.passes],
            "device_bytes": sum(launcher.allocated.values()),
            "seconds": seconds,
            "warnings": [*scene.warnings, *self._plan.warnings, *self._simulation.warnings],
            "frames": self._frames,
        }


def computed_materials(scene: Scene) -> list[Material]:
    """The materials on a scene's surfaces whose picture is computed."""
    bound = {material.path: material for surface in scene.surfaces for material in surface.materials}
    return [material for material in bound.values() if material.procedural is not None]


def _write_smoke(path: Path, each: DomainPlan, smoke: Smoke) -> int:
    fields = (smoke.density, smoke.temperature, smoke.velocity, smoke.light)
    return write_volume(path, each.domain, each.lattice, *fields)


def _file_stems(paths: list[str]) -> dict[str, str]:
    """A short file name for each prim path: its last part, or the whole of it where that would not be unique."""
    last = [path.rpartition("/")[2] for path in paths]
    whole = [path.strip("/").replace("/", "_") for path in paths]
    return {p: short if last.count(short) == 1 else long for p, short, long in zip(paths, last, whole, strict=True)}


def _check_folder(folder: Path, name: str) -> None:
    """Raises FieldError if the folder is something else, or holds the results of another stage."""
    for each in (folder, *folder.parents):
        if each.exists() and not each.is_dir():
            raise FieldError(str(folder), "output folder", f"below the file {each}", "a folder")
    others = [path.name for path in folder.glob("*.results.usdc") if path.name != f"{name}.results.usdc"]
    if others:
        raise FieldError(str(folder), "output folder", f"that of {others[0]}", "another one: a folder holds one result")


def _make_folders(folder: Path, inside: list[str]) -> list[Path]:
    """Makes a folder with its parents and those inside it; gives the ones that were not there."""
    wanted = [*reversed(folder.parents), folder, *(folder / name for name in inside)]
    made = [each for each in wanted if not each.exists()]
    for each in made:
        each.mkdir()
    return made
