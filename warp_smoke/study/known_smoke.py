"""Smoke whose shadow is known in closed form: a slab, a uniform ball and a Gaussian blob, each under a light."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from warp_smoke.geometry import normalized
from warp_smoke.lattice import Lattice
from warp_smoke.scene import DistantLight, Light, PointLight
from warp_smoke.study.light_answers import gaussian_depth, sphere_depth
from warp_smoke.study.smoke_plume import at

_POINTS = 10_000


class KnownSmoke(NamedTuple):
    """Smoke whose optical depth is known.

    Attributes:
        light: what casts its shadow.
        extinction: σ [1/m].
        lattice: makes its box from the number of cells along x.
        density: computes each cell's density, or the share of it that is filled, [nx, ny, nz].
        points: points behind it as seen from the light, [n, 3].
        depth: τ between the light and each point, [n].
    """

    light: Light
    extinction: float
    lattice: Callable[[int], Lattice]
    density: Callable[[Lattice], np.ndarray]
    points: np.ndarray
    depth: np.ndarray


def _box(shape: tuple[int, int, int], voxel_size: float) -> Lattice:
    """Returns a lattice around the origin."""
    to_world = np.eye(4)
    to_world[3, :3] = -0.5 * voxel_size * np.asarray(shape)
    return Lattice(
        shape=shape,
        voxel_size=voxel_size,
        to_world=to_world,
        meters_per_unit=1.0,
        sides=("open",) * 6,
        up=(0.0, 1.0, 0.0),
    )


def _cube(cells: int) -> Lattice:
    return _box((cells, cells, cells), 2.0 / cells)


def _centres(lattice: Lattice, offset: float | np.ndarray = 0.5) -> np.ndarray:
    """Returns the world positions at an offset in every cell (½ = its centre), [nx, ny, nz, 3]."""
    matrix = lattice.cells_to_world()
    return (np.stack(np.indices(lattice.shape), axis=-1) + offset) @ matrix[:3, :3] + matrix[3, :3]


def _away(light: Light, points: np.ndarray) -> np.ndarray:
    """Returns the unit directions of the light's rays at points, [n, 3]."""
    if isinstance(light, DistantLight):
        return np.broadcast_to(light.direction_at(1.0), points.shape)
    return normalized(points - light.position_at(1.0))


def _distance_to_ray(points: np.ndarray, away: np.ndarray, centre: np.ndarray) -> np.ndarray:
    offset = centre - points
    return np.linalg.norm(offset - np.sum(offset * away, axis=1)[:, None] * away, axis=1)


def _gaussian_blob() -> KnownSmoke:
    turn = np.eye(4)
    turn[2, :3] = normalized(np.array([[-0.6, 1.0, 0.8]]))[0]
    turn[0, :3] = normalized(np.cross([[0.0, 0.0, 1.0]], turn[2:3, :3]))[0]
    turn[1, :3] = np.cross(turn[2, :3], turn[0, :3])
    light, centre, width = DistantLight(path="/Light", transform=turn), np.array([0.1, -0.05, 0.08]), 0.2

    def blob(box: Lattice) -> np.ndarray:
        return np.exp(-0.5 * np.sum((_centres(box) - centre) ** 2, axis=-1) / width**2)

    points = np.random.default_rng(0).uniform(-0.6, 0.6, (_POINTS, 3))
    away = _away(light, points)
    depth = gaussian_depth(_distance_to_ray(points, away, centre), width, 3.0)
    return KnownSmoke(light, 3.0, _cube, blob, points + 4.0 * away, depth)


def _uniform_sphere() -> KnownSmoke:
    light, radius = PointLight(path="/Light", transform=at(0.5, 5.0, -1.0)), 0.7

    def share_inside(box: Lattice) -> np.ndarray:
        parts = (np.indices((4, 4, 4)).reshape(3, -1).T + 0.5) / 4.0
        return np.mean([np.linalg.norm(_centres(box, part), axis=-1) < radius for part in parts], axis=0)

    points = np.random.default_rng(0).uniform(-0.6, 0.6, (_POINTS, 3))
    away = _away(light, points)
    depth = sphere_depth(_distance_to_ray(points, away, np.zeros(3)), radius, 1.5)
    return KnownSmoke(light, 1.5, _cube, share_inside, points + 4.0 * away, depth)


def _slab() -> KnownSmoke:
    light = PointLight(path="/Light", transform=at(0.3, 3.0, 0.1))

    def lattice(cells: int) -> Lattice:
        return _box((cells, cells // 4, cells), 2.0 / cells)

    points = np.random.default_rng(0).uniform((-0.3, -0.8, -0.3), (0.3, -0.5, 0.3), (_POINTS, 3))
    cosine = np.abs(_away(light, points)[:, 1])
    return KnownSmoke(light, 2.0, lattice, lambda box: np.ones(box.shape), points, 2.0 * 0.5 / cosine)


# The smoke of each problem.
KNOWN_SMOKE: dict[str, Callable[[], KnownSmoke]] = {
    "Gaussian blob": _gaussian_blob,
    "uniform sphere": _uniform_sphere,
    "slab": _slab,
}


@cache
def known_density(problem: str, cells: int) -> tuple[Lattice, np.ndarray]:
    """Returns a problem's box with this many cells along x, and the density in it, shared by all methods."""
    known = KNOWN_SMOKE[problem]()
    lattice = known.lattice(cells)
    return lattice, known.density(lattice)
