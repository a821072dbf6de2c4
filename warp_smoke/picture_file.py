"""Picture files, on their own or within a `.usdz` package."""

import errno
import os
import re
import zlib
from io import BytesIO
from typing import BinaryIO
from zipfile import BadZipFile, ZipFile

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
