"""Finds what an earlier run left in a folder, so that a new run can resume it."""

from dataclasses import replace

from warp_smoke.checkpoint import Checkpoint, read_checkpoint
from warp_smoke.fingerprint import digest, fingerprint
from warp_smoke.output_folder import OutputFolder
from warp_smoke.quality import Chosen
from warp_smoke.scene import Scene


def checkpoint_before(folder: OutputFolder, made_of: dict[str, str]) -> Checkpoint | None:
    """Reads the checkpoint of an interrupted run; None if there is none.

    Args:
        folder: where it is.
        made_of: fingerprint of the run to resume.

    Raises:
        ValueError: it is damaged, or belongs to another run.
    """
    if not folder.checkpoint.exists():
        return None
    before = read_checkpoint(folder.checkpoint)
    before.check(folder.checkpoint, made_of)
    return before


def finished_report(folder: OutputFolder, made_of: dict[str, str]) -> dict | None:
    """Reads the report of a finished run with this fingerprint; None if there is none."""
    report = folder.read_report()
    return report if report.get("fingerprint") == digest(made_of) else None


def choice_before(
    folder: OutputFolder, scene: Scene, by: str, device: str, stirred_by: str = ""
) -> tuple[Scene, Chosen] | None:
    """Takes over the settings chosen for the run in a folder, since measuring again might choose others.

    Args:
        folder: where the run is.
        scene: the scene as the stage has it.
        by: what asks for settings now.
        device: the device to run on.
        stirred_by: what else moves the air, such as a script's force.

    Returns:
        The scene with these settings, and the choice; None if there is no run, or a finished one of another scene or
        choice.

    Raises:
        ValueError: the checkpoint is damaged, or its settings were chosen by something else.
    """
    goes_on = folder.checkpoint.exists()
    chosen = (read_checkpoint(folder.checkpoint).report if goes_on else folder.read_report()).get("chosen")
    before = chosen["by"] if chosen else "nothing"
    if before != by:
        if not goes_on:
            return None
        difference = f"settings were chosen by {before} and now are by {by}"
        belongs = f"the checkpoint belongs to another run: {difference}"
        raise ValueError(f"{folder.checkpoint}: {belongs}; allowed: the same run, or no resume")
    settings = chosen["settings"]
    changed = {
        kind: [replace(each, **settings.get(each.path, {})) for each in getattr(scene, kind)]
        for kind in ("domains", "lights")
    }
    settled = replace(scene, **changed)
    if not goes_on and finished_report(folder, fingerprint(settled, device, stirred_by)) is None:
        return None
    return settled, Chosen(**chosen | {"taken_over": True})
