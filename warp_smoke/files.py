"""Files that appear under their name whole or not at all."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image

# A 512² RGB bake in 9 ms and 45 KiB; level 1 takes 7 ms and 74 KiB, the default 6 takes 20 ms and 39 KiB.
PNG_COMPRESS_LEVEL = 3


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Gives a hidden path in the same folder, whose file takes the place of `path` once the block ends well.

    It has the same suffix, by which writers choose a format. An error in the block removes the hidden file and leaves
    `path` as it was.
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


def write_text(path: Path, text: str) -> None:
    """Writes a text file in UTF-8."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def write_png(path: Path, pixels: np.ndarray) -> None:
    """Writes a picture; equal pixels give equal bytes.

    Args:
        path: the `.png` file.
        pixels: uint8 [h, w] grey or [h, w, 3] RGB, top row first.

    Raises:
        ValueError: the array is neither.
    """
    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3) or pixels.shape[2:] not in ((), (3,)):
        raise ValueError(f"{path}: pixels are {pixels.dtype} {list(pixels.shape)}; allowed: uint8 [h, w] or [h, w, 3]")
    with replacing(path) as partial:
        Image.fromarray(pixels).save(partial, "PNG", compress_level=PNG_COMPRESS_LEVEL)
