"""A pinhole camera in set space, and the rays of its pixels."""

import numpy as np
import warp as wp

from warp_smoke.scene import Camera


@wp.struct
class View:
    """A pinhole camera in set space, which sees from near to far along its axis.

    The ray through (x, y) pixels from the top left has the direction start + x · across + y · down, of any length.
    Pixels are counted along the rows from the top; kernels see those from `first` on.
    """

    eye: wp.vec3
    axis: wp.vec3
    start: wp.vec3
    across: wp.vec3
    down: wp.vec3
    near: float
    far: float
    width: int
    first: int


def camera_view(camera: Camera, origin: np.ndarray, time: float, width: int, height: int, first: int = 0) -> View:
    """Returns a camera's view; its full aperture is in the picture, which may show more along one side.

    Args:
        camera: the camera.
        origin: world position of set space's origin, [3] float64.
        time: time code.
        width: of the picture [pixels].
        height: of the picture [pixels].
        first: number of the first pixel that kernels see.
    """
    matrix = camera.transform_at(time)
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=1, keepdims=True)
    horizontal, vertical, *offset = camera.lens_at(time)
    pixel = max(vertical / height, horizontal / width)
    view = View()
    view.eye = wp.vec3(*(matrix[3, :3] - origin))
    view.axis = wp.vec3(*-axes[2])
    corner = (offset[0] - 0.5 * width * pixel) * axes[0] + (offset[1] + 0.5 * height * pixel) * axes[1] - axes[2]
    view.start, view.across, view.down = wp.vec3(*corner), wp.vec3(*(pixel * axes[0])), wp.vec3(*(-pixel * axes[1]))
    view.near, view.far, view.width, view.first = max(camera.near, 0.0), camera.far, width, first
    return view


@wp.func
def pixel_ray(view: View, p: int, x: float, y: float):
    """Unit direction through the point (x, y) in pixel p, counted from the view's first."""
    row = (view.first + p) // view.width
    column = view.first + p - row * view.width
    return wp.normalize(view.start + (float(column) + x) * view.across + (float(row) + y) * view.down)
