"""The whole way: a scene in, volumes, textures, a finished stage and a report out."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from warp_smoke.files import check_folder
from warp_smoke.plan import Plan, make_plan
from warp_smoke.record import FieldError, whole
from warp_smoke.scene import Scene

if TYPE_CHECKING:
    from warp_smoke.output import Result
    from warp_smoke.simulation import Frame
    from warp_smoke.study.case import Row


def run(
    scene: Scene | Plan | str | Path,
    folder: str | Path | None = None,
    *,
    quality: str | None = None,
    max_error: float | None = None,
    budget: float | None = None,
    device: str = "cpu",
    threads: int | None = None,
    depth_maps: bool = False,
    resume: bool = False,
    checkpoint_every: int | None = None,
    on_frame: Callable[["Frame"], None] | None = None,
) -> "Result":
    """Simulates, shadows, bakes and writes every frame of a scene.

    SIGINT (Ctrl-C) and SIGTERM let the frame in hand finish, and leave a checkpoint and a stage of the frames so far.

    Args:
        scene: what to run, the file of a stage, or a plan made of one.
        folder: for the results; `out/NAME` unless given.
        quality: a preset for what the scene leaves open: draft, preview or final.
        max_error: chooses the fastest settings that are measured to be within it (see `study.choice.choose`).
        budget: chooses the best settings that are measured to take no longer for a frame [ms].
        device: `cpu`, `cuda` or `cuda:N`.
        threads: CPU threads; all unless given.
        depth_maps: whether to write the shadow maps of the last frame as `textures/LIGHT.depth.png`, to look at.
        resume: whether to go on from the checkpoint in the folder, with files that are the same to the bit as those of
            a run that was never stopped. Without a checkpoint the run starts at its first frame; the results of one
            that is finished are given as they are.
        checkpoint_every: frames between checkpoints, 0 = only when interrupted; None = as often as it takes less than
            5 % of the time.
        on_frame: called with each finished frame.

    Raises:
        ValueError: the scene asks for something that cannot be done, or the checkpoint is damaged or of another run;
            no folder is left behind.
        MemoryError: the plan does not fit the device; no folder is left behind.
        OSError: the folder cannot be written.
        NotFiniteError: a field is not finite; the checkpoint and the frames before stay.
        Interrupted: a signal came; a KeyboardInterrupt that says which.
    """
    plan = scene if isinstance(scene, Plan) else None
    if plan:
        scene = plan.scene
    elif not isinstance(scene, Scene):
        scene = Scene.open(scene)
    name = scene.source.stem if scene.source else "scene"
    folder = Path("out", name) if folder is None else Path(folder)
    root = folder / f"{name}.usda"
    if scene.source and root.resolve() == scene.source.resolve():
        raise FieldError(
            str(scene.source), "output folder", folder, "another one, since the results would overwrite it"
        )
    check_folder(folder)
    if checkpoint_every is not None:
        whole("run", "checkpoint_every", checkpoint_every, 0, 10**9)
    choice = {"quality": quality, "max_error": max_error, "budget": budget}
    plan = plan or plan_run(scene, **choice, device=device, threads=threads)
    scene = plan.scene

    from warp_smoke.checkpoint import read_checkpoint
    from warp_smoke.fingerprint import digest, fingerprint
    from warp_smoke.interrupt import Interrupted, Interruption
    from warp_smoke.output import Output, Result
    from warp_smoke.simulation import Simulation

    before, made_of = None, fingerprint(scene, device)
    if resume:
        checkpoint = folder / f"{name}.checkpoint"
        if checkpoint.exists():
            before = read_checkpoint(checkpoint)
            before.check(checkpoint, made_of)
        elif finished := _finished_report(folder, digest(made_of)):
            return Result(folder, root, finished)

    began = perf_counter()
    simulation = Simulation(plan, device=device, threads=threads)
    if before:
        simulation.load(before.frame, before.fields)
    ready = perf_counter()
    with Interruption() as interruption, Output(folder, name, simulation, made_of, checkpoint_every, before) as output:
        for number in range(before.frame + 1 if before else scene.start, scene.end + 1):
            frame = simulation.step()
            output.write(frame)
            if on_frame:
                on_frame(frame)
            if interruption.signal and number < scene.end:
                output.stop()
                raise Interrupted(f"Stopped after frame {number} of {scene.end}", interruption.signal)
        if depth_maps:
            output.write_depth_maps()
        return output.finish(set_up=ready - began)


def plan_run(
    scene: Scene,
    *,
    quality: str | None = None,
    max_error: float | None = None,
    budget: float | None = None,
    device: str = "cpu",
    threads: int | None = None,
    on_row: Callable[["Row", int, int], None] | None = None,
) -> Plan:
    """The plan of a scene with what at most one of quality, error and budget chooses; see `run`.

    Settings that are chosen by error or budget are measured first unless they are known; `on_row` is called with each
    row, its number and their count.

    Raises:
        FieldError: more than one is given, or nothing can be chosen.
    """
    asked = {"quality": quality, "max_error": max_error, "budget": budget}
    given = {name: value for name, value in asked.items() if value is not None}
    if len(given) > 1:
        both = " and ".join(f"{name} {value}" for name, value in given.items())
        raise FieldError("run", "choice of settings", both, "one of quality, max_error and budget")
    if max_error is None and budget is None:
        return make_plan(scene, quality=quality)
    from warp_smoke.study.choice import choose  # needs Warp, which takes a moment to load

    asked = {"max_error": max_error, "budget": budget}
    scene, chosen = choose(scene, **asked, device=device, threads=threads, on_row=on_row)
    return replace(make_plan(scene), chosen=chosen)


def _finished_report(folder: Path, fingerprint: str) -> dict | None:
    """The report of a run of the same that came to its end."""
    try:
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return report if isinstance(report, dict) and report.get("fingerprint") == fingerprint else None
