"""The plane that the paper's smoke shadow is projected on, and its projective texture matrix; no Warp here.

Zhan, Yang, Shi and Fei (2008): the plane passes through the far side of the smoke's box, at right angles to the line
from the light to the box's centre. Texture coordinates (s, t, r, q) = B · P · V · M · (x, y, z, 1), as in OpenGL.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np


@dataclass(frozen=True)
class ProjectionPlane:
    """The plane behind the smoke, in cell coordinates.

    Attributes:
        centre: of the box, [3].
        axes: unit vectors S (to the right, seen from the light), T (up) and the way the light goes, one a row, [3, 3].
        half: half the size of the rectangle on S and T that holds the box's shadow by parallel rays, [2].
        depth: how far behind the centre the plane lies; the box begins as far before it.
        distance: from the light to the centre; infinite for a distant light.
    """

    centre: np.ndarray
    axes: np.ndarray
    half: np.ndarray
    depth: float
    distance: float

    def to_texels(self, width: int, height: int) -> np.ndarray:
        """Cell indices (i, j, k, 1) to the texel coordinates of the cell's centre, [2, 4], for column vectors."""
        scale = np.array([width, height]) / (2.0 * self.half)
        linear = scale[:, None] * self.axes[:2]
        constant = linear @ (0.5 - self.centre) + 0.5 * np.array([width, height])
        return np.column_stack([linear, constant])

    def texture_matrix(self) -> np.ndarray:
        """Cell coordinates to (s, t, r, q) with s along S and t along T: V · P · B for row vectors, [4, 4]."""
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


def fit_plane(light: np.ndarray, shape: tuple[int, int, int], up: np.ndarray) -> ProjectionPlane | None:
    """The plane for a light (homogeneous, in cell coordinates, [4]); None for a light inside the box.

    Args:
        light: (position, 1), or (unit direction towards the light, 0).
        shape: cells of the lattice.
        up: unit vector up along the lattice's axes; T points up as far as it can.
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
    half = np.abs(corners @ axes.T).max(axis=0)
    return ProjectionPlane(centre, axes, half[:2], float(half[2]), distance if light[3] else np.inf)
