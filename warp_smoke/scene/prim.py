"""Something with a place on the stage: what domains, emitters, surfaces, lights and cameras share."""

from dataclasses import dataclass, field

import numpy as np

from warp_smoke.record import FieldError, Record, Samples, finite, value_at


def _identity() -> np.ndarray:
    return np.eye(4)


@dataclass(frozen=True, eq=False, kw_only=True)
class Prim(Record):
    """Something with a place on the stage.

    Attributes:
        path: prim path, unique among the scene's records of one kind.
        transform: local to world, 4 × 4 row-vector matrix in stage units; may change.
    """

    path: str
    transform: np.ndarray | Samples = field(default_factory=_identity)

    def __post_init__(self):
        if not isinstance(self.path, str) or not self.path.startswith("/"):
            raise FieldError(str(self.path), "path", self.path, "an absolute prim path")
        self._store("transform", finite(self.path, "transform", self.transform, (4, 4)))

    def transform_at(self, time: float) -> np.ndarray:
        """Local to world at a time code, 4 × 4 float64."""
        return value_at(self.transform, time)

    @property
    def moves(self) -> bool:
        """Whether the transform changes."""
        return isinstance(self.transform, Samples) and bool(np.ptp(self.transform.values, axis=0).any())

    def _check(self, check, *names: str, **limits) -> None:
        for name in names:
            self._store(name, check(self.path, name, getattr(self, name), **limits))
