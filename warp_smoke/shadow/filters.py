"""Where filters sample a depth map around a point (percentage-closer filtering; Reeves, Salesin, Cook, 1987).

The patterns are LearnOpenGL's (*Point Shadows*, *Shadow Mapping*) and, for `pcss`, a spiral of points that represent
equal areas of a disk (Vogel, 1979).
"""

from itertools import product

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.scene import Camera, Light

# Half-width of the filters where the light sets no softness [texels]: taps of the 4³ grid are then a texel apart.
DEFAULT_TEXELS = 1.5
SPIRAL_TAPS = 32


@wp.struct
class Taps:
    """A filter's pattern. Its half-width at a point is radius (1 + growth · distance to the eye) + texels · texel.

    Attributes:
        offsets: in units of the half-width, [n].
        radius: [stage units].
        texels: in texels, whose width is taken at the point's depth.
        growth: relative growth per distance from the eye [1/stage unit].
        eye: in set space.
    """

    offsets: wp.array[wp.vec3]
    radius: float
    texels: float
    growth: float
    eye: wp.vec3


@wp.func
def square_to(direction: wp.vec3):
    """A unit vector perpendicular to a unit vector: the first axis of a disk that faces that direction."""
    side = wp.vec3(1.0, 0.0, 0.0)
    if wp.abs(direction[0]) > 0.7:
        side = wp.vec3(0.0, 1.0, 0.0)
    return wp.normalize(wp.cross(side, direction))


def grid_of_cube() -> np.ndarray:
    """Returns 4³ offsets in a cube, [64, 3]."""
    return np.array(list(product(np.linspace(-1.0, 1.0, 4), repeat=3)))


def grid_of_plane() -> np.ndarray:
    """Returns 3 × 3 offsets along a map's s and t, [9, 3]."""
    return np.array([(s, t, 0.0) for t, s in product((-1.0, 0.0, 1.0), repeat=2)])


def edges_and_corners() -> np.ndarray:
    """Returns the 20 directions to the edges and corners of a cube, [20, 3]."""
    return np.array([o for o in product((-1.0, 0.0, 1.0), repeat=3) if np.count_nonzero(o) >= 2])


def spiral(count: int = SPIRAL_TAPS) -> np.ndarray:
    """Returns points spread evenly over the unit disk, [n, 3] with z = 0."""
    k = np.arange(count)
    angle = np.pi * (3.0 - 5.0**0.5) * k
    radius = np.sqrt((k + 0.5) / count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)], axis=1)


def filter_taps(
    launcher: Launcher, light: Light, offsets: np.ndarray, texels: float, eye: np.ndarray | None, far: float
) -> Taps:
    """Makes the taps of a light's filter.

    Args:
        launcher: allocates the offsets.
        light: names the filter and its softness.
        offsets: in set space, in units of the half-width, [n, 3].
        texels: half-width where the light sets no softness [texels].
        eye: in set space, for `pcf_disk_view`.
        far: the depth map's far distance.
    """
    taps = Taps()
    taps.offsets = launcher.array(offsets.astype(np.float32), "shadow_filter", dtype=wp.vec3)
    taps.radius = light.shadow_softness or 0.0
    taps.texels = texels if light.shadow_softness is None else 0.0
    taps.growth, taps.eye = 0.0, wp.vec3()
    if light.shadow_filter == "pcf_disk_view" and eye is not None:
        if light.shadow_softness is None:
            taps.radius, taps.texels = far / 625.0, 0.0  # LearnOpenGL's 1/25 at far = 25, at any scale
        taps.growth, taps.eye = 1.0 / far, wp.vec3(*eye.tolist())
    return taps


def eye_at(camera: Camera | None, time: float, origin: np.ndarray) -> np.ndarray | None:
    """Returns the camera's position in set space, [3], or None without a camera."""
    return None if camera is None else camera.transform_at(time)[3, :3] - origin
