"""Pictures that come as blocks of rows, so that a large one is never whole in memory."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np


class UnsupportedPicture(ValueError):
    """A picture of a kind that is not read, by its reason."""


@dataclass(frozen=True, eq=False)
class Rows:
    """A picture.

    Attributes:
        height: rows in all.
        blocks: first row, 0 at the top, and linear RGB [rows, width, 3] float32; in any order, each row once.
    """

    height: int
    blocks: Iterator[tuple[int, np.ndarray]]
