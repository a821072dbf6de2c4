"""Files that appear under their name complete or not at all."""

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image

from warp_smoke.deep_png import encode_deep_png
from warp_smoke.record import FieldError

# A 512² RGB bake in 9 ms and 45 KiB; level 1 takes 7 ms and 74 KiB, the default 6 takes 20 ms and 39 KiB.
PNG_COMPRESS_LEVEL = 3


def check_folder(folder: Path) -> None:
    """Raises FieldError if a folder, or its nearest existing ancestor, is not a folder or not writable."""
    there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if not there.is_dir():
        found = "a file" if there == folder else f"below the file {there}"
        raise FieldError(str(folder), "output folder", found, "a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        allowed = "a folder that may be written"
        raise FieldError(str(folder), "output folder", "without permission to write", allowed)


def make_folders(wanted: Iterable[Path]) -> list[Path]:
    """Makes folders, listed from the top down, and returns those that did not exist."""
    made = [each for each in wanted if not each.exists()]
    for each in made:
        each.mkdir(exist_ok=True)  # another process may have been faster
    return made


def remove_empty(folders: Sequence[Path]) -> None:
    """Removes the folders that are empty, last one first."""
    for folder in reversed(folders):
        if not any(folder.iterdir()):
            folder.rmdir()


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yields a hidden path in the same folder; its file replaces `path` once the block ends without an error.

    The hidden path keeps the suffix, by which writers choose a format. An error in the block removes the hidden file
    and leaves `path` as it was.
    """
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        yield partial
        partial.replace(path)
    except BaseException as error:
        partial.unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename, error.filename2 = str(path), None  # the file that was asked for, not the hidden one
        raise


def remove_partial(folder: Path) -> None:
    """Removes the hidden files that `replacing` left in a folder when its process was killed."""
    for partial in folder.glob(".*.partial.*"):
        partial.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Waits until a file is on the disk, so that a power failure cannot undo it."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def write_text(path: Path, text: str) -> None:
    """Writes a text file in UTF-8."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def write_png(path: Path, pixels: np.ndarray) -> None:
    """Writes a picture; equal pixels give equal bytes.

    Args:
        path: the `.png` file.
        pixels: uint8 or uint16, [h, w] grey, [h, w, 3] RGB or [h, w, 4] RGBA; top row first.

    Raises:
        ValueError: the array has another type or shape.
    """
    if pixels.dtype not in (np.uint8, np.uint16) or pixels.ndim < 2 or pixels.shape[2:] not in ((), (3,), (4,)):
        allowed = "uint8 or uint16 [h, w], [h, w, 3] or [h, w, 4]"
        raise ValueError(f"{path}: pixels are {pixels.dtype} {list(pixels.shape)}; allowed: {allowed}")
    with replacing(path) as partial:
        if pixels.dtype == np.uint16:
            deep = pixels[..., None] if pixels.ndim == 2 else pixels
            partial.write_bytes(encode_deep_png(deep, PNG_COMPRESS_LEVEL))
        else:
            Image.fromarray(pixels).save(partial, "PNG", compress_level=PNG_COMPRESS_LEVEL)
