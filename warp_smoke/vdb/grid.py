"""One grid of a `.vdb` file: dense values with their position in index space and in the world."""

from dataclasses import KW_ONLY, dataclass

import numpy as np

from warp_smoke.record import FieldError, Record, at_least, finite, one_of, whole

GRID_CLASSES = ("fog volume", "staggered", "unknown")
VECTOR_TYPES = (
    "invariant",
    "covariant",
    "covariant normalize",
    "contravariant relative",
    "contravariant absolute",
)
INDEX_MIN, INDEX_MAX = -(2**31), 2**31 - 1
FLOAT_MAX = float(np.finfo(np.float32).max)
SMALLEST_VOXEL = 1e-100  # the file also holds its inverse square


@dataclass(frozen=True, eq=False)
class Grid(Record):
    """A named grid of float32 values, dense over a box of voxels; outside it every voxel is inactive.

    World position of the centre of voxel (i, j, k), in OpenVDB's convention: translation + voxel_size · (i, j, k).

    Attributes:
        name: grid name, as DCCs show it.
        values: [nx, ny, nz] for a scalar grid or [nx, ny, nz, 3] for a vector grid, float32. A size may be 0.
        origin: index (i, j, k) of values[0, 0, 0]; may be negative.
        voxel_size: size of a voxel, or its size along each axis [world units].
        translation: world position of the centre of voxel (0, 0, 0) [world units].
        background: value of inactive voxels, a number or three.
        threshold: a voxel is inactive where each component is within this distance of the background.
        active: which voxels are active, bool [nx, ny, nz]; overrides the threshold.
        half: whether to store 16-bit floats; values are rounded to the nearest one and clamped to ±65504.
        grid_class: "fog volume", "staggered" (components live on voxel faces) or "unknown".
        vector_type: how vectors change under a transform: "invariant", "contravariant relative" (velocities), …

    Raises:
        FieldError: a field has a value that is not allowed.
    """

    name: str
    values: np.ndarray
    origin: tuple[int, int, int] = (0, 0, 0)
    _: KW_ONLY
    voxel_size: float | tuple[float, float, float]
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    background: float | tuple[float, float, float] = 0.0
    threshold: float = 0.0
    active: np.ndarray | None = None
    half: bool = True
    grid_class: str = "fog volume"
    vector_type: str = "invariant"

    def __post_init__(self):
        label = f"grid {self.name!r}"
        if not isinstance(self.name, str) or not self.name or not self.name.isprintable():
            raise FieldError(label, "name", repr(self.name), "printable text, not empty")
        values = self.values
        if not isinstance(values, np.ndarray) or values.dtype != np.float32:
            raise FieldError(label, "values", getattr(values, "dtype", type(values).__name__), "a float32 array")
        if values.shape[3:] not in ((), (3,)) or values.ndim < 3:
            raise FieldError(label, "shape of values", values.shape, "[nx, ny, nz] or [nx, ny, nz, 3]")
        if len(self.origin) != 3:
            raise FieldError(label, "origin", self.origin, "three whole numbers")
        limits = [INDEX_MAX + 1 - size for size in self.shape]
        self._store(
            "origin",
            tuple(
                whole(label, "origin", index, INDEX_MIN, limit)
                for index, limit in zip(self.origin, limits, strict=True)
            ),
        )
        sizes = (self.voxel_size,) * 3 if np.isscalar(self.voxel_size) else self.voxel_size
        self._store("voxel_size", at_least(label, "voxel_size", sizes, SMALLEST_VOXEL, (3,)))
        self._store("translation", finite(label, "translation", self.translation, (3,)))
        background = self.background
        if self.is_vector and np.isscalar(background):
            background = (background,) * 3
        self._store("background", finite(label, "background", background, values.shape[3:]))
        self._store("threshold", at_least(label, "threshold", self.threshold))
        if np.max(np.abs(self.background)) + self.threshold > FLOAT_MAX:
            raise FieldError(label, "background", self.background, f"with threshold within ±{FLOAT_MAX:g}")
        if self.active is not None and (self.active.dtype != bool or self.active.shape != self.shape):
            found = f"{self.active.dtype} {self.active.shape}"
            raise FieldError(label, "active", found, f"a bool array of shape {self.shape}")
        one_of(label, "grid_class", self.grid_class, GRID_CLASSES)
        one_of(label, "vector_type", self.vector_type, VECTOR_TYPES)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along each axis of the dense box."""
        return self.values.shape[:3]

    @property
    def is_vector(self) -> bool:
        """Whether a value has three components."""
        return self.values.ndim == 4
