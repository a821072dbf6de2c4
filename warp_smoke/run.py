"""A full run: from a scene to volumes, textures, a finished stage and a report."""

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

    SIGINT (Ctrl-C) and SIGTERM let the current frame finish, and leave a checkpoint and a stage of the frames so far.

    Args:
        scene: a scene, the file of a stage, or a plan made from one.
        folder: folder for the results; `out/NAME` unless given.
        quality: a preset for what the scene leaves open: draft, preview or final.
        max_error: chooses the fastest settings whose measured error is within this (see `study.choice.choose`).
        budget: chooses the best settings whose measured time per frame is within this [ms].
        device: `cpu`, `cuda` or `cuda:N`.
        threads: CPU threads; all unless given.
        depth_maps: whether to write the shadow maps of the last frame as `textures/LIGHT.depth.png`, for inspection.
        resume: whether to continue from the checkpoint in the folder, with the settings chosen for that run and files
            bit-identical to those of an uninterrupted run. Without a checkpoint the run starts at its first frame, or
            returns the results as they are if it is already finished.
        checkpoint_every: frames between checkpoints; 0 = only when interrupted, None = as often as takes less than 5 %
            of the time.
        on_frame: called with each finished frame.
        on_substep: called in each substep, for example to add a force; see `Simulation`. Settings chosen by an error
            or a budget are measured without it. Checkpoints do not contain it: a resumed run must be given it again,
            else it is refused, but whether it is the same function is not checked.

    Returns:
        The folder, its root layer, and the content of report.json.

    Raises:
        ValueError: the scene asks for something that cannot be done, another run writes to the folder, or the
            checkpoint is damaged or belongs to another run; no folder is left behind.
        MemoryError: the plan does not fit the device; no folder is left behind.
        OSError: the folder cannot be written.
        NotFiniteError: a field is not finite; the checkpoint and earlier frames are kept.
        Interrupted: a signal stopped the run; a KeyboardInterrupt that says which.
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
    """Returns the plan itself, or the plan of a scene or a stage; see `plan_run`."""
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
    """Plans a scene with settings chosen by quality, error or budget, at most one of them; see `run`.

    To choose by error or budget, settings are measured first unless their measurements are known; `on_row` is called
    with each row, its number and the row count. A resumed run keeps its settings. `stirred_by` is as in `make_plan`.

    Raises:
        FieldError: more than one is given, nothing can be chosen, or the folder cannot be written or is in use.
        ValueError: the checkpoint in the folder is damaged, or its settings were chosen otherwise.
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
