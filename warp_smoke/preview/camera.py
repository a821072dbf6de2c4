"""The view of a picture: the stage's camera, or one that frames everything."""

from dataclasses import dataclass

import numpy as np

from warp_smoke.geometry import normalized
from warp_smoke.scene import Camera

FRAMED_ANGLE = 30.0


@dataclass(frozen=True)
class View:
    """A perspective view.

    Attributes:
        position: world position of the eye, [3].
        target: a world point in the middle of the picture, [3].
        up: world direction that is up in the picture, [3].
        angle: vertical angle of view [degrees].
        shift: of the picture's middle, in halves of its width and height (a camera's aperture offset), [2].
    """

    position: np.ndarray
    target: np.ndarray
    up: np.ndarray
    angle: float
    shift: tuple[float, float] = (0.0, 0.0)


def camera_view(camera: Camera, time: float, aspect: float, distance: float) -> View:
    """Returns a camera's view; its full aperture is in the picture, which may show more along one side.

    Args:
        camera: the camera.
        time: time code.
        aspect: the picture's width over its height.
        distance: from the camera to `target`, about which an interactive view turns [stage units].
    """
    matrix = camera.transform_at(time)
    up, backward = normalized(matrix[1:3, :3])
    horizontal, vertical, *offset = camera.lens_at(time)
    height = max(vertical, horizontal / aspect)  # of film that the picture covers, in focal lengths
    return View(
        position=matrix[3, :3],
        target=matrix[3, :3] - distance * backward,
        up=up,
        angle=float(np.degrees(2 * np.arctan(0.5 * height))),
        shift=(2 * offset[0] / (height * aspect), 2 * offset[1] / height),
    )


def framed_view(lower: np.ndarray, upper: np.ndarray, up: np.ndarray, aspect: float) -> View:
    """Returns a view from the front, the right and above that shows all of a box.

    Args:
        lower: corner of the box in the world, [3].
        upper: the opposite corner.
        up: the stage's up axis, [3].
        aspect: the picture's width over its height.
    """
    right, front = level_axes(up)
    backward = normalized(0.6 * right + front + 0.45 * up)
    across = normalized(np.cross(up, backward))
    upright = np.cross(backward, across)
    lower, upper = np.asarray(lower, float), np.asarray(upper, float)
    target = (lower + upper) / 2
    tangent = np.tan(np.radians(FRAMED_ANGLE / 2))
    # At this distance the outermost corner lies on the picture's edge.
    offsets = box_corners(lower, upper) - target
    spread = np.maximum(np.abs(offsets @ across) / (tangent * aspect), np.abs(offsets @ upright) / tangent)
    distance = max(float((spread + offsets @ backward).max()), 1e-6)
    return View(target + distance * backward, target, np.asarray(up, float), FRAMED_ANGLE)


def box_corners(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Returns the corners of a box, [8, 3]."""
    return np.array(np.meshgrid(*zip(lower, upper, strict=True))).reshape(3, -1).T


def level_axes(up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns right and front, [3] each, for a stage's up axis: +X and +Z where Y is up, +X and −Y where Z is."""
    right = np.eye(3)[2 if up[0] else 0]
    return right, np.cross(right, up)
