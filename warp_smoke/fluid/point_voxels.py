"""Points on the lattice, each a small sphere: how much of each cell is inside, and how fast the spheres move.

The share of a cell in a sphere is the share behind the plane at the sphere's closest point. For spheres of only a few
cells this is too much, so the shares of cells cut by the surface are scaled to give each sphere its exact volume
4/3 π r³. Where spheres overlap, shares add up to 1 at most.
"""

from math import prod

import numpy as np
import warp as wp

from warp_smoke.fluid.lattice_mesh import box_limits
from warp_smoke.fluid.voxelize import share_behind_plane
from warp_smoke.geometry import transform_points
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Emitter

wp.set_module_options({"enable_backward": False})

# Half the diagonal of a cell, and a little more.
_HALF_DIAGONAL = wp.constant(0.8661)
# Size of the hash grid that finds the points near a cell, along each axis; it repeats beyond.
_GRID = 32


@wp.struct
class Spheres:
    """Spheres in cell coordinates: centres, radii, scale of shares in cells cut by the surface, and velocity [m/s]."""

    centres: wp.array[wp.vec3]
    radii: wp.array[float]
    scale: wp.array[float]
    velocity: wp.array[wp.vec3]


@wp.func
def _share_in_sphere(centre: wp.vec3, radius: float, cell: wp.vec3):
    """Returns the share of the cell centred at `cell` that is behind the plane at the closest point of a sphere."""
    offset = cell - centre
    length = wp.length(offset)
    normal = wp.vec3(0.0, 0.0, 1.0)  # at the centre any direction will do
    if length > 0.0:
        normal = offset / length
    return share_behind_plane(normal, length - radius)


@wp.kernel
def _scale_surfaces(rows: Rows, centres: wp.array[wp.vec3], radii: wp.array[float], scale_out: wp.array[float]):
    """Scaling: scale = (4/3 π r³ − number of cells fully inside) / Σ shares of the cells cut by the surface."""
    n = rows.first + wp.tid()
    p = centres[n]
    r = radii[n]
    reach = r + _HALF_DIAGONAL
    whole = wp.float32(0.0)
    cut = wp.float32(0.0)
    i = int(wp.floor(p[0] - reach))
    while float(i) < p[0] + reach:
        j = int(wp.floor(p[1] - reach))
        while float(j) < p[1] + reach:
            k = int(wp.floor(p[2] - reach))
            while float(k) < p[2] + reach:
                share = _share_in_sphere(p, r, wp.vec3(float(i) + 0.5, float(j) + 0.5, float(k) + 0.5))
                if share < 1.0:
                    cut += share
                else:
                    whole += 1.0
                k += 1
            j += 1
        i += 1
    volume = 4.0 / 3.0 * wp.pi * r * r * r
    scale_out[n] = wp.max(volume - whole, 0.0) / wp.max(cut, 1.0e-20)


@wp.kernel
def _fill(
    rows: Rows,
    grid: wp.uint64,
    lower: wp.vec3i,
    reach: float,
    spheres: Spheres,
    moves: int,
    fraction_out: wp.array3d[float],
    u_out: wp.array3d[float],
    v_out: wp.array3d[float],
    w_out: wp.array3d[float],
):
    """Share = min(Σ s, 1) over the spheres near a cell; velocity = Σ s velocity / Σ s, 0 where there are none."""
    i, j, c = wp.tid()
    i += rows.first
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, fraction_out.shape[2])
    while k < end:
        cell = wp.vec3(float(lower[0] + i) + 0.5, float(lower[1] + j) + 0.5, float(lower[2] + k) + 0.5)
        total = wp.float32(0.0)
        motion = wp.vec3(0.0, 0.0, 0.0)
        query = wp.hash_grid_query(grid, cell, reach)
        n = wp.int32(0)
        while wp.hash_grid_query_next(query, n):
            share = _share_in_sphere(spheres.centres[n], spheres.radii[n], cell)
            if share < 1.0:
                share *= spheres.scale[n]
            total += share
            if moves != 0:
                motion += share * spheres.velocity[n]
        fraction_out[i, j, k] = wp.min(total, 1.0)
        if moves != 0:
            motion /= wp.max(total, 1.0e-20)
            u_out[i, j, k] = motion[0]
            v_out[i, j, k] = motion[1]
            w_out[i, j, k] = motion[2]
        k += 1


class PointVoxels:
    """The spheres of an emitter in the cells of their own box, kept up to date as they move.

    Attributes:
        moves: whether they ever move or change size.
        lower: first cell of the box (i, j, k).
        shape: cells along each axis of the box; (0, 0, 0) before the first update, and if no sphere is in the lattice.
        fraction: share of each cell of the box inside, [*shape], 0 to 1; meaningless if the box has no cells.
        velocity: u, v, w along the lattice's axes at the cells of the box, each [*shape] [m/s]; None if nothing moves.
    """

    def __init__(self, launcher: Launcher, lattice: Lattice, emitter: Emitter, label: str):
        """Prepares the points; `update` fills the cells.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            emitter: the emitter that has the points and their transform.
            label: label under which their memory is counted.
        """
        self._launcher, self._lattice, self._emitter, self._label = launcher, lattice, emitter, label
        self.moves = emitter.moves or emitter.mesh.deforms
        self.lower = self.shape = (0, 0, 0)
        self.fraction, self.velocity = None, None
        count = len(emitter.mesh.points_at(0.0))
        spheres = self._spheres = Spheres()
        spheres.centres, spheres.velocity = (launcher.zeros(count, label, wp.vec3) for _ in range(2))
        spheres.radii, spheres.scale = (launcher.zeros(count, label) for _ in range(2))
        self._grid = wp.HashGrid(_GRID, _GRID, _GRID, device=launcher.device)
        self._last = None  # centres, radii, velocity of the last update
        self._storage = ()  # room for fraction, and u, v, w if anything moves, as large as the largest box so far

    def update(self, start: float, end: float, seconds: float) -> bool:
        """Voxelises the spheres at their positions at `end`, with their mean velocity since `start`.

        Args:
            start: time code.
            end: time code; they are at rest if it equals `start`.
            seconds: simulated time between them [s].

        Returns:
            Whether anything changed since the last update.
        """
        if self._last is not None and not self.moves:
            return False
        centres, radii = self._spheres_at(end)
        velocity = np.zeros_like(centres)
        if start != end:
            velocity = (centres - self._spheres_at(start)[0]) * (self._lattice.h / seconds)
        now = centres, radii, velocity
        if self._last is not None and all(np.array_equal(a, b) for a, b in zip(now, self._last, strict=True)):
            return False
        self._last = now
        self._fit_box(centres, radii)
        if 0 not in self.shape:
            self._place(*now)
            self._fill(float(radii.max()))
        return True

    def travel(self, start: float, end: float) -> float:
        """Returns the largest distance between any point's positions at `start` and `end` [cells]."""
        if not self.moves or start == end or not len(self._spheres.radii):
            return 0.0
        was, now = (self._spheres_at(time)[0] for time in (start, end))
        return float(np.linalg.norm(now - was, axis=1).max())

    def volume_ratio(self) -> float:
        """Returns the volume of the spheres over that of their cells, as `MeshVoxels` does; here they already agree."""
        return 1.0

    def _spheres_at(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns centres [n, 3] and radii [n] [cells], float64; non-uniform scale scales the volume exactly."""
        to_cells = self._emitter.transform_at(time) @ self._lattice.world_to_cells()
        scale = np.cbrt(abs(np.linalg.det(to_cells[:3, :3])))
        points = self._emitter.mesh
        return transform_points(to_cells, points.points_at(time)), 0.5 * scale * points.widths_at(time)

    def _fit_box(self, centres: np.ndarray, radii: np.ndarray) -> None:
        self.lower = self.shape = (0, 0, 0)
        if not radii.any():
            return
        reach = (radii + _HALF_DIAGONAL)[:, None]
        low, high = (centres - reach).min(axis=0), (centres + reach).max(axis=0)
        first, end = box_limits(self._lattice, high - low, wraps=True)
        lower, upper = np.clip(np.floor(low), first, end).astype(int), np.clip(np.ceil(high), first, end).astype(int)
        if np.all(lower < upper):
            self.lower, self.shape = tuple(lower.tolist()), tuple((upper - lower).tolist())

    def _place(self, centres: np.ndarray, radii: np.ndarray, velocity: np.ndarray) -> None:
        spheres = self._spheres
        spheres.centres.assign(centres.astype(np.float32))
        spheres.radii.assign(radii.astype(np.float32))
        spheres.velocity.assign(velocity.astype(np.float32))
        self._launcher.launch_each(_scale_surfaces, len(radii), spheres.centres, spheres.radii, spheres.scale)

    def _fill(self, radius: float) -> None:
        count = prod(self.shape)
        if not self._storage or count > self._storage[0].size:
            self._storage = tuple(self._launcher.zeros(count, self._label) for _ in range(4 if self.moves else 1))
        self.fraction, *velocity = (array[:count].reshape(self.shape) for array in self._storage)
        reach = radius + _HALF_DIAGONAL
        self._grid.build(self._spheres.centres, reach)
        place = (self._grid.id, wp.vec3i(*self.lower), reach)
        unread = [self.fraction] * 3  # where velocity goes if there is none
        args = (*place, self._spheres, int(self.moves), self.fraction, *(velocity or unread))
        self._launcher.launch_queries(_fill, self.shape, *args)
        if self.moves:
            self.velocity = tuple(velocity)
