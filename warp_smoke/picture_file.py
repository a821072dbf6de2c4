"""Picture files, on their own, as tiles (UDIM), or within a `.usdz` package."""

import errno
import os
import re
import zlib
from io import BytesIO
from pathlib import Path
from typing import BinaryIO
from zipfile import BadZipFile, ZipFile

# Stands in a path for the number of a tile: 1001 + column + 10 row, where 1001 covers the texture coordinates [0, 1]².
UDIM = "<UDIM>"
# As USD writes it.
_PACKAGED = re.compile(r"(?P<package>.*\.usdz)\[(?P<name>.*)\]", re.DOTALL)


def open_picture_file(path: str) -> BinaryIO:
    """Opens a file for reading.

    Args:
        path: path of a file, or `PACKAGE[FILE]`.

    Raises:
        OSError: the file does not exist, or the package is damaged.
    """
    packaged = _PACKAGED.fullmatch(path)
    if not packaged:
        return open(path, "rb")
    try:
        with ZipFile(packaged["package"]) as package:
            return BytesIO(package.read(packaged["name"]))
    except KeyError:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), path) from None
    except (
        BadZipFile,
        EOFError,
        NotImplementedError,
        RuntimeError,
        zlib.error,
    ) as error:  # also raised for encrypted or unsupported entries
        raise OSError(errno.EIO, f"a damaged package: {error}", path) from None


def tile_files(path: str) -> dict[tuple[int, int], str]:
    """Finds the files of a picture's tiles, by column and row in ascending order; a plain picture is tile (0, 0).

    Args:
        path: of a file, or `PACKAGE[FILE]`; with `<UDIM>` for the number of a tile.

    Raises:
        OSError: there is no tile, or the package is damaged.
    """
    if UDIM not in path:
        return {(0, 0): path}
    before, _, after = path.partition(UDIM)
    pattern = re.compile(re.escape(before) + r"1(\d{3})" + re.escape(after))
    numbers = {found: int(match[1]) - 1 for found in _beside(path) if (match := pattern.fullmatch(found))}
    tiles = {(number % 10, number // 10): found for found, number in numbers.items() if number >= 0}
    if not tiles:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), path)
    return dict(sorted(tiles.items()))


def _beside(path: str) -> list[str]:
    """Lists the files in the folder of a file, or in its package."""
    packaged = _PACKAGED.fullmatch(path)
    if not packaged:
        folder = Path(path).parent
        return [str(folder / name) for name in os.listdir(folder)]
    try:
        with ZipFile(packaged["package"]) as package:
            return [f"{packaged['package']}[{name}]" for name in package.namelist()]
    except BadZipFile as error:
        raise OSError(errno.EIO, f"a damaged package: {error}", path) from None
