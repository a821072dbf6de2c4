"""`warp-smoke run`: from a stage to a finished stage with smoke and baked lighting."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

import warp_smoke
from warp_smoke.cli.console import SlowLines, err, out, progress_bar, say_rows, say_written, warn
from warp_smoke.cli.options import DeviceOptions, Json, Output, SceneOptions
from warp_smoke.run import plan_run

if TYPE_CHECKING:
    from warp_smoke.preview.live import LivePreview


@Parameter(name="*")
@dataclass(frozen=True)
class ChoiceOptions:
    """Ways to choose the settings that a stage leaves open; at most one may be given.

    Attributes:
        quality: draft, preview or final: measured settings for everything that the stage leaves open.
        max_error: Choose the fastest resolution and scheme within this error: relative L2 of the density, or RMS of
            the bakes.
        budget: Choose the most accurate resolution and scheme whose frames take at most this time, in milliseconds.
    """

    quality: str | None = None
    max_error: float | None = None
    budget: float | None = None


@Parameter(name="*")
@dataclass(frozen=True)
class ExtraOptions:
    """Files to write beside the results.

    Attributes:
        flatten: Also write the stage as one layer, NAME.flat.usdc, beside its volumes and textures.
        usdz: Also write the stage with its textures as one package, NAME.usdz, which cannot hold volumes.
        volume_shader: Also write materials for the smoke, for one renderer, into a layer over the results:
            NAME.RENDERER.usda.
    """

    flatten: bool = False
    usdz: bool = False
    volume_shader: Literal["karma", "arnold", "omniverse"] | None = None

    def write(self, result: "warp_smoke.Result", scene: "warp_smoke.Scene") -> list[Path]:
        """Writes these files for a run's results, and returns their paths."""
        written, stage = [], result.stage
        if self.volume_shader:
            from warp_smoke.usd.volume_shader import write_volume_shader

            written.append(write_volume_shader(stage, scene, self.volume_shader))
        if self.flatten or self.usdz:
            from warp_smoke.usd.export import flatten_stage, package_stage

            written += [flatten_stage(stage, stage.with_suffix(".flat.usdc"))] if self.flatten else []
            written += [package_stage(stage, stage.with_suffix(".usdz"))] if self.usdz else []
        return written


def run(
    stage: Path,
    *,
    output: Output = None,
    scene_options: SceneOptions = SceneOptions(),
    choice: ChoiceOptions = ChoiceOptions(),
    device: DeviceOptions = DeviceOptions(),
    depth_maps: bool = False,
    resume: bool = False,
    checkpoint_every: int | None = None,
    extras: ExtraOptions = ExtraOptions(),
    watch: Annotated[bool, Parameter(name="--preview")] = False,
    as_json: Json = False,
):
    """Simulate, shadow and bake: read STAGE, and write a finished stage that builds on it to the output folder.

    Args:
        stage: The USD stage.
        output: Folder for the results; out/NAME unless given.
        scene_options: Changes to the stage's scene.
        choice: How to choose the settings that it leaves open.
        device: Where it runs.
        depth_maps: Also write the shadow maps of the last frame as pictures, textures/LIGHT.depth.png.
        resume: Continue after the last checkpoint of a run that was stopped or killed, or start from the first frame
            if there is none.
        checkpoint_every: Frames between checkpoints, 0 for none except when stopped; unless given, as many as keep
            their cost below 5 % of the time.
        extras: Files to write beside the results.
        watch: Show frames in a window as they are made, skipping some to slow the run by a tenth at most, and all of
            them afterwards; closing the window does not end the run.
        as_json: Print the report as JSON.
    """
    settings = {"resume": resume, **asdict(device)}
    planned = _plan(scene_options.open(stage), output, scene_options.resolution, choice, settings)
    live = warp_smoke.live_preview(planned.scene) if watch else None
    with _FrameProgress(planned.scene, resume, live) as progress:
        result = warp_smoke.run(
            planned,
            output,
            **settings,
            depth_maps=depth_maps,
            checkpoint_every=checkpoint_every,
            on_frame=progress.show,
        )
    if resume and not progress.made:
        err.print("Already finished; without --resume it would run again")
    closed_by_user = bool(live and live.closed)
    if live:
        live.close()
    written = [result.stage, *extras.write(result, planned.scene)]
    if as_json:
        print(json.dumps(result.report, indent=2))
        return
    warn(result.report["warnings"])
    from warp_smoke.report import summary

    out.print(summary(result.report), highlight=False)
    say_written(written)
    if live and not closed_by_user:
        warp_smoke.preview(result)


def _plan(
    scene: "warp_smoke.Scene", output: Path | None, resolution: int | None, choice: ChoiceOptions, settings: dict
) -> "warp_smoke.Plan":
    """Returns the plan, and prints the settings that were chosen for it."""
    by_measure = choice.max_error is not None or choice.budget is not None
    if by_measure and resolution is not None:
        allowed = "none, where --max-error or --budget chooses it"
        raise ValueError(f"--resolution is {resolution}; allowed: {allowed}")
    with progress_bar() as bar:
        planned = plan_run(scene, output, **asdict(choice), **settings, on_row=say_rows(bar))
    if planned.chosen:
        err.print(str(planned.chosen), soft_wrap=True, highlight=False)
    return planned


class _FrameProgress:
    """A context that shows a run's progress, and its frames in a window if there is one.

    Attributes:
        made: number of frames made so far.
    """

    def __init__(self, scene: "warp_smoke.Scene", resume: bool, live: "LivePreview | None"):
        self.made = 0
        self._scene, self._resume, self._live = scene, resume, live
        self._bar = progress_bar()
        self._task = self._bar.add_task("Loading kernels (compiled on first use)", total=len(scene.frames))
        self._lines = SlowLines(self._bar)

    def __enter__(self) -> "_FrameProgress":
        self._bar.start()
        return self

    def __exit__(self, *error) -> None:
        self._bar.stop()

    def show(self, frame: "warp_smoke.Frame") -> None:
        """Shows that a frame is finished."""
        if self._resume and not self.made:
            self._say_where_it_goes_on(frame.number - 1)
        self.made += 1
        self._bar.update(self._task, advance=1, description=f"Frame {frame.number}")
        self._lines.say(f"frame {frame.number} of {self._scene.end}")
        if self._live:
            self._live(frame)

    def _say_where_it_goes_on(self, before: int) -> None:
        there = before >= self._scene.start
        err.print(f"Continuing after frame {before}" if there else "No checkpoint: starting from the first frame")
        self._bar.update(self._task, completed=before + 1 - self._scene.start)
