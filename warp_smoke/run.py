"""The whole way: a scene in, volumes, textures, a finished stage and a report out."""

from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from warp_smoke.plan import make_plan
from warp_smoke.record import FieldError
from warp_smoke.scene import Scene

if TYPE_CHECKING:
    from warp_smoke.output import Result
    from warp_smoke.simulation import Frame


def run(
    scene: Scene | str | Path,
    folder: str | Path | None = None,
    *,
    device: str = "cpu",
    threads: int | None = None,
    depth_maps: bool = False,
    on_frame: Callable[["Frame"], None] | None = None,
) -> "Result":
    """Simulates, shadows, bakes and writes every frame of a scene.

    Args:
        scene: what to run, or the file of a stage.
        folder: for the results; `out/NAME` unless given.
        device: `cpu`, `cuda` or `cuda:N`.
        threads: CPU threads; all unless given.
        depth_maps: whether to write the shadow maps of the last frame as `textures/LIGHT.depth.png`, to look at.
        on_frame: called with each finished frame.

    Raises:
        ValueError: the scene asks for something that cannot be done; no folder is left behind.
        MemoryError: the plan does not fit the device; no folder is left behind.
        OSError: the folder cannot be written.
    """
    if not isinstance(scene, Scene):
        scene = Scene.open(scene)
    name = scene.source.stem if scene.source else "scene"
    folder = Path("out", name) if folder is None else Path(folder)
    root = folder / f"{name}.usda"
    if scene.source and root.resolve() == scene.source.resolve():
        raise FieldError(
            str(scene.source), "output folder", folder, "another one, since the results would overwrite it"
        )
    plan = make_plan(scene)

    from warp_smoke.output import Output
    from warp_smoke.simulation import Simulation

    began = perf_counter()
    simulation = Simulation(plan, device=device, threads=threads)
    ready = perf_counter()
    with Output(folder, name, simulation) as output:
        for _ in scene.frames:
            frame = simulation.step()
            output.write(frame)
            if on_frame:
                on_frame(frame)
        if depth_maps:
            output.write_depth_maps()
        return output.finish(set_up=ready - began)
