"""Shadows of a spot light by one perspective depth map over its cone."""

import numpy as np

from warp_smoke.shadow.coverage import cone_rectangles, frame_along
from warp_smoke.shadow.point_shadow import PointMapShadow


class SpotShadow(PointMapShadow):
    """Which points a spot light reaches, by one depth map over its cone; outside the map everything counts as lit."""

    faces = 1

    @property
    def slope(self) -> float:
        """The map's half-width at distance 1."""
        return float(np.tan(np.radians(self._light.cone_angle)))

    def _frames(self, time: float) -> np.ndarray:
        return frame_along(self._light.direction_at(time))[None]

    def _rectangles(self, boxes: np.ndarray, position: np.ndarray, frames: np.ndarray) -> np.ndarray:
        return cone_rectangles(boxes, position, frames[0], self.slope)

    def depth_picture(self) -> np.ndarray:
        """Returns the stored depths, [size, size] uint8 (white = far)."""
        return np.round(255.0 * self._depths.depth.numpy()[0]).astype(np.uint8)
