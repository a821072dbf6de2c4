"""The base of records with a place on the stage: domains, emitters, surfaces, lights and cameras."""

from dataclasses import dataclass, field

import numpy as np

from warp_smoke.geometry import transform_points
from warp_smoke.record import LARGEST, FieldError, Record, Samples, each_value, finite, value_at

_CORNERS = np.array([[i, j, k] for i in (0.0, 1.0) for j in (0.0, 1.0) for k in (0.0, 1.0)])


def _identity() -> np.ndarray:
    return np.eye(4)


@dataclass(frozen=True, eq=False, kw_only=True)
class Prim(Record):
    """A record with a place on the stage.

    Attributes:
        path: prim path, unique among the scene's records of the same kind.
        transform: local to world, 4 × 4 row-vector matrix in stage units; may change.
        given: names of the fields that the stage sets, which no quality preset changes; ignored by equality.
    """

    path: str
    transform: np.ndarray | Samples = field(default_factory=_identity)
    given: frozenset[str] = field(default=frozenset(), compare=False)

    def __post_init__(self):
        if not isinstance(self.path, str) or not self.path.startswith("/"):
            raise FieldError(str(self.path), "path", self.path, "an absolute prim path")
        self._store("transform", finite(self.path, "transform", self.transform, (4, 4)))

    def transform_at(self, time: float) -> np.ndarray:
        """Returns the local-to-world matrix at a time code, 4 × 4 float64."""
        return value_at(self.transform, time)

    @property
    def moves(self) -> bool:
        """Whether the transform changes."""
        return isinstance(self.transform, Samples) and bool(np.ptp(self.transform.values, axis=0).any())

    def _check(self, check, *names: str, **limits) -> None:
        for name in names:
            self._store(name, check(self.path, name, getattr(self, name), **limits))

    def _check_reach(self, points: np.ndarray | Samples) -> None:
        """Raises FieldError if the transform moves the bounds of local points [n, 3] too far from the origin."""
        points = each_value(points).reshape(-1, 3)
        if not len(points):
            return
        lower, upper = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
        corners = lower + _CORNERS * (upper - lower)
        reach = max(np.abs(transform_points(matrix, corners)).max() for matrix in each_value(self.transform))
        if reach > LARGEST:
            found = f"one that takes points to {reach:g}"
            raise FieldError(self.path, "transform", found, f"world coordinates from −{LARGEST:g} to {LARGEST:g}")
