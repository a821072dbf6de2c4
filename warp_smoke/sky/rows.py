"""Pictures in blocks of rows, so that a large one is never in memory as a whole."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np


class UnsupportedPicture(ValueError):
    """A picture of an unsupported kind; the message names the kind."""


@dataclass(frozen=True, eq=False)
class Rows:
    """A picture as an iterator over blocks of its rows.

    Attributes:
        height: number of rows.
        blocks: pairs of first row (0 at the top) and linear RGB [rows, width, 3] float32, in any order, each row once.
    """

    height: int
    blocks: Iterator[tuple[int, np.ndarray]]
