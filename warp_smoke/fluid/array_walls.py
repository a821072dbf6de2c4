"""Solids from arrays: cells at whose centres the signed distance is not positive.

A moving solid pushes air along its surface normal with the velocity that follows from φ: u = −φ_t ∇φ / |∇φ|²
(S. Osher, J. A. Sethian, *Fronts Propagating with Curvature-Dependent Speed*, 1988).
"""

import numpy as np
import warp as wp

from warp_smoke.fluid.wall_motion import Pull
from warp_smoke.lattice import Lattice, occupied_box
from warp_smoke.launch import Launcher
from warp_smoke.record import value_at
from warp_smoke.scene import ArrayCollider


class ArrayWalls:
    """One collider from an array; same interface as `MeshWalls`.

    Attributes:
        moves: whether it ever moves.
        lower, shape: first cell and shape of the box around the solid cells; (0, 0, 0) if there are none.
        fraction: 1 in solid cells of the box, else 0, [*shape].
        crossed: empty, since no surface is known between cells.
        friction: friction of the surface, 0 to 1.
    """

    crossed = ()

    def __init__(self, launcher: Launcher, lattice: Lattice, collider: ArrayCollider):
        """Allocates; `update` fills the cells.

        Args:
            launcher: where it runs.
            lattice: cells of the domain.
            collider: provides the signed distance.
        """
        self._lattice, self._collider, self.friction = lattice, collider, collider.friction
        self.moves, self.lower, self.shape, self.fraction = collider.moves, (0, 0, 0), (0, 0, 0), None
        self._storage = launcher.zeros(lattice.cells, "colliders")
        self._last = None  # distance and its rate of change at the last update

    def update(self, start: float, end: float, seconds: float) -> bool:
        """Takes the distance at `end`; arguments and result as for `LatticeMesh.update`."""
        if self._last is not None and not self.moves:
            return False
        distance = value_at(self._collider.solid, end)
        change = np.zeros_like(distance)
        if start != end:
            change = (distance - value_at(self._collider.solid, start)) / np.float32(seconds)
        now = distance, change
        if self._last is not None and all(np.array_equal(a, b) for a, b in zip(now, self._last, strict=True)):
            return False
        self._last = now
        self._fill(distance <= 0.0)
        return True

    def _fill(self, solid: np.ndarray) -> None:
        spans = occupied_box(solid)
        if spans is None:
            self.lower = self.shape = (0, 0, 0)
            return
        box = np.ascontiguousarray(solid[spans], np.float32)
        self.lower, self.shape = tuple(span.start for span in spans), box.shape
        self.fraction = self._storage[: box.size].reshape(box.shape)
        self.fraction.assign(box)

    def travel(self, start: float, end: float) -> float:
        """Returns how far the surface moves, taken as the largest change of the distance [cells]."""
        if not self.moves or start == end:
            return 0.0
        was, now = (value_at(self._collider.solid, time) for time in (start, end))
        return float(np.abs(now - was).max()) / self._lattice.h

    def close(self, shares: tuple[wp.array, wp.array, wp.array]) -> None:
        """Does nothing: faces are closed where the cells beside them are solid."""

    def push(self, velocity: tuple[wp.array, wp.array, wp.array]) -> None:
        """Gives the faces beside solid cells the velocity of the surface; arguments as for `MeshWalls.push`."""
        speed = self._surface_velocity()
        for axis, component in enumerate(velocity):
            beside, moves = self._at_faces(axis, speed[axis])
            component.assign(np.where(beside, moves, component.numpy()).astype(np.float32))

    def pull(self, greatest: tuple[wp.array, wp.array, wp.array], pull: Pull) -> None:
        """Stores how the solid drags air along; arguments as for `MeshWalls.pull`."""
        speed = self._surface_velocity()
        for (own, axis), faces in pull.items():
            beside, moves = self._at_faces(axis, speed[own])
            pulls = beside & (greatest[axis].numpy() <= np.float32(self.friction))
            faces.assign(np.where(pulls, self.friction * moves, faces.numpy()).astype(np.float32))

    def _surface_velocity(self) -> np.ndarray:
        """Returns the normal velocity of the level set through each cell centre, [3, nx, ny, nz] [m/s]."""
        distance, change = (each.astype(np.float64) for each in self._last)
        gradient = _gradient(distance, self._lattice.h)
        square = (gradient**2).sum(axis=0)
        return np.divide(-change, square, out=np.zeros_like(change), where=square > 0.0) * gradient

    def _at_faces(self, axis: int, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns which faces across an axis are adjacent to a solid cell, and the mean of the cells' values there."""
        ends = ((1, 1), (0, 0), (0, 0))
        solid = np.pad(np.moveaxis(self._last[0] <= 0.0, axis, 0), ends)
        padded = np.pad(np.moveaxis(values, axis, 0), ends, mode="edge")
        beside, mean = solid[1:] | solid[:-1], 0.5 * (padded[1:] + padded[:-1])
        return np.moveaxis(beside, 0, axis), np.moveaxis(mean, 0, axis)

    def sweep(self, seconds: float, held: wp.array) -> None:
        """Marks nothing: the surface passes over no cell that is not solid before or after the step."""


def _gradient(a: np.ndarray, h: float) -> np.ndarray:
    """Returns ∇a at cell centres, [3, nx, ny, nz]; 0 along an axis of one cell."""
    return np.stack([np.gradient(a, h, axis=axis) if a.shape[axis] > 1 else np.zeros_like(a) for axis in range(3)])
