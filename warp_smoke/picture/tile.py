"""A tile of a picture: the rays through its pixels, the layers of surfaces that they hit, and the light of these."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.picture.light import PictureLight
from warp_smoke.shading.looks import Looks
from warp_smoke.shading.primary_rays import (
    Hits,
    add_light,
    add_sample,
    allocate_hits,
    blend_behind,
    cast_rays,
    encode_picture,
    interpolate_corners,
    pass_surfaces,
    receive_light,
    show_background,
)
from warp_smoke.shading.radiance import shade_light
from warp_smoke.shading.smoke_march import ScatteringSmoke, march_smoke
from warp_smoke.shading.srgb import SrgbTable
from warp_smoke.shading.surface_points import allocate_detail, allocate_points, look_up_detail
from warp_smoke.shading.triangle_table import Dressing, TriangleTable
from warp_smoke.shading.view import View

# The most surfaces that are seen through each other; the last of them hides what lies behind it.
MOST_LAYERS = 16


@dataclass(frozen=True)
class CornerLight:
    """Light at the corners of triangles, [3 m] vec3: of each source, and without any."""

    radiance: list[wp.array]
    unlit: wp.array


@dataclass(frozen=True)
class PlacedSet:
    """What a picture shows at one time, in set space.

    Attributes:
        mesh: the triangles.
        table: what is interpolated over them.
        looks: their materials.
        lights: with their shadows.
        smokes: farthest first; none overlaps another.
        corners: light at the triangles' corners for Gouraud shading, or None.
        eye: position, and 1.
        ambient: light from everywhere, linear RGB.
    """

    mesh: wp.Mesh
    table: TriangleTable
    looks: Looks
    lights: Sequence[PictureLight]
    smokes: Sequence[ScatteringSmoke]
    corners: CornerLight | None
    eye: wp.vec4
    ambient: wp.vec3


@dataclass(frozen=True)
class _Layer:
    """What rays hit, the distance of the hit where a ray continues behind it (−1 elsewhere), and linear RGB seen."""

    hits: Hits
    passed: wp.array
    color: wp.array


class Tile:
    """Memory for a number of pixels that are rendered together, reused from tile to tile."""

    def __init__(self, launcher: Launcher, count: int, dressing: Dressing, srgb: SrgbTable):
        """Allocates the memory.

        Args:
            launcher: where to compute.
            count: pixels.
            dressing: materials of all that may be seen.
            srgb: codes of linear values.
        """
        zeros = launcher.zeros
        self._launcher, self._count, self._srgb = launcher, count, srgb
        self._is_blended = dressing.is_blended
        self._points = allocate_points(launcher, count, "picture", dressing.needs_tangents)
        self._points.shadow_points = zeros(count, "picture", dtype=wp.vec3)
        self._detail = allocate_detail(launcher, count, "picture", dressing.materials)
        self._layers: list[_Layer] = []
        self._at_eye = zeros(count, "picture")
        self._visibility = zeros(count, "picture")
        self._radiance, self._mean = (zeros(count, "picture", dtype=wp.vec3) for _ in range(2))
        self._codes = zeros((count, 3), "picture", dtype=wp.uint8)

    def _layer(self, depth: int) -> _Layer:
        """Returns the layer behind `depth` others, allocated on first use."""
        if depth == len(self._layers):
            zeros, count = self._launcher.zeros, self._count
            hits = allocate_hits(self._launcher, count, self._is_blended)
            passed = zeros(count if self._is_blended else 1, "picture")
            self._layers.append(_Layer(hits, passed, zeros(count, "picture", dtype=wp.vec3)))
        return self._layers[depth]

    def render(self, placed: PlacedSet, view: View, samples: int) -> np.ndarray:
        """Renders the pixels from the view's first on with samples² rays each, sRGB [count, 3] uint8."""
        launcher, count = self._launcher, self._count
        places = [(n + 0.5) / samples for n in range(samples)]
        self._mean.zero_()
        for y in places:
            for x in places:
                color = self._sample(placed, view, (x, y))
                add_sample(launcher, count, color, 1.0 / samples**2, self._mean)
        encode_picture(launcher, count, self._mean, self._srgb, self._codes)
        return self._codes.numpy()

    def _sample(self, placed: PlacedSet, view: View, place: tuple[float, float]) -> wp.array:
        """Returns what rays through one place in each pixel see: layers traced from the eye, blended back to front."""
        launcher, count = self._launcher, self._count
        starts, met = [self._at_eye], []
        while len(met) < MOST_LAYERS:
            layer = self._layer(len(met))
            self._shade(layer, placed, view, place, starts[-1])
            met.append(layer)
            if not self._is_blended:
                break
            pass_surfaces(launcher, count, layer.hits, layer.passed)
            if layer.passed.numpy().max() < 0.0:
                break
            starts.append(layer.passed)
        behind = None
        for layer, start in zip(reversed(met), reversed(starts[: len(met)]), strict=True):
            if behind is not None:
                blend_behind(launcher, count, layer.hits, layer.passed, behind.color, layer.color)
            for smoke in placed.smokes:
                march_smoke(launcher, count, smoke, view, place, start, layer.hits.distance, layer.color)
            behind = layer
        return behind.color

    def _shade(self, layer: _Layer, placed: PlacedSet, view: View, place: tuple[float, float], start: wp.array) -> None:
        """Traces the rays from `start` to the next surfaces, and writes their light."""
        launcher, count = self._launcher, self._count
        points, detail, hits, color = self._points, self._detail, layer.hits, layer.color
        cast_rays(launcher, count, placed.mesh, placed.looks, view, place, placed.table, start, points, hits)
        if placed.corners is None:
            look_up_detail(launcher, count, placed.looks, points, placed.eye, placed.ambient, detail)
            color.assign(detail.unlit)
        else:
            interpolate_corners(launcher, count, hits, placed.corners.unlit, placed.ambient, color)
        for index, light in enumerate(placed.lights):
            light.shadow(points, self._visibility)
            receive_light(launcher, count, hits, placed.table, light.takes, self._visibility)
            if placed.corners is None:
                args = (placed.looks, points, detail, placed.eye, self._radiance, self._visibility)
                shade_light(launcher, count, light.source, *args)
            else:
                args = (hits, placed.corners.radiance[index], wp.vec3(0.0), self._radiance)
                interpolate_corners(launcher, count, *args)
            args = (self._radiance, self._visibility, light.through(points.positions))
            add_light(launcher, count, *args, hits, placed.table, light.takes, color)
        show_background(launcher, count, hits, placed.ambient, color)
