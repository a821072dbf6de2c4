"""The lattice of a smoke domain: its size in cubic cells, and the transforms between world and cell coordinates."""

from dataclasses import dataclass

import numpy as np

from warp_smoke.record import Record, read_only
from warp_smoke.scene import Scene, SmokeDomain


@dataclass(frozen=True, eq=False, kw_only=True)
class Lattice(Record):
    """Cubic cells in a box that may be rotated.

    Lattice space has its origin at the corner of cell (0, 0, 0), right-handed axes along i, j and k, and the stage's
    unit of length.

    Attributes:
        shape: cells along each axis (nx, ny, nz).
        voxel_size: side of a cell [stage units].
        to_world: lattice space to world, 4 × 4 rigid row-vector matrix, float64.
        meters_per_unit: length of a stage unit [m].
        sides: open, closed or periodic for each of -x +x -y +y -z +z of the lattice.
        up: unit vector pointing up, along the lattice's axes.
        no_slip: whether each side is a closed wall that viscous air sticks to.
    """

    shape: tuple[int, int, int]
    voxel_size: float
    to_world: np.ndarray
    meters_per_unit: float
    sides: tuple[str, ...]
    up: tuple[float, float, float]
    no_slip: tuple[bool, ...] = (False,) * 6

    @property
    def h(self) -> float:
        """Side of a cell [m]."""
        return self.voxel_size * self.meters_per_unit

    @property
    def cells(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape))

    @property
    def axes(self) -> np.ndarray:
        """The lattice's axes in the world, one per row, [3, 3]."""
        return self.to_world[:3, :3]

    def world_to_cells(self) -> np.ndarray:
        """Returns world to cell coordinates (cell (i, j, k) spans [i, i + 1] × …), 4 × 4 row-vector matrix, float64."""
        return np.linalg.inv(self.to_world) @ np.diag([1 / self.voxel_size] * 3 + [1.0])

    def cells_to_world(self) -> np.ndarray:
        """Returns cell coordinates to world, 4 × 4 row-vector matrix, float64."""
        return np.diag([self.voxel_size] * 3 + [1.0]) @ self.to_world


def occupied_box(cells: np.ndarray) -> tuple[slice, slice, slice] | None:
    """Returns the smallest box around the cells set in a mask [nx, ny, nz], a slice for each axis; None if none is."""
    found = [np.flatnonzero(cells.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    if not len(found[0]):
        return None
    return tuple(slice(int(each[0]), int(each[-1]) + 1) for each in found)


def place_lattice(scene: Scene, domain: SmokeDomain) -> Lattice:
    """Returns the lattice of a domain at the scene's first frame.

    Cells are cubes, so each side is rounded to a whole number of cells: the lattice rests on the bottom of the box
    and is centred along the other axes.
    """
    matrix = domain.transform_at(scene.start)
    scale = np.linalg.norm(matrix[:3, :3], axis=1)
    axes = matrix[:3, :3] / scale[:, None]
    lower, upper = np.asarray(domain.lower), np.asarray(domain.upper)
    anchor = lower @ matrix[:3, :3] + matrix[3, :3]  # world position of the lower corner
    size = (upper - lower) * scale
    mirrored = np.linalg.det(axes) < 0
    if mirrored:  # count k from the other end, so that the axes are right-handed
        anchor = anchor + size[2] * axes[2]
        axes = axes * np.array([[1.0], [1.0], [-1.0]])

    # Rotated axes have components like 1e-17, which would break ties and add buoyancy on faces that should have none.
    up = np.round(axes @ scene.up, 12)
    bottom = 2 * int(np.argmax(np.abs(up)))
    bottom += up[bottom // 2] < 0
    if domain.boundary is None:
        boundary = tuple("closed" if side == bottom else "open" for side in range(6))
    else:
        boundary = domain.boundary[:4] + (domain.boundary[4:][::-1] if mirrored else domain.boundary[4:])

    h = size.max() / domain.resolution
    shape = np.maximum(1, np.round(size / h)).astype(int)
    slack = size - shape * h
    shift = slack / 2
    shift[bottom // 2] = slack[bottom // 2] if bottom % 2 else 0.0
    to_world = np.eye(4)
    to_world[:3, :3] = axes
    to_world[3, :3] = anchor + shift @ axes
    return Lattice(
        shape=tuple(int(n) for n in shape),
        voxel_size=float(h),
        to_world=read_only(to_world, np.float64),
        meters_per_unit=scene.meters_per_unit,
        sides=tuple("closed" if token == "no_slip" else token for token in boundary),
        up=tuple(float(x) for x in up),
        no_slip=tuple(token == "no_slip" for token in boundary),
    )
