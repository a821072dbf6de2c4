"""A light of a picture with its shadows: of surfaces by rays, of smoke by rays or a light buffer."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import warp as wp

from warp_smoke.geometry import transform_points
from warp_smoke.launch import Launcher
from warp_smoke.picture.smoke_volume import SmokeVolume
from warp_smoke.scene import Light, Surface
from warp_smoke.shading.light_source import light_source
from warp_smoke.shading.surface_points import SurfacePoints
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.light_buffer import buffer_serves
from warp_smoke.shadow.ray_traced import RayTracedShadow

# Slices in a layer of the light buffer: smoke shadows itself, so that each slice counts.
_SLICES_IN_A_LAYER = 2


class PictureLight:
    """A light at one time.

    Attributes:
        light: the record.
        source: the light as the shading takes it.
        takes: for each surface, 1 or 0 for whether it takes the light, its shadows by surfaces, and those by smoke.
        channels: number of shares that smoke lets through: 1, or 3 where it colours the light.
    """

    def __init__(
        self,
        launcher: Launcher,
        light: Light,
        surfaces: Sequence[Surface],
        casters: Casters,
        volumes: Sequence[SmokeVolume],
        origin: np.ndarray,
        time: float,
    ):
        """Places the light and fills its smoke shadows.

        Args:
            launcher: where to compute.
            light: the record.
            surfaces: all of the scene's, which may be lit.
            casters: the surfaces that block it.
            volumes: the smoke.
            origin: world position of set space's origin, [3] float64.
            time: time code.
        """
        self._launcher, self.light = launcher, light
        self.source = light_source(light, origin, time)
        takes = [
            (light.lights(s.path), *((s.receiver.receive_shadow, s.receiver.receive_smoke) if s.receiver else (1, 1)))
            for s in surfaces
        ]
        self.takes = launcher.array(np.array(takes or [(1, 1, 1)], np.float32), "picture", dtype=wp.vec3)
        self._shadow = None
        if light.shadow_enable and len(casters.surface_of_triangle):
            soft = light.shadow_filter == "area"
            traced = replace(light, shadow_filter="area" if soft else "exact")
            self._shadow = RayTracedShadow(
                launcher, traced, casters, _bounds(casters, volumes, origin) if soft else None
            )
            self._shadow.update(time)
        self._smoke, self.channels = [], 1
        for each in volumes:
            if light.shadow_enable and each.domain.dims_light and light.may_be_shadowed_by(each.domain.path):
                self._smoke.append(_smoke_shadow(launcher, light, each, origin, time))
                self.channels = max(self.channels, 3 if each.domain.colors_light else 1)
        self._through: dict[int, wp.array] = {}

    @property
    def has_shadow(self) -> bool:
        """Whether surfaces may block it."""
        return self._shadow is not None

    def shadow(self, points: SurfacePoints, visibility_out: wp.array) -> None:
        """Writes the share of the light that surfaces let through, [n]."""
        if self._shadow is None:
            visibility_out.fill_(1.0)
        else:
            self.look_past(points.shadow_points, points.normals, visibility_out)

    def look_past(self, points: wp.array, normals: wp.array, visibility_out: wp.array) -> None:
        """Writes the share that surfaces let through to points [n] with normals [n]; needs `has_shadow`."""
        self._shadow.visibility(points, normals, visibility_out)

    def look_through(self, points: wp.array, shares_inout: wp.array) -> None:
        """Multiplies shares [1 or 3, n] by what smoke lets through to points [n]."""
        for each in self._smoke:
            each.transmittance(points, shares_inout)

    def through(self, points: wp.array) -> wp.array:
        """Returns the share of the light that smoke lets through, [1 or 3, n]."""
        count = len(points)
        if count not in self._through:
            self._through[count] = self._launcher.zeros((self.channels, count), "picture")
        share = self._through[count]
        share.fill_(1.0)
        self.look_through(points, share)
        return share


def _bounds(casters: Casters, volumes: Sequence[SmokeVolume], origin: np.ndarray) -> np.ndarray:
    """Returns the boxes that may be shadowed by surfaces, in set space, [n, 2, 3]: the casters', and each volume's."""
    boxes = [np.stack([casters.lower, casters.upper])]
    for each in volumes:
        cells = list(product(*((0, size) for size in each.lattice.shape)))
        corners = transform_points(each.lattice.cells_to_world(), np.array(cells, np.float64)) - origin
        boxes.append(np.stack([corners.min(axis=0), corners.max(axis=0)]))
    return np.stack(boxes)


def _smoke_shadow(launcher: Launcher, light: Light, volume: SmokeVolume, origin: np.ndarray, time: float):
    from warp_smoke.shadow.methods import SMOKE_SHADOWS  # pictures without smoke need none of them

    domain = volume.domain
    method = light.smoke_shadow if buffer_serves(light, volume.lattice, [time]) else "ray_traced"
    light = replace(light, smoke_shadow=method, smoke_shadow_layer=light.smoke_shadow_layer or _SLICES_IN_A_LAYER)
    shadow = SMOKE_SHADOWS[method](launcher, volume.lattice, light, origin, domain.extinction, domain.extinction_color)
    shadow.update(launcher.array(np.ascontiguousarray(volume.density), "smoke_light"), time)
    return shadow
