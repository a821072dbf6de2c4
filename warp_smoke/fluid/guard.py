"""What is said when a field is not finite; that it is not shows in measures that each step takes anyway."""

from collections.abc import Sequence

import numpy as np
import warp as wp


class NotFiniteError(FloatingPointError):
    """A field that holds NaN or infinity, or numbers too large to be squared.

    Attributes:
        path: of the domain.
        field: density, temperature or velocity.
        frame: that was being made.
        after: the last pass that wrote the field.
        index: of the first such sample, (i, j, k), behind the number of the component for velocity.
    """

    def __init__(self, path: str, field: str, arrays: Sequence[wp.array], frame: int, after: str):
        """Finds the first sample that is not finite, or else the largest.

        Args:
            path: of the domain.
            field: its name.
            arrays: the field, or its components along x, y, z.
            frame: that was being made.
            after: the last pass that wrote the field.
        """
        values = [each.numpy() for each in arrays]
        bad = [~np.isfinite(each) for each in values]
        number = next((n for n, each in enumerate(bad) if each.any()), None)
        if number is None:
            number = int(np.argmax([np.abs(each).max() for each in values]))
            bad[number] = np.abs(values[number]) == np.abs(values[number]).max()
        cell = tuple(np.argwhere(bad[number])[0].tolist())
        place = f"on face {'uvw'[number]}{list(cell)}" if len(values) == 3 else f"in cell {list(cell)}"
        value = values[number][cell]
        super().__init__(f"{path}: {field} is {value:g} {place} at frame {frame}, after {after}")
        self.path, self.field, self.frame, self.after = path, field, frame, after
        self.index = (number, *cell) if len(values) == 3 else cell
