"""A file's bytes with a read position: the bottom layer of the reader."""

import os
import struct
from pathlib import Path

import numpy as np


class Source:
    """Bytes of a file and a read position. Reading past the end raises a ValueError with the file's name.

    Attributes:
        label: prefix of error messages; at first the file's path.
        data: all bytes.
        position: number of bytes read.
    """

    def __init__(self, path: str | os.PathLike):
        self.label = str(path)
        self.data = memoryview(Path(path).read_bytes())
        self.position = 0

    def error(self, text: str) -> ValueError:
        """Makes an error about the file, to be raised by the caller."""
        return ValueError(f"{self.label}: {text}")

    def take(self, size: int) -> memoryview:
        """Reads the next bytes."""
        left = len(self.data) - self.position
        if size > left:
            raise self.error(f"damaged: needs {size} bytes at {self.position}, {left} are left")
        self.position += size
        return self.data[self.position - size : self.position]

    def unpack(self, layout: str) -> tuple:
        """Reads the next numbers, in a layout of the `struct` module."""
        return struct.unpack(layout, self.take(struct.calcsize(layout)))

    def array(self, dtype: str, count: int) -> np.ndarray:
        """Reads the next numbers of one type, [count]."""
        return np.frombuffer(self.take(count * np.dtype(dtype).itemsize), dtype)

    def bits(self, count: int) -> np.ndarray:
        """Reads the next bits, lowest first, bool [count]; count is a multiple of 8."""
        return np.unpackbits(self.array("u1", count // 8), bitorder="little").view(bool)

    def string(self) -> str:
        """Reads the next string: its length, then UTF-8."""
        (size,) = self.unpack("<I")
        try:
            return str(self.take(size), "utf-8")
        except UnicodeDecodeError:
            raise self.error(f"damaged: no UTF-8 text before byte {self.position}") from None

    def expect(self, position: int, what: str) -> None:
        """Checks that something is where the file says it is."""
        if position != self.position:
            raise self.error(f"damaged: {what} at byte {position}, not {self.position}")
