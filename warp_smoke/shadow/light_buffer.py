"""Placement of a smoke domain's light buffer: shear-warp coordinates (Lacroute and Levoy, 1994); no Warp here.

Slices of the lattice across one axis are projected from the light onto a buffer that is parallel to them, so each
slice maps to it by a shift (distant light) or a shift and a scale (point light). *Shear coordinates* (s, t, z) are
cell coordinates with the axes reordered, z being the depth behind the side of the box nearest to the light, in slices;
the buffer lies on that side, z = 0.

Lights are homogeneous vectors: (position, 1), or (unit direction towards the light, 0) for a distant one. With a light
(l, −D, w) in shear coordinates, the ray through (x, 0) is at depth z at x (1 + w z/D) − l z/D.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from warp_smoke.lattice import Lattice
from warp_smoke.scene import DistantLight, Light

# Largest slope of a ray against the slices' axis, in the first slice: a ray takes one sample per slice, so its steps
# grow with the slope, and so does the buffer. It allows a point light an eighth of the box's width away from the box.
MAX_SLOPE = 4.0
# The most texels per cell along the box's longest side; a near light's wide rays get coarser texels instead of more.
_MAX_TEXELS = 3
# Distance from a side of the box within which a point counts as outside, in cells: a floor that the box stands on is
# within round-off of its bottom, and must not get part of a ray's smoke at some texels and all of it at others.
TOUCH = 1e-3
# Floats in a cache line: rows of slices are transposed in blocks of this many.
LINE = 16
# Standard deviation of a Gaussian voxel, in cells: neighbours then add up to a nearly uniform slab.
GAUSSIAN_WIDTH = 0.5
# Where it is cut off, in cells: the 0.3 % beyond go to the outermost texels, so that nothing is lost.
GAUSSIAN_REACH = 3.0 * GAUSSIAN_WIDTH


def set_to_cells(lattice: Lattice, origin: np.ndarray) -> np.ndarray:
    """Returns the matrix from set space to cell coordinates, 4 × 4 row-vector, float64."""
    to_world = np.eye(4)
    to_world[3, :3] = origin
    return to_world @ lattice.world_to_cells()


def light_in_cells(light: Light, lattice: Lattice, time: float) -> np.ndarray:
    """Returns the light as a homogeneous vector in cell coordinates, [4] float64."""
    if isinstance(light, DistantLight):
        return np.append(-light.direction_at(time) @ lattice.axes.T, 0.0)
    return np.append(light.position_at(time), 1.0) @ lattice.world_to_cells()


def light_times(light: Light) -> np.ndarray:
    """Returns the time codes between which the light moves in straight lines; a single one if it does not move."""
    return light.transform.times if light.moves else np.zeros(1)


@dataclass(frozen=True)
class Shear:
    """A light buffer's coordinates.

    Attributes:
        axis: lattice axis across which the slices lie.
        flipped: whether the light is at that axis's far end, so that the first slice is the last cell.
        slices: number of slices.
        light: the light in shear coordinates, [4].
        corner: of texel (0, 0), (s, t) in cells.
        texel: side of a texel in cells.
        texels: number of texels (along s, along t).
    """

    axis: int
    flipped: bool
    slices: int
    light: np.ndarray
    corner: np.ndarray
    texel: float
    texels: tuple[int, int]

    @property
    def is_shift(self) -> bool:
        """Whether each slice maps to the buffer by a shift alone: a distant light, and texels as wide as cells."""
        return self.light[3] == 0.0 and self.texel == 1.0

    @property
    def from_cells(self) -> np.ndarray:
        """Cell coordinates to shear coordinates, 4 × 4 row-vector matrix."""
        return _from_cells(self.axis, self.flipped, self.slices)

    def slice_places(self, depths: tuple[float, ...] = (0.5,)) -> np.ndarray:
        """Returns where texels sample slices, in cells: (a, b, c) of s = a · row + b, t = a · column + c, [samples, 3].

        Args:
            depths: of the samples in each slice, 0 to 1.
        """
        z = np.add.outer(np.arange(self.slices), depths).reshape(-1, 1)
        light, distance, w = self.light[:2], -self.light[2], self.light[3]
        growth = 1.0 + w * z / distance
        first = (self.corner + 0.5 * self.texel) * growth - light * z / distance
        return np.hstack([self.texel * growth, first])

    def slopes(self, corner: np.ndarray) -> np.ndarray:
        """Returns the slopes ds/dz and dt/dz of the rays through places on the buffer, [..., 2]."""
        return (self.light[3] * corner - self.light[:2]) / -self.light[2]


def fit_shear(
    light: np.ndarray,
    shape: tuple[int, int, int],
    size: int | None = None,
    texels: tuple[int, int] | None = None,
    reach: float = 0.5,
    margin: int = 0,
) -> Shear | None:
    """Places the light buffer across the axis to which the light's rays are least oblique; None if no axis works.

    Args:
        light: homogeneous, in cell coordinates, [4].
        shape: cells of the lattice.
        size: texels along the buffer's longer side; None = texels as wide as a cell in the middle of the box.
        texels: fixed numbers of texels, or None; texels are widened if the box would not fit.
        reach: how far a cell's smoke reaches beyond the box, in cells.
        margin: texels beyond that on each side.
    """
    fits = [_across(light, shape, axis, reach) for axis in range(3)]
    slope, axis = min((fit.slope, axis) for axis, fit in enumerate(fits))
    if slope > MAX_SLOPE:
        return None
    fit = fits[axis]
    span = float((fit.upper - fit.lower).max())
    middle = 0.5 * shape[axis] / -fit.light[2]
    growth = 1.0 + fit.light[3] * middle
    texel = max(1.0 / growth, span / (_MAX_TEXELS * max(shape))) if size is None else span / size
    if texels is not None:
        inner = np.maximum(np.subtract(texels, 3 + 2 * margin), 1)
        texel = max(texel, float(((fit.upper - fit.lower) / inner).max()))
    # In the middle of the box texels begin where cells do, so that light along the axis samples cells at their
    # centres; no smoke reaches the outermost texels, so that there is no shadow beyond the buffer.
    first_cell = fit.light[:2] * middle / growth
    corner = first_cell + np.floor((fit.lower - first_cell) / texel - 0.5 - margin) * texel
    needed = np.ceil((fit.upper - corner) / texel + 0.5 + margin).astype(int)
    return Shear(axis, fit.flipped, shape[axis], fit.light, corner, texel, texels or (int(needed[0]), int(needed[1])))


def fit_buffer(light: Light, lattice: Lattice, time: float, texels: tuple[int, int] | None = None) -> Shear | None:
    """Places a light's buffer at a time code, wide enough for the spread of its method and diffusion.

    Args:
        light: its `smoke_…` fields are the options.
        lattice: the smoke's cells.
        time: time code.
        texels: fixed numbers of texels, or None.

    Returns:
        The buffer, or None for a light inside the smoke or too near to it.
    """
    reach = GAUSSIAN_REACH if light.smoke_shadow == "gaussian" else 0.5
    # Room for splats, and for all but 0.3 % of what diffusion spreads over the edge.
    margin = (light.smoke_shadow != "march") + math.ceil(3.0 * math.sqrt(2.0 * light.smoke_diffusion))
    cells = light_in_cells(light, lattice, time)
    return fit_shear(cells, lattice.shape, light.smoke_shadow_size, texels, reach, margin)


def buffer_serves(light: Light, lattice: Lattice, times: Iterable[float]) -> bool:
    """Returns whether a light buffer can hold the smoke's shadow at all these time codes.

    It cannot if a point light is inside the domain, or so near that its rays' slopes exceed `MAX_SLOPE`.
    """
    return all(fit_buffer(light, lattice, time) is not None for time in times)


@dataclass(frozen=True)
class _Fit:
    """The box projected from the light across one axis: bounds on the buffer, and the largest slope."""

    flipped: bool
    light: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    slope: float


def _across(light: np.ndarray, shape: tuple[int, int, int], axis: int, reach: float) -> _Fit:
    n = shape[axis]
    w = light[3]
    flipped = bool(light[axis] > 0.5 * n * w)
    s, t, depth, _ = local = light @ _from_cells(axis, flipped, n)
    sides = [shape[other] for other in range(3) if other != axis]
    low, high = -reach, np.add(sides, reach)
    corners = np.array([[low, low], [low, high[1]], [high[0], low], [high[0], high[1]]])
    distance = -depth
    # Beside the box, inside it or within half a cell of it; or distant, with a slope beyond `MAX_SLOPE`.
    if distance <= 0.5 * w or (not w and distance * MAX_SLOPE < max(abs(s), abs(t))):
        return _Fit(flipped, local, np.zeros(2), np.zeros(2), np.inf)
    z = np.array([0.5, n - 0.5])[:, None, None]
    slope = np.abs((w * corners - (s, t)) / (distance + w * 0.5)).max()
    projected = ((corners + z * np.array([s, t]) / distance) / (1.0 + w * z / distance)).reshape(-1, 2)
    return _Fit(flipped, local, projected.min(axis=0), projected.max(axis=0), float(slope))


def _from_cells(axis: int, flipped: bool, slices: int) -> np.ndarray:
    s_axis, t_axis = (other for other in range(3) if other != axis)
    matrix = np.zeros((4, 4))
    matrix[s_axis, 0] = matrix[t_axis, 1] = matrix[3, 3] = 1.0
    matrix[axis, 2] = -1.0 if flipped else 1.0
    matrix[3, 2] = slices if flipped else 0.0
    return matrix
