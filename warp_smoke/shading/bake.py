"""Baking: the light that reaches each point of a receiver, per light, summed into pictures each frame.

With B, l of light L at a point (`light_source.py`), V its visibility past surfaces and T the smoke's transmittance:

- `lit` = emissive + ambient ⊗ c + Σ_L V T ⊗ B ⊗ (m_d + R_F (m + 8)/8 (n·h)ᵐ) max(l·n, 0), F. Luna's LitColor, or
  the material's own reflection model (`blinn_phong`), with the base colour c;
- `irradiance` = ambient + Σ_L V T ⊗ B max(l·n, 0), irradiance/π: what a white matte surface would look like;
- `normal`: the shading normal, along the stage's axes;
- `visibility` = Σ_L w V / Σ_L w, the share of the light that surfaces let through, and
- `smokeShadow` = Σ_L w V T / Σ_L w V, the share of the remaining light that smoke lets through, with the luminance
  w = Y(B) max(l·n, 0) of the light that would arrive; 1 where none would. So visibility · smokeShadow is the share of
  all light that arrives, whatever the material. Where smoke is coloured, T is its luminance here.
"""

from collections.abc import Collection, Sequence

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.scene import Camera, Light, Material, Surface
from warp_smoke.shading.compose import (
    Shares,
    add_lights,
    average_transmittance,
    average_visibility,
    find_changes,
    make_shares,
)
from warp_smoke.shading.light_source import light_source
from warp_smoke.shading.looks import make_looks
from warp_smoke.shading.normal_map import pack_channels
from warp_smoke.shading.radiance import shade_irradiance, shade_light, weigh_light
from warp_smoke.shading.surface_points import SurfacePoints, allocate_detail, look_up_detail
from warp_smoke.shading.texel_picture import Change
from warp_smoke.shading.texels import TexelMap
from warp_smoke.shading.usable import map_surface, usable_materials
from warp_smoke.shading.vertices import VertexMap


class ReceiverBake:
    """The light on one receiver, and the pictures baked for it.

    The caller computes shadows and writes them into `visibility` and `transmittance`; while light, receiver and camera
    stand still, nothing is recomputed here but the requested pictures.

    Attributes:
        map: the points that are baked, a `TexelMap`, or a `VertexMap` if the texture coordinates hold no picture.
        visibility: by path of light, [n] float32, the share that surfaces let through; 1 until written.
        transmittance: by path of light, [1, n] float32, the share that smoke lets through, or [3, n] for red, green
            and blue where the smoke is coloured; 1 until written.
        smoke_points: the points that `transmittance` belongs to, [n] vec3; fewer after `limit_smoke`.
        warnings: what could not be done as asked.
    """

    def __init__(
        self,
        launcher: Launcher,
        surface: Surface,
        lights: Sequence[Light],
        origin: np.ndarray,
        *,
        bakes: Collection[str],
        ambient: tuple[float, float, float] = (0.0, 0.0, 0.0),
        camera: Camera | None = None,
        shadowed: Collection[str] = (),
        smoke_shadowed: Collection[str] = (),
        color_shadowed: Collection[str] = (),
    ):
        """Allocates what the receiver's bakes need; no light is computed before `update`.

        Args:
            launcher: where to compute.
            surface: a surface with a receiver, which gives the texture's size.
            lights: those that can reach it.
            origin: world position of set space's origin, [3] float64.
            bakes: pictures that will be requested, of `scene.SURFACE_BAKES`.
            ambient: light from everywhere, linear RGB.
            camera: the camera that highlights are seen from; None leaves them out.
            shadowed: paths of the lights from which surfaces shadow it.
            smoke_shadowed: paths of the lights from which smoke shadows it.
            color_shadowed: those of `smoke_shadowed` whose light the smoke colours.

        Raises:
            FieldError: a texture cannot be read.
        """
        self._launcher, self._lights, self._origin, self._camera = launcher, tuple(lights), origin, camera
        self.map, warnings = map_surface(launcher, surface, origin)
        materials, missing = usable_materials(surface, self.map)
        warnings += missing
        if "lit" in bakes and camera is None:
            warnings += (f"{surface.path}: no camera to see highlights from; the bake has diffuse light only",)
        self._follows_eye = any(material.has_relief for material in materials)
        self._is_see_through = any(material.is_see_through for material in materials)
        if camera is None and self._follows_eye:
            flat = ", ".join(material.path for material in materials if material.has_relief)
            warnings += (f"{surface.path}: no camera to see relief from; {flat} has no parallax",)

        count = self.map.count
        self._sources, self._eye = [None] * len(self._lights), None
        self._looks = make_looks(launcher, materials)
        self._points = self._surface_points(materials)
        self._detail = allocate_detail(launcher, count, "bake", materials)
        self._ambient = wp.vec3(*ambient)
        self._allocate_light(bakes, ambient)
        shadows = [int(light.path in shadowed) for light in self._lights]
        self._visibility, self.visibility = self._make_shares(shadows, count)
        self.visibility = {path: rows[0] for path, rows in self.visibility.items()}
        self._channels = [
            0 if light.path not in smoke_shadowed else 3 if light.path in color_shadowed else 1
            for light in self._lights
        ]
        self._transmittance, self.transmittance = self._make_shares(self._channels, count)
        self._seen = launcher.array(np.arange(count, dtype=np.int32), "bake")
        self._always = launcher.array(np.ones(count, np.uint8), "bake")
        self._part: _Part | None = None
        self.smoke_points = self.map.points
        self.warnings = warnings

    def _allocate_light(self, bakes: Collection[str], ambient: tuple[float, float, float]) -> None:
        """Allocates each light's contribution to the bakes, and their sums."""
        launcher, count = self._launcher, self.map.count
        by_light = (len(self._lights), max(count, 1))  # Warp cannot take a row of an empty array
        self._radiance = self._irradiance = self._weights = None
        if "lit" in bakes:
            self._radiance = launcher.zeros(by_light, "bake", dtype=wp.vec3)
        if "irradiance" in bakes:
            self._ambient_light = launcher.array(np.tile(np.float32(ambient), (count, 1)), "bake", dtype=wp.vec3)
            self._irradiance = launcher.zeros(by_light, "bake", dtype=wp.vec3)
        if "lit" in bakes or "irradiance" in bakes:
            self._lit = launcher.zeros(count, "bake", dtype=wp.vec3)
        if "visibility" in bakes or "smokeShadow" in bakes:
            self._weights = launcher.zeros(by_light, "bake")
            self._shares = launcher.zeros(count, "bake")

    def _surface_points(self, materials: Sequence[Material]) -> SurfacePoints:
        points = SurfacePoints()
        points.positions, points.normals, points.tangents = self.map.points, self.map.normals, self.map.tangents
        pictures = any(material.has_pictures for material in materials)
        uvs = self.map.uvs if pictures else np.zeros((1, 2), np.float32)
        points.uvs = self._launcher.array(uvs, "bake", dtype=wp.vec2)
        points.material = self._launcher.array(self.map.material, "bake")
        return points

    def _make_shares(self, channels: Sequence[int], count: int) -> tuple[Shares, dict[str, wp.array]]:
        """Makes shares of 1 with each light's number of channels, and views of its rows by path."""
        shares, views = make_shares(self._launcher, channels, count)
        return shares, {light.path: view for light, view in zip(self._lights, views, strict=True) if view is not None}

    def update(self, time: float) -> None:
        """Updates points, normals and unshadowed light to a time code; computes only what changed."""
        moved = self.map.update(time)
        eye = np.zeros(4)
        if self._camera is not None:
            eye[:3], eye[3] = self._camera.transform_at(time)[3, :3] - self._origin, 1.0
        first, looked = self._eye is None, not np.array_equal(eye, self._eye)
        self._eye = eye
        if first or moved or (looked and self._follows_eye):
            self._look_up_detail()
            moved = True
        for index, light in enumerate(self._lights):
            source, before = light_source(light, self._origin, time), self._sources[index]
            changed = moved or before is None or source.numpy_value() != before.numpy_value()
            self._sources[index] = source
            self._shade(index, changed, looked)

    def _look_up_detail(self) -> None:
        count, eye = self.map.count, wp.vec4(*self._eye)
        look_up_detail(self._launcher, count, self._looks, self._points, eye, self._ambient, self._detail)

    def _shade(self, index: int, changed: bool, looked: bool) -> None:
        """Shades the receiver by a light, if the light or the receiver `changed` or the eye moved (`looked`)."""
        args = (self._launcher, self.map.count, self._sources[index])
        if changed and self._weights is not None:
            weigh_light(*args, self._points, self._detail, self._weights[index])
        if changed and self._irradiance is not None:
            shade_irradiance(*args, self._points, self._detail, self._irradiance[index])
        if (changed or looked) and self._radiance is not None:
            eye = wp.vec4(*self._eye)
            shade_light(*args, self._looks, self._points, self._detail, eye, self._radiance[index])

    def brightest_light(self) -> tuple[Light | None, float]:
        """Returns the light with the largest unshadowed value in `lit`, and that value, linear; None and 0 if none."""
        values = [float(radiance.max(initial=0.0)) for radiance in self._radiance.numpy()] if self._lights else []
        return max(zip(self._lights, values, strict=True), key=lambda pair: pair[1], default=(None, 0.0))

    def picture(self, bake: str) -> np.ndarray:
        """Computes the current picture of one of the receiver's bakes.

        Args:
            bake: one of `bakes`.

        Returns:
            For a `TexelMap`: lit as sRGB [h, w, 3], or [h, w, 4] with opacity if a material is see-through, irradiance
            as linear [h, w, 3], normal as directions [h, w, 3], and shares as raw [h, w]; uint8, or uint16 where the
            receiver asks for 16 bits and always for irradiance; first row at the top. For a `VertexMap`: linear RGB or
            directions [n, 3], or shares [n], float32.
        """
        if bake == "normal":
            return self.map.direction_picture(self._detail.normals)
        if bake == "visibility":
            average_visibility(self._launcher, self._weights, self._visibility, self._shares)
            return self.map.share_picture(bake, self._shares)
        if self._part is None:
            return self._draw(bake, self._put_together(bake, self._seen, self._transmittance))
        if bake not in self._part.drawn:
            self._draw(bake, self._put_together(bake, self._seen, self._part.unshadowed))
            self._part.drawn.add(bake)
        return self._draw(bake, self._put_together(bake, self._part.points, self._transmittance), self._part.change)

    def pictures(self, bakes: Collection[str]) -> dict[str, np.ndarray]:
        """Computes the current pictures of some bakes; after `limit_smoke` these must be the same each time.

        Texels on which the smoke's shadow has not changed since the last call are then not recomputed.
        """
        if self._part is not None:
            find_changes(self._launcher, self._transmittance, self._part.before, self._part.change.flags)
        return {bake: self.picture(bake) for bake in bakes}

    def limit_smoke(self, reached: np.ndarray) -> None:
        """Declares that from here on only the smoke changes, and which points it can shadow.

        Pictures are then recomputed only there. Values at points (`VertexMap`) are still recomputed everywhere.

        Args:
            reached: indices of the points that smoke may shadow, [k], ascending; `transmittance` and `smoke_points`
                belong to these from now on.
        """
        if isinstance(self.map, VertexMap):
            return
        self._transmittance, self.transmittance = self._make_shares(self._channels, len(reached))
        before, _ = self._make_shares(self._channels, len(reached))
        unshadowed, _ = self._make_shares([0] * len(self._lights), 1)
        self._part = _Part(self._launcher, self.map, reached, before, unshadowed)
        self.smoke_points = self._launcher.array(self.map.points.numpy()[reached], "bake", dtype=wp.vec3)

    def _draw(self, bake: str, values: wp.array, *change: Change) -> np.ndarray:
        """Draws a bake's picture with new values, at all points or where they change."""
        if bake == "smokeShadow":
            return self.map.share_picture(bake, values, *change)
        if bake == "irradiance":
            return self.map.linear_picture(bake, values, *change)
        codes = self.map.color_picture(bake, values, *change)
        if isinstance(self.map, TexelMap) and self._is_see_through:
            return pack_channels(codes, self.map.share_picture("opacity", self._detail.opacity))
        return codes

    def _put_together(self, bake: str, points: wp.array, transmittance: Shares) -> wp.array:
        """Computes the values of a bake at some points, with the smoke's transmittance there."""
        flags = self._part.change.flags if self._part is not None and points is self._part.points else self._always
        args = (self._visibility, transmittance)
        if bake == "smokeShadow":
            average_transmittance(self._launcher, points, flags, self._weights, *args, self._shares)
            return self._shares
        lights = (self._detail.unlit, self._radiance) if bake == "lit" else (self._ambient_light, self._irradiance)
        add_lights(self._launcher, points, flags, *lights, *args, self._lit)
        return self._lit


class _Part:
    """The texels that smoke may shadow.

    Attributes:
        points: their indices, [k].
        change: where a picture shows them, and on which of them the smoke's shadow has changed.
        before: the smoke's transmittance that the pictures show.
        unshadowed: transmittance without smoke, for the other texels.
        drawn: the bakes whose pictures already show the other texels.
    """

    def __init__(self, launcher: Launcher, texels: TexelMap, reached: np.ndarray, before: Shares, unshadowed: Shares):
        index = np.full(texels.count + 1, -1, np.int32)  # with one more for places that show no texel
        index[reached] = np.arange(len(reached))
        self.points = launcher.array(np.asarray(reached, np.int32), "bake")
        self.change = Change(launcher, index[texels.picture.source])
        self.before, self.unshadowed = before, unshadowed
        self.drawn: set[str] = set()
