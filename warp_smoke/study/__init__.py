"""What accuracy costs in time: error against time for each method, on known answers and on a user's own stage."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from warp_smoke.files import check_folder
from warp_smoke.scene import Scene

if TYPE_CHECKING:
    from warp_smoke.study.case import Row
    from warp_smoke.study.conduct import Study


def study(
    scene: Scene | str | Path | None = None,
    folder: str | Path | None = None,
    *,
    suites: Sequence[str] | None = None,
    full: bool = False,
    device: str = "cpu",
    threads: int | None = None,
    on_row: Callable[["Row", int, int], None] | None = None,
) -> "Study":
    """Measures error against time, and writes tables, diagrams and a web page.

    An interrupted study resumes when it is started again with the same folder.

    Args:
        scene: a scene or a stage file, studied at several settings against its finest.
        folder: for the results; `out/study`, or `out/NAME.study` for a stage, unless given.
        suites: names of the suites on known answers, `scene`, or `all`; None = all of them, or the scene if there is
            one.
        full: whether to measure everything; else each suite takes less than two minutes on two cores.
        device: `cpu`, `cuda` or `cuda:N`.
        threads: CPU threads; all unless given.
        on_row: called with each row, its number and the total number of rows.

    Raises:
        ValueError: there is no such suite, the stage has nothing to study, or the folder holds results from
            another machine, version or stage; nothing is overwritten.
        OSError: the folder cannot be written.
    """
    from warp_smoke.study.conduct import chosen_suites, conduct, study_folder

    if scene is not None and not isinstance(scene, Scene):
        scene = Scene.open(scene)
    names = chosen_suites(scene, suites)
    folder = study_folder(scene) if folder is None else Path(folder)
    check_folder(folder)
    return conduct(scene, folder, names, full, device, threads, on_row)
