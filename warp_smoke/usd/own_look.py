"""Opening results with the stage's own materials, as they were before its lighting was baked."""

from pathlib import Path

from pxr import Sdf, Usd

from warp_smoke.scene import Scene
from warp_smoke.usd.find import find_stage
from warp_smoke.usd.material import OWN_LOOK, VARIANT_SET
from warp_smoke.usd.quiet import usd_kept_quiet
from warp_smoke.usd.read import read_scene, read_stage


@usd_kept_quiet()
def open_in_own_look(path: str | Path, camera: str | None = None) -> tuple[Usd.Stage, Scene]:
    """Opens a stage, or the one that a run wrote into a folder, with its materials from before the bake, and reads it.

    Raises:
        ValueError: as in `read_scene`, or the folder does not hold the results of one run.
    """
    file = find_stage(path)
    scene = read_scene(file, camera)
    stage = Usd.Stage.Open(Sdf.Layer.FindOrOpen(str(file)), Sdf.Layer.CreateAnonymous())
    stage.SetEditTarget(stage.GetSessionLayer())
    baked = [prim for prim in stage.GetPseudoRoot().GetChildren() if prim.GetVariantSets().HasVariantSet(VARIANT_SET)]
    for prim in baked:
        prim.GetVariantSet(VARIANT_SET).SetVariantSelection(OWN_LOOK)
    return stage, read_stage(stage, str(file), camera) if baked else scene
