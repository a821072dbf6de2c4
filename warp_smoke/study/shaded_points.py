"""Surface points made from arrays in the form that shading takes: what the shading suite measures."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.material import Material
from warp_smoke.scene import Light
from warp_smoke.shading.light_source import LightSource, light_source
from warp_smoke.shading.looks import Looks, make_looks
from warp_smoke.shading.radiance import shade_light
from warp_smoke.shading.surface_points import SurfaceDetail, SurfacePoints, allocate_detail, look_up_detail

# Points in a measurement.
POINTS = 40_000
_DARK = wp.vec3(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ShadedPoints:
    """Points of one material, seen from one place.

    Attributes:
        count: number of points n.
        detail: what `look_up` finds.
        radiance: what `shade` finds, [n] vec3.
    """

    launcher: Launcher
    count: int
    looks: Looks
    points: SurfacePoints
    detail: SurfaceDetail
    eye: wp.vec4
    radiance: wp.array

    def look_up(self) -> None:
        """Looks up normals, colours and gloss, after parallax."""
        look_up_detail(self.launcher, self.count, self.looks, self.points, self.eye, _DARK, self.detail)

    def shade(self, light: LightSource) -> None:
        """Computes the light that the points reflect to the eye."""
        args = (light, self.looks, self.points, self.detail, self.eye, self.radiance)
        shade_light(self.launcher, self.count, *args)


def place_points(
    launcher: Launcher, material: Material, eye: np.ndarray, arrays: Mapping[str, np.ndarray]
) -> ShadedPoints:
    """Places points of one material on a device.

    Args:
        launcher: where they are computed.
        material: their material.
        eye: where they are seen from, [3].
        arrays: `positions` and unit `normals`, [n, 3]; `tangents` with signs, [n, 4], and `uvs`, [n, 2], if needed.
    """
    count, points = len(arrays["positions"]), SurfacePoints()
    none = {"tangents": np.zeros((1, 4)), "uvs": np.zeros((1, 2))}
    kinds = {"positions": wp.vec3, "normals": wp.vec3, "tangents": wp.vec4, "uvs": wp.vec2}
    for name, values in (none | dict(arrays)).items():
        setattr(points, name, launcher.array(np.ascontiguousarray(values, np.float32), "study", dtype=kinds[name]))
    points.material = launcher.zeros(count, "study", dtype=int)
    detail = allocate_detail(launcher, count, "study", [material])
    seen_from = wp.vec4(*(float(x) for x in eye), 1.0)
    radiance = launcher.zeros(count, "study", dtype=wp.vec3)
    return ShadedPoints(launcher, count, make_looks(launcher, [material]), points, detail, seen_from, radiance)


def on_square(uvs: np.ndarray) -> dict[str, np.ndarray]:
    """Returns arrays of points on the unit square in y = 0, u along x, v along −z, for texture coordinates [n, 2]."""
    none = np.zeros(len(uvs))
    return {
        "positions": np.stack([uvs[:, 0], none, -uvs[:, 1]], axis=1),
        "normals": np.tile([0.0, 1.0, 0.0], (len(uvs), 1)),
        "tangents": np.tile([1.0, 0.0, 0.0, 1.0], (len(uvs), 1)),
        "uvs": uvs,
    }


def source_of(light: Light) -> LightSource:
    """Returns a light's source, with set space centred on the world's origin."""
    return light_source(light, np.zeros(3), 1.0)
