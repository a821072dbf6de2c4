"""What an earlier run left in a folder, for one that goes on with it."""

from dataclasses import replace

from warp_smoke.checkpoint import Checkpoint, read_checkpoint
from warp_smoke.fingerprint import digest, fingerprint
from warp_smoke.output_folder import OutputFolder
from warp_smoke.quality import Chosen
from warp_smoke.scene import Scene


def checkpoint_before(folder: OutputFolder, made_of: dict[str, str]) -> Checkpoint | None:
    """The checkpoint of a run that was cut short; None if there is none.

    Args:
        folder: where it is.
        made_of: fingerprint of the run that is to go on.

    Raises:
        ValueError: it is damaged, or of another run.
    """
    if not folder.checkpoint.exists():
        return None
    before = read_checkpoint(folder.checkpoint)
    before.check(folder.checkpoint, made_of)
    return before


def finished_report(folder: OutputFolder, made_of: dict[str, str]) -> dict | None:
    """The report of a run of the same that came to its end; None if there is none."""
    report = folder.read_report()
    return report if report.get("fingerprint") == digest(made_of) else None


def choice_before(
    folder: OutputFolder, scene: Scene, by: str, device: str, stirred_by: str = ""
) -> tuple[Scene, Chosen] | None:
    """A scene with the settings that the run in a folder had chosen for it: measured again, others might be.

    Args:
        folder: where the run is.
        scene: as the stage has it.
        by: what asks for settings now.
        device: where it is to run.
        stirred_by: what else is to move the air, such as a script's force.

    Returns:
        The scene, and what was chosen; None if there is no run, or it is finished and was of another scene or choice.

    Raises:
        ValueError: the checkpoint is damaged, or of a run whose settings something else had asked for.
    """
    goes_on = folder.checkpoint.exists()
    chosen = (read_checkpoint(folder.checkpoint).report if goes_on else folder.read_report()).get("chosen")
    before = chosen["by"] if chosen else "nothing"
    if before != by:
        if not goes_on:
            return None
        difference = f"settings were chosen by {before} and are by {by}"
        raise ValueError(
            f"{folder.checkpoint}: the checkpoint is of another run: {difference}; allowed: the same, or no resume"
        )
    settings = chosen["settings"]
    changed = {
        kind: [replace(each, **settings.get(each.path, {})) for each in getattr(scene, kind)]
        for kind in ("domains", "lights")
    }
    settled = replace(scene, **changed)
    if not goes_on and finished_report(folder, fingerprint(settled, device, stirred_by)) is None:
        return None
    return settled, Chosen(**chosen | {"taken_over": True})
