"""Writing of the finished stage: a root layer over a layer of results over the user's own stage."""

import errno
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from pxr import Sdf, Tf, Usd

from warp_smoke.files import replacing
from warp_smoke.scene import Scene
from warp_smoke.usd.author import author_scene
from warp_smoke.usd.find import RESULTS_SUFFIX
from warp_smoke.usd.material import BakeResult, DepthMapResult, VertexBakeResult, define_bakes, define_procedural
from warp_smoke.usd.quiet import usd_kept_quiet
from warp_smoke.usd.volume import VolumeResult, define_volume

# Metadata that USD reads only from a stage's root layer, and would lose under a new one.
_ROOT_METADATA = (
    "defaultPrim",
    "upAxis",
    "metersPerUnit",
    "kilogramsPerUnit",
    "framesPerSecond",
    "colorConfiguration",
    "colorManagementSystem",
    "expressionVariables",
    "renderSettingsPrimPath",
)


@usd_kept_quiet()
def write_results(
    folder: str | Path,
    name: str,
    scene: Scene,
    volumes: Iterable[VolumeResult] = (),
    bakes: Iterable[BakeResult | VertexBakeResult | DepthMapResult] = (),
    procedurals: Mapping[str, str] | None = None,
) -> Path:
    """Writes the layers that join the files of a run to the user's stage.

    `name.usda`, the stage to open, sublayers `name.results.usdc` over the user's stage, which is not changed. A scene
    made in Python is first written as `name.scene.usdc`. Equal results give equal bytes, and no half-written layer is
    ever visible.

    Args:
        folder: the folder for the layers, to which the files of volumes and bakes are relative.
        name: base name of the layers.
        scene: the scene that was run.
        volumes: one for each domain.
        bakes: one for each bake or shadow map of a receiver.
        procedurals: material path → its procedural picture (`./textures/…`), which becomes its diffuse colour.

    Returns:
        Path of the root layer.

    Raises:
        ValueError: a layer would overwrite the user's stage, or a prim with results is not on it.
    """
    folder = Path(folder)
    root_path, results_path = folder / f"{name}.usda", folder / f"{name}{RESULTS_SUFFIX}"
    source = scene.source or folder / f"{name}.scene.usdc"
    for path in (root_path, results_path):
        if path.exists() and source.exists() and path.samefile(source):
            raise ValueError(f"{path} is the scene's own stage; allowed: another output folder or name")
    folder.mkdir(parents=True, exist_ok=True)
    if scene.source is None:
        with replacing_layer(source) as partial:
            author_scene(scene, partial)

    below = Sdf.Layer.FindOrOpen(str(source))
    results = Sdf.Layer.CreateAnonymous(".usdc")
    over = Sdf.Layer.CreateAnonymous(".usda")
    for layer in (results, over):
        set_metadata(layer, below, scene)
    over.subLayerPaths = [results.identifier, below.identifier]
    stage = Usd.Stage.Open(over)
    stage.SetEditTarget(results)
    for volume in volumes:
        define_volume(stage, volume)
    for path, file in (procedurals or {}).items():
        define_procedural(stage, path, file)
    define_bakes(stage, bakes)

    root = Sdf.Layer.CreateAnonymous(".usda")
    set_metadata(root, below, scene)
    root.subLayerPaths = [f"./{results_path.name}", _relative(source, folder)]
    for path, layer in ((results_path, results), (root_path, root)):
        with replacing_layer(path) as partial:
            layer.Export(str(partial))
    return root_path


@contextmanager
def replacing_layer(path: Path) -> Iterator[Path]:
    """Like `replacing`, for USD's writers; stages that are open in this process are updated to the new layer.

    Raises:
        OSError: USD could not write the file.
    """
    with replacing(path) as partial:
        try:
            yield partial
        except Tf.ErrorException as error:
            raise OSError(errno.EIO, error.args[0].commentary) from error
    layer = Sdf.Layer.Find(str(path))
    if layer:
        layer.Reload(force=True)


def set_metadata(layer: Sdf.Layer, source: Sdf.Layer, scene: Scene) -> None:
    """Copies a root layer's metadata to another; up axis and unit are the scene's if unset, the frames always are."""
    layer.pseudoRoot.SetInfo("upAxis", scene.up_axis)
    layer.pseudoRoot.SetInfo("metersPerUnit", scene.meters_per_unit)
    for key in _ROOT_METADATA:
        if source.pseudoRoot.HasInfo(key):
            layer.pseudoRoot.SetInfo(key, source.pseudoRoot.GetInfo(key))
    # The frames that were run, which may differ from the source's.
    layer.startTimeCode, layer.endTimeCode = scene.start, scene.end
    layer.timeCodesPerSecond = source.timeCodesPerSecond


def _relative(path: Path, folder: Path) -> str:
    """Returns the path relative to the folder in USD's form: with slashes and a leading dot."""
    relative = Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix()
    return relative if relative.startswith("../") else f"./{relative}"
