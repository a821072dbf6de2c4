"""The plane that the paper's smoke shadow is projected on, and its projective texture matrix; no Warp here.

Zhan, Yang, Shi and Fei (2008): the plane touches the far side of the smoke's box, perpendicular to the line from the
light to the box's centre. Texture coordinates (s, t, r, q) = B · P · V · M · (x, y, z, 1), as in OpenGL.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import numpy as np

from warp_smoke.lattice import Lattice
from warp_smoke.scene import Light
from warp_smoke.shadow.light_buffer import light_in_cells

# Voxels are scattered in this many parts, each by one thread into a separate buffer, and summed in a fixed order:
# the result is the same on any device and for any number of threads, without atomics.
SCATTER_PARTS = 16
# Share of the distance to the box's centre by which a light must be in front of the box for its rays to be projected.
_NEAREST = 0.05


@dataclass(frozen=True)
class ProjectionPlane:
    """The plane behind the smoke, in cell coordinates.

    Attributes:
        centre: of the box, [3].
        axes: unit vectors S (to the right, seen from the light), T (up) and the light's direction, one per row, [3, 3].
        half: half the size of the rectangle on S and T that holds the box's shadow, [2].
        depth: how far behind the centre the plane lies; the box begins as far in front of it.
        distance: from the light to the centre; infinite for a distant light.
    """

    centre: np.ndarray
    axes: np.ndarray
    half: np.ndarray
    depth: float
    distance: float

    def to_texels(self, width: int, height: int) -> np.ndarray:
        """Returns the matrix from cell indices (i, j, k, 1) to texels at the cell's centre, [2, 4], column vectors."""
        scale = np.array([width, height]) / (2.0 * self.half)
        linear = scale[:, None] * self.axes[:2]
        constant = linear @ (0.5 - self.centre) + 0.5 * np.array([width, height])
        return np.column_stack([linear, constant])

    def ray_texels(self, width: int, height: int) -> np.ndarray:
        """Returns the matrix from cells to texels along a point light's rays, times q, and q, [3, 4], column vectors.

        q is the depth as a share of the plane's.
        """
        s, t, _, q = self.texture_matrix().T
        return np.stack([s * width, t * height, q]) / (self.distance + self.depth)

    def texture_matrix(self) -> np.ndarray:
        """Returns the matrix from cells to (s, t, r, q), s along S and t along T: V · P · B for row vectors, [4, 4]."""
        perspective = np.isfinite(self.distance)
        near, far = (self.distance - self.depth, self.distance + self.depth) if perspective else (0.0, 2.0 * self.depth)
        eye = self.centre - (far - self.depth) * self.axes[2]
        view = np.eye(4)
        view[:3, :3] = (self.axes * [[1.0], [1.0], [-1.0]]).T
        view[3, :3] = -eye @ view[:3, :3]
        projection = np.zeros((4, 4))
        if perspective:
            near = max(near, 1e-3 * far)  # a light just outside a corner may lie behind the box's front plane
            projection[0, 0], projection[1, 1] = far / self.half
            projection[2, 2:] = (far + near) / (near - far), -1.0
            projection[3, 2] = 2.0 * far * near / (near - far)
        else:
            projection[0, 0], projection[1, 1] = 1.0 / self.half
            projection[2, 2], projection[3, 2] = -2.0 / (far - near), -(far + near) / (far - near)
            projection[3, 3] = 1.0
        to_unit = np.diag([0.5, 0.5, 0.5, 1.0])
        to_unit[3, :3] = 0.5
        return view @ projection @ to_unit


def plane_serves(light: Light, lattice: Lattice, times: Iterable[float]) -> bool:
    """Returns whether the plane can hold the smoke's shadow at all these time codes.

    It cannot if a point light is inside the domain, or for true rays if it is not in front of the entire box.
    """
    rays, up = light.smoke_projection == "rays", np.asarray(lattice.up)
    return all(fit_plane(light_in_cells(light, lattice, time), lattice.shape, up, rays) is not None for time in times)


def fit_plane(
    light: np.ndarray, shape: tuple[int, int, int], up: np.ndarray, rays: bool = False
) -> ProjectionPlane | None:
    """Places the plane for a light; None for a light inside the box, or for true rays too near to it.

    Args:
        light: homogeneous, in cell coordinates: (position, 1), or (unit direction towards the light, 0), [4].
        shape: cells of the lattice.
        up: unit up vector along the lattice's axes; T points as far up as possible.
        rays: whether the rectangle holds the shadow by the light's true rays, not by parallel ones; the light must
            then be in front of the entire box.
    """
    centre = 0.5 * np.asarray(shape, np.float64)
    away = light[3] * centre - light[:3]
    if light[3] and np.all(np.abs(away) <= centre):
        return None
    distance = float(np.linalg.norm(away))
    direction = away / distance
    if abs(direction @ up) > 0.999:
        up = np.eye(3)[np.argmin(np.abs(direction))]
    right = np.cross(direction, up)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(right, direction), direction])
    corners = np.array(list(product((-1.0, 1.0), repeat=3))) * centre
    local = corners @ axes.T
    half = np.abs(local).max(axis=0)
    depth = float(half[2])
    if not light[3]:
        return ProjectionPlane(centre, axes, half[:2], depth, np.inf)
    if rays:
        if distance - depth < _NEAREST * distance:
            return None
        half = np.abs(local * (distance + depth) / (distance + local[:, 2:])).max(axis=0)
    return ProjectionPlane(centre, axes, half[:2], depth, distance)
