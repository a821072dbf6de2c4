"""Export of the finished stage as one layer or one package, for programs and people that want a single file."""

from contextlib import suppress
from pathlib import Path, PurePosixPath
from struct import pack, unpack
from zipfile import ZipFile

from pxr import Ar, Sdf, Tf, Usd, UsdUtils, UsdVol

from warp_smoke.native_words import leaving_out
from warp_smoke.usd.quiet import usd_kept_quiet
from warp_smoke.usd.write import replacing_layer

FOLDERS = ("volumes", "textures")
# Zip archives (APPNOTE 4.3.7, 4.3.12): offsets of a file's time and date in its local header and in its entry of the
# central directory; in that entry also the offset of the lengths of its variable parts, and the size of the fixed one.
LOCAL_TIME, CENTRAL_TIME, CENTRAL_LENGTHS, CENTRAL_SIZE = 10, 12, 28, 46
EARLIEST = pack("<HH", 0, 1 << 5 | 1)


def flatten_stage(stage: Path, file: Path) -> Path:
    """Writes a stage as one layer: the user's layers and the results merged, with only the selected variants.

    Args:
        stage: the root layer of a run's results.
        file: the layer to write, in the same folder; volumes and textures stay separate files, named relative to it.

    Returns:
        The file.

    Raises:
        OSError: the file cannot be written.
    """
    with usd_kept_quiet():
        flat = Usd.Stage.Open(str(stage)).Flatten(False)
    _name_relative_to(flat, file.parent)
    with replacing_layer(file) as partial:
        flat.Export(str(partial))
    return file


def package_stage(stage: Path, file: Path) -> Path:
    """Packs a stage with its textures into one `.usdz`; volumes are left out, since a `.usdz` may not contain `.vdb`.

    Args:
        stage: the root layer of a run's results.
        file: the `.usdz` to write.

    Returns:
        The file.

    Raises:
        OSError: the file cannot be written.
    """
    with usd_kept_quiet():
        opened = Usd.Stage.Open(str(stage), Usd.Stage.LoadAll)
        without_volumes = Usd.Stage.Open(opened.Flatten(False))
    for prim in list(without_volumes.TraverseAll()):
        if prim and (prim.IsA(UsdVol.Volume) or prim.IsA(UsdVol.FieldBase)):
            without_volumes.RemovePrim(prim.GetPath())
    _name_relative_to(without_volumes.GetRootLayer(), file.parent)
    layer = file.with_name(f".{file.stem}.packed.usdc")
    try:
        with replacing_layer(file) as partial:
            without_volumes.GetRootLayer().Export(str(layer))
            # USD looks for the textures again under the names that it has just given them in the package.
            with leaving_out("Failed to resolve reference @0/"):
                packed = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(layer)), str(partial), f"{file.stem}.usdc")
            if not packed:
                raise OSError(f"{file}: cannot be packed")
            _forget_times(partial)
    finally:
        layer.unlink(missing_ok=True)
    return file


def _forget_times(package: Path) -> None:
    """Sets the times of all files in a zip archive to 1980, so that equal stages give equal bytes."""
    with ZipFile(package) as archive:
        places = [entry.header_offset + LOCAL_TIME for entry in archive.infolist()]
        at = archive.start_dir
        for _ in range(len(places)):
            places.append(at + CENTRAL_TIME)
            archive.fp.seek(at + CENTRAL_LENGTHS)
            at += CENTRAL_SIZE + sum(unpack("<HHH", archive.fp.read(6)))
    with package.open("r+b") as file:
        for place in places:
            file.seek(place)
            file.write(EARLIEST)


def result_files(layer: Path) -> set[Path]:
    """Returns the files in `FOLDERS` beside a results layer that it names; none if it cannot be read."""
    found: set[str] = set()

    def note(path: str) -> str:
        found.add(path)
        return path

    with suppress(Tf.ErrorException, ValueError):
        opened = Sdf.Layer.OpenAsAnonymous(str(layer))
        if opened:
            UsdUtils.ModifyAssetPaths(opened, note)
    inside = [PurePosixPath(path) for path in found if path.startswith("./")]
    return {layer.parent / path for path in inside if path.parts[0] in FOLDERS and ".." not in path.parts}


def _name_relative_to(layer: Sdf.Layer, folder: Path) -> None:
    """Makes paths below a folder relative to it, since flattening makes all paths absolute."""
    folder = folder.resolve()

    def relative(path: str) -> str:
        resolved = Ar.GetResolver().Resolve(path).GetPathString() or path
        return f"./{Path(resolved).relative_to(folder).as_posix()}" if Path(resolved).is_relative_to(folder) else path

    UsdUtils.ModifyAssetPaths(layer, relative)
