"""The whole way: a scene in, volumes, textures, a finished stage and a report out."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from warp_smoke.fingerprint import fingerprint
from warp_smoke.output_folder import OutputFolder
from warp_smoke.plan import Plan, make_plan
from warp_smoke.quality import words_of_choice
from warp_smoke.record import FieldError, whole
from warp_smoke.resume import checkpoint_before, choice_before, finished_report
from warp_smoke.scene import Scene

if TYPE_CHECKING:
    from warp_smoke.fluid.solver import SmokeSolver
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
    on_substep: Callable[["SmokeSolver", float, float], None] | None = None,
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
            a run that was never stopped, and with the settings that it had chosen. Without a checkpoint the run starts
            at its first frame; the results of one that is finished are given as they are.
        checkpoint_every: frames between checkpoints, 0 = only when interrupted; None = as often as it takes less than
            5 % of the time.
        on_frame: called with each finished frame.
        on_substep: called in each substep, to add a force, say; see `Simulation`. Settings that an error or a budget
            chooses are measured without it. It is no part of a checkpoint: a run that goes on must be given it again,
            and one that is not is refused; whether it is the same one is not checked.

    Returns:
        The folder, its root layer, and the content of report.json.

    Raises:
        ValueError: the scene asks for something that cannot be done, another run writes to the folder, or the
            checkpoint is damaged or of another run; no folder is left behind.
        MemoryError: the plan does not fit the device; no folder is left behind.
        OSError: the folder cannot be written.
        NotFiniteError: a field is not finite; the checkpoint and the frames before stay.
        Interrupted: a signal came; a KeyboardInterrupt that says which.
    """
    if checkpoint_every is not None:
        whole("run", "checkpoint_every", checkpoint_every, 0, 10**9)
    choice = {"quality": quality, "max_error": max_error, "budget": budget}
    stirred_by = "on_substep" if on_substep else ""
    plan = _plan_of(scene, folder, **choice, resume=resume, device=device, threads=threads, stirred_by=stirred_by)
    place = OutputFolder.of(plan.scene, folder)

    from warp_smoke.interrupt import Interrupted, Interruption
    from warp_smoke.output import Output, Result
    from warp_smoke.simulation import Simulation

    made_of = fingerprint(plan.scene, device, stirred_by)
    with place.held():
        before = checkpoint_before(place, made_of) if resume else None
        if resume and not before and (report := finished_report(place, made_of)):
            return Result(place.path, place.stage, report)

        began = perf_counter()
        simulation = Simulation(plan, device=device, threads=threads, on_substep=on_substep)
        if before:
            simulation.load(before.frame, before.fields)
        ready = perf_counter()
        first, last = before.frame + 1 if before else plan.scene.start, plan.scene.end
        with Interruption() as interruption, Output(place, simulation, made_of, checkpoint_every, before) as output:
            for number in range(first, last + 1):
                frame = simulation.step()
                output.write(frame)
                if on_frame:
                    on_frame(frame)
                if interruption.signal and number < last:
                    output.stop()
                    raise Interrupted(f"Stopped after frame {number} of {last}", interruption.signal)
            if depth_maps:
                output.write_depth_maps()
            return output.finish(set_up=ready - began)


def _plan_of(scene: Scene | Plan | str | Path, folder: str | Path | None, **options) -> Plan:
    """The plan itself, or that of a scene or a stage; see `plan_run`."""
    if isinstance(scene, Plan):
        return scene
    return plan_run(scene if isinstance(scene, Scene) else Scene.open(scene), folder, **options)


def plan_run(
    scene: Scene,
    folder: str | Path | None = None,
    *,
    quality: str | None = None,
    max_error: float | None = None,
    budget: float | None = None,
    resume: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    on_row: Callable[["Row", int, int], None] | None = None,
    stirred_by: str = "",
) -> Plan:
    """The plan of a scene with what at most one of quality, error and budget chooses; see `run`.

    Settings that are chosen by error or budget are measured first unless they are known; `on_row` is called with each
    row, its number and their count. A run that goes on keeps those that it had. `stirred_by` is as in
    `make_plan`.

    Raises:
        FieldError: more than one is given, nothing can be chosen, or the folder cannot be written or is in use.
        ValueError: the checkpoint in the folder is damaged, or its settings were not chosen by the same.
    """
    place = OutputFolder.of(scene, folder)
    asked = {"quality": quality, "max_error": max_error, "budget": budget}
    given = {name: value for name, value in asked.items() if value is not None}
    if len(given) > 1:
        both = " and ".join(f"{name} {value}" for name, value in given.items())
        raise FieldError("run", "choice of settings", both, "one of quality, max_error and budget")
    if max_error is None and budget is None:
        return make_plan(scene, stirred_by, quality=quality)
    asked = {"max_error": max_error, "budget": budget}
    settled = choice_before(place, scene, words_of_choice(**asked), device, stirred_by) if resume else None
    if settled is None:
        from warp_smoke.study.choice import choose  # needs Warp, which takes a moment to load

        settled = choose(scene, **asked, device=device, threads=threads, on_row=on_row)
    scene, chosen = settled
    return replace(make_plan(scene, stirred_by), chosen=chosen)
