"""Shadows of a point light by a depth cube map.

Faces are in OpenGL's order and orientation, +X −X +Y −Y +Z −Z along the world's axes.
"""

import numpy as np

from warp_smoke.scene import SpotLight
from warp_smoke.shadow.coverage import CUBE_FRAMES, cube_rectangles
from warp_smoke.shadow.point_shadow import PointMapShadow

_FACE_IN_CROSS = ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (1, 3))  # row and column of each face in the picture
_CORNER_ANGLE = np.arccos(3**-0.5)  # from a face's axis to its corners


class CubeShadow(PointMapShadow):
    """Which points a point light reaches, by a depth cube map.

    Also serves spot lights whose cone is too wide for one map; faces that the cone does not touch stay empty.
    """

    faces = 6
    slope = 1.0

    def _frames(self, time: float) -> np.ndarray:
        self._touched = touched_faces(self._light, time) if isinstance(self._light, SpotLight) else np.arange(6)
        return CUBE_FRAMES

    def _rectangles(self, boxes: np.ndarray, position: np.ndarray, frames: np.ndarray) -> np.ndarray:
        found = cube_rectangles(boxes, position)
        untouched = np.setdiff1d(np.arange(6), self._touched)
        found[:, untouched] = (1.0, -1.0, 1.0, -1.0)
        return found

    def depth_picture(self) -> np.ndarray:
        """Returns the stored depths as a cross, +Z in the middle, +Y above it, [3 size, 4 size] uint8 (white = far)."""
        depth = np.round(255.0 * self._depths.depth.numpy()).astype(np.uint8)
        size = depth.shape[1]
        picture = np.zeros((3 * size, 4 * size), np.uint8)
        for face, (row, column) in zip(depth, _FACE_IN_CROSS, strict=True):
            picture[row * size : (row + 1) * size, column * size : (column + 1) * size] = face
        return picture


def touched_faces(light: SpotLight, time: float) -> np.ndarray:
    """Returns the cube faces that a spot light's cone may touch."""
    angle = np.arccos(np.clip(CUBE_FRAMES[:, 2] @ light.direction_at(time), -1.0, 1.0))
    return np.flatnonzero(angle <= np.radians(light.cone_angle) + _CORNER_ANGLE + 1e-6)
