"""Emitters and colliders that a script supplies as arrays over the cells of a domain, instead of meshes.

The arrays cover the whole domain, with sample [i, j, k] at the centre of cell (i, j, k); `Lattice` says where that is.
A stage cannot hold them, so a scene that has any cannot be saved.
"""

from dataclasses import dataclass

import numpy as np

from warp_smoke.record import FieldError, Record, Samples, at_least, each_value, read_only, switch


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayEmitter(Record):
    """An emitter of smoke defined by arrays, cell by cell.

    NumPy arrays are copied. Warp arrays must be contiguous float32 on the simulation's device and are used in place:
    what a script writes into one takes effect from the next substep.

    Attributes:
        path: a name like a prim path, unique among the scene's emitters.
        domain: path of the domain whose cells the arrays cover; None = every domain.
        density: [nx, ny, nz], at least 0; None = no density is emitted.
        temperature: [nx, ny, nz], held where it is further from ambient than the air's; None = the air keeps its own.
        rate: [1/s], smoke of `density` added each second; None = the density is held; may change.
        velocity: along the lattice's axes, [nx, ny, nz, 3] [m/s], imposed on air that is slower in that direction;
            None = none.
        enabled: whether it emits; may change.
    """

    path: str
    domain: str | None = None
    density: object = None
    temperature: object = None
    rate: float | Samples | None = None
    velocity: object = None
    enabled: bool | Samples = True

    def __post_init__(self):
        for name, shape in (("density", ()), ("temperature", ()), ("velocity", (3,))):
            values = getattr(self, name)
            if values is not None:
                self._store(name, _cells(self.path, name, values, shape))
        if isinstance(self.density, np.ndarray) and np.any(self.density < 0):
            raise FieldError(self.path, "density", self.density.min(), "≥ 0")
        if self.rate is not None:
            self._store("rate", at_least(self.path, "rate", self.rate))
        self._store("enabled", switch(self.path, "enabled", self.enabled))

    @property
    def fields(self) -> dict[str, object]:
        """The arrays that are not None, by field name."""
        given = {name: getattr(self, name) for name in ("density", "temperature", "velocity")}
        return {name: values for name, values in given.items() if values is not None}


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayCollider(Record):
    """A solid that smoke flows around, given by its signed distance or as a mask of cells.

    A cell is solid where the distance at its centre is not positive, so a wall must be a cell thick to be tight.

    Attributes:
        path: a name like a prim path, unique among the scene's colliders.
        domain: path of the domain whose cells the array covers; None = every domain.
        solid: bool [nx, ny, nz], True inside; or signed distance [m], negative inside, float [nx, ny, nz]; Samples of
            distances [t, nx, ny, nz] for a solid that moves, which pushes air along its surface normal.
        friction: how strongly it holds back viscous air moving along it: 0 = slip, 1 = no slip.
    """

    path: str
    domain: str | None = None
    solid: np.ndarray | Samples
    friction: float = 0.0

    def __post_init__(self):
        self._store("friction", at_least(self.path, "friction", self.friction))
        if self.friction > 1:
            raise FieldError(self.path, "friction", self.friction, "0 to 1")
        if isinstance(self.solid, Samples):
            if self.solid.values.dtype == bool:
                raise FieldError(self.path, "solid", "Samples of masks", "a mask, a signed distance, or Samples of it")
            values = _cells(self.path, "solid", np.moveaxis(self.solid.values, 0, -1), self.solid.values.shape[:1])
            self._store("solid", Samples(self.solid.times, np.moveaxis(values, -1, 0)))
        else:
            solid = np.asarray(self.solid)
            distance = np.where(solid, -1.0, 1.0) if solid.dtype == bool else solid
            self._store("solid", _cells(self.path, "solid", distance, ()))

    @property
    def moves(self) -> bool:
        """Whether the distance ever changes."""
        return isinstance(self.solid, Samples) and bool(np.ptp(self.solid.values, axis=0).any())


def check_cells(record: ArrayEmitter | ArrayCollider, shape: tuple[int, int, int]) -> None:
    """Checks that a record's arrays cover the cells of a domain.

    Raises:
        FieldError: an array has another shape.
    """
    fields = record.fields if isinstance(record, ArrayEmitter) else {"solid": each_value(record.solid)[0]}
    for name, values in fields.items():
        if tuple(values.shape[:3]) != shape:
            raise FieldError(record.path, name, f"an array {list(values.shape)}", f"the domain's cells, {list(shape)}")


def _cells(path: str, field: str, values: object, channels: tuple[int, ...]) -> object:
    """Returns a read-only float32 copy of a NumPy array of finite numbers, or a device array unchanged."""
    shape, allowed = tuple(getattr(values, "shape", ())), f"an array [nx, ny, nz{', 3' * (channels == (3,))}]"
    if len(shape) != 3 + len(channels) or shape[3:] != channels:
        raise FieldError(path, field, f"an array {list(shape)}" if shape else values, allowed)
    if not isinstance(values, np.ndarray):
        return values
    if not np.all(np.isfinite(values)):
        raise FieldError(path, field, "not finite in some cells", "finite numbers")
    return read_only(np.array(values, np.float32), np.float32)
