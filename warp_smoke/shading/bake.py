"""Baking: the light that reaches each point of a receiver, per light, put together into pictures each frame.

With B, l of light L at a point (`light_source.py`), V its visibility past surfaces and T the smoke's transmittance:

- `lit` = emissive + ambient ⊗ m_d + Σ_L V T ⊗ B ⊗ (m_d + R_F (m + 8)/8 (n·h)ᵐ) max(l·n, 0), F. Luna's LitColor, or
  what the material's reflection is (`blinn_phong`);
- `irradiance` = ambient + Σ_L V T ⊗ B max(l·n, 0), irradiance/π: what a white matte surface would look like;
- `normal`: the direction that light is reflected by, along the stage's axes;
- `visibility` = Σ_L w V / Σ_L w, the share of the light that surfaces let through, and
- `smokeShadow` = Σ_L w V T / Σ_L w V, the share of the remaining light that smoke lets through, with the luminance
  w = Y(B) max(l·n, 0) of the light that would arrive; 1 where none would. So visibility · smokeShadow is the share of
  all light that arrives, whatever the material. Where smoke is coloured, T is its luminance here.
"""

from collections.abc import Collection, Sequence

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Camera, Light, Material, Surface
from warp_smoke.shading.light_source import light_source
from warp_smoke.shading.looks import make_looks, without_pictures, without_relief
from warp_smoke.shading.normal_map import pack_channels
from warp_smoke.shading.radiance import shade_irradiance, shade_light, weigh_light
from warp_smoke.shading.surface_points import SurfacePoints, allocate_detail, look_up_detail
from warp_smoke.shading.texels import TexelMap
from warp_smoke.shading.vertices import VertexMap
from warp_smoke.uv_fit import BAKE_UVS

wp.set_module_options({"enable_backward": False})

# Charts beside each other may share so many of their texels when coordinates are brought into [0, 1].
_OVERLAP_OF_ROUNDING = 0.01
_LUMINANCE = wp.constant(wp.vec3(0.2126, 0.7152, 0.0722))  # of linear Rec. 709 RGB


class ReceiverBake:
    """The light on one receiver, and the pictures baked for it.

    Whoever computes shadows writes them into `visibility` and `transmittance`; nothing is recomputed here while
    light, receiver and camera stand still, apart from the pictures that are asked for.

    Attributes:
        map: the points that are baked, a `TexelMap`, or a `VertexMap` if the texture coordinates hold no picture.
        visibility: by path of light, [n] float32, the share that surfaces let through; 1 until written.
        transmittance: by path of light, [1, n] float32, the share that smoke lets through, or [3, n] for red, green
            and blue where the smoke is coloured; 1 until written.
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
            bakes: pictures that will be asked for, of `scene.BAKES`.
            ambient: light from everywhere, linear RGB.
            camera: whose view the highlights are seen from; None leaves them out.
            shadowed: paths of the lights from which surfaces shadow it.
            smoke_shadowed: paths of the lights from which smoke shadows it.
            color_shadowed: those of them whose light is coloured by it.

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
        by_light = (len(self._lights), max(count, 1))  # Warp takes no row of an empty array
        self._sources, self._eye = [None] * len(self._lights), None
        self._looks = make_looks(launcher, materials)
        self._points = self._surface_points(materials)
        self._detail = allocate_detail(launcher, count, "bake", materials)
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
        self._ambient = wp.vec3(*ambient)
        self._visibility, self._visibility_row, visibility = self._shares_by_light(shadowed)
        self.visibility = {path: rows[0] for path, rows in visibility.items()}
        args = (smoke_shadowed, color_shadowed)
        self._transmittance, self._transmittance_row, self.transmittance = self._shares_by_light(*args)
        self.warnings = warnings

    def _surface_points(self, materials: Sequence[Material]) -> SurfacePoints:
        points = SurfacePoints()
        points.positions, points.normals, points.tangents = self.map.points, self.map.normals, self.map.tangents
        pictures = any(material.has_pictures for material in materials)
        uvs = self.map.uvs if pictures else np.zeros((1, 2), np.float32)
        points.uvs = self._launcher.array(uvs, "bake", dtype=wp.vec2)
        points.material = self._launcher.array(self.map.material, "bake")
        return points

    def _shares_by_light(
        self, paths: Collection[str], colored: Collection[str] = ()
    ) -> tuple[wp.array, wp.array, dict[str, wp.array]]:
        """Ones for the lights named, one row or three, [rows, n], the rows of each light or −1, and views by path."""
        rows, count = [], 0
        for light in self._lights:
            channels = 0 if light.path not in paths else 3 if light.path in colored else 1
            rows.append(count + np.arange(3) % channels if channels else np.full(3, -1))
            count += channels
        shares = self._launcher.array(np.ones((count, max(self.map.count, 1)), np.float32), "bake")
        views = {
            light.path: shares[int(row[0]) : int(row[2]) + 1]
            for light, row in zip(self._lights, rows, strict=True)
            if row[0] >= 0
        }
        rows = np.array(rows, np.int32).reshape(-1, 3)
        return shares, self._launcher.array(rows, "bake", dtype=wp.vec3i), views

    def update(self, time: float) -> None:
        """Brings points, normals and unshadowed light to a time code; computes only what changed."""
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
        """Light number `index` on the receiver, after the light or the receiver `changed`, or the eye moved."""
        args = (self._launcher, self.map.count, self._sources[index])
        if changed and self._weights is not None:
            weigh_light(*args, self._points, self._detail, self._weights[index])
        if changed and self._irradiance is not None:
            shade_irradiance(*args, self._points, self._detail, self._irradiance[index])
        if (changed or looked) and self._radiance is not None:
            eye = wp.vec4(*self._eye)
            shade_light(*args, self._looks, self._points, self._detail, eye, self._radiance[index])

    def picture(self, bake: str) -> np.ndarray:
        """One of the receiver's bakes as it now stands.

        Args:
            bake: one of `bakes`.

        Returns:
            From a `TexelMap` lit as sRGB [h, w, 3], or [h, w, 4] with opacity where there is any, irradiance as linear
            [h, w, 3], normal as directions [h, w, 3], and shares as raw [h, w]; uint8, or uint16 where the receiver
            asks for 16 bits and always for irradiance; first row at the top. From a `VertexMap` linear RGB or
            directions [n, 3], or shares [n], float32.
        """
        surfaces = (self._visibility, self._visibility_row)
        if bake == "normal":
            return self.map.direction_picture(self._detail.normals)
        if bake in ("lit", "irradiance"):
            lights = (self._detail.unlit, self._radiance) if bake == "lit" else (self._ambient_light, self._irradiance)
            args = (*lights, *surfaces, self._transmittance, self._transmittance_row, self._lit)
            self._launcher.launch_each(_add_lights, self.map.count, *args)
            if bake == "irradiance":
                return self.map.linear_picture(self._lit)
            codes = self.map.color_picture(self._lit)
            if isinstance(self.map, TexelMap) and self._is_see_through:
                return pack_channels(codes, self.map.share_picture(self._detail.opacity))
            return codes
        if bake == "visibility":
            args = (self._weights, *surfaces, self._shares)
            self._launcher.launch_each(_average_visibility, self.map.count, *args)
        else:
            args = (self._weights, *surfaces, self._transmittance, self._transmittance_row, self._shares)
            self._launcher.launch_each(_average_transmittance, self.map.count, *args)
        return self.map.share_picture(self._shares)


def map_surface(launcher: Launcher, surface: Surface, origin: np.ndarray) -> tuple[TexelMap | VertexMap, tuple]:
    """The texels of a receiver, or its points where its texture coordinates hold no picture, and warnings."""
    uvs, path = surface.mesh.uvs, surface.path
    instead = "colours at its points are baked instead of a texture"
    if uvs is None:
        return VertexMap(launcher, surface, origin), (f"{path}: no texture coordinates; {instead}",)
    if not np.all(np.isfinite(uvs)):
        return VertexMap(launcher, surface, origin), (f"{path}: texture coordinates are not finite; {instead}",)
    texels = TexelMap(launcher, surface, origin)
    if texels.count == 0:
        return VertexMap(launcher, surface, origin), (f"{path}: texture coordinates cover no area; {instead}",)
    warnings = ()
    if surface.bake_fit is not None:
        reach = f"{path}: texture coordinates reach over {uvs.min():g}…{uvs.max():g}"
        if texels.overlapping > _OVERLAP_OF_ROUNDING * texels.count:
            warning = f"{reach} and overlap in {texels.overlapping} of {texels.count} texels; {instead}"
            return VertexMap(launcher, surface, origin), (warning,)
        warnings = (f"{reach}; the bake has its own within [0, 1], primvars:{BAKE_UVS}",)
    if texels.overlapping:
        warning = f"{path}: texture coordinates overlap in {texels.overlapping} of {texels.count} texels"
        warnings += (f"{warning}; these show only the first of the triangles there",)
    return texels, warnings


def usable_materials(surface: Surface, places: TexelMap | VertexMap) -> tuple[tuple[Material, ...], tuple]:
    """A receiver's materials as far as its texture coordinates serve, and warnings."""
    usable, warnings = [], []
    for material in surface.materials:
        if places.uvs is None and material.has_pictures:
            warnings.append(
                f"{surface.path}: the textures of {material.path} have no coordinates; its colours are used"
            )
            material = without_pictures(material)
        elif isinstance(places, VertexMap) and material.needs_tangents:
            warnings.append(f"{surface.path}: normals and heights of {material.path} are left out of colours at points")
            material = without_relief(material)
        usable.append(material)
    return tuple(usable), tuple(warnings)


@wp.func
def share_at(shares: wp.array2d[float], rows: wp.vec3i, s: int):
    """The share of a light that is let through, for each of red, green and blue; all of it without rows."""
    if rows[0] < 0:
        return wp.vec3(1.0, 1.0, 1.0)
    return wp.vec3(shares[rows[0], s], shares[rows[1], s], shares[rows[2], s])


@wp.kernel
def _add_lights(
    rows: Rows,
    unlit: wp.array[wp.vec3],
    radiance: wp.array2d[wp.vec3],
    visibility: wp.array2d[float],
    visibility_row: wp.array[wp.vec3i],
    transmittance: wp.array2d[float],
    transmittance_row: wp.array[wp.vec3i],
    lit_out: wp.array[wp.vec3],
):
    """lit[s] = unlit[s] + Σ V ⊗ T ⊗ radiance."""
    s = rows.first + wp.tid()
    lit = unlit[s]
    for light in range(radiance.shape[0]):
        v = share_at(visibility, visibility_row[light], s)
        lit += wp.cw_mul(wp.cw_mul(v, share_at(transmittance, transmittance_row[light], s)), radiance[light, s])
    lit_out[s] = lit


@wp.kernel
def _average_visibility(
    rows: Rows,
    weights: wp.array2d[float],
    visibility: wp.array2d[float],
    visibility_row: wp.array[wp.vec3i],
    shares_out: wp.array[float],
):
    """shares[s] = Σ w V / Σ w, or 1."""
    s = rows.first + wp.tid()
    total = wp.float32(0.0)  # a literal could not change in the loop
    passed = wp.float32(0.0)
    for light in range(weights.shape[0]):
        w = weights[light, s]
        total += w
        passed += w * share_at(visibility, visibility_row[light], s)[0]
    shares_out[s] = wp.where(total > 0.0, passed / total, 1.0)


@wp.kernel
def _average_transmittance(
    rows: Rows,
    weights: wp.array2d[float],
    visibility: wp.array2d[float],
    visibility_row: wp.array[wp.vec3i],
    transmittance: wp.array2d[float],
    transmittance_row: wp.array[wp.vec3i],
    shares_out: wp.array[float],
):
    """shares[s] = Σ w V T / Σ w V, or 1."""
    s = rows.first + wp.tid()
    total = wp.float32(0.0)  # a literal could not change in the loop
    passed = wp.float32(0.0)
    for light in range(weights.shape[0]):
        w = weights[light, s] * share_at(visibility, visibility_row[light], s)[0]
        total += w
        passed += w * wp.dot(_LUMINANCE, share_at(transmittance, transmittance_row[light], s))
    shares_out[s] = wp.where(total > 0.0, passed / total, 1.0)
