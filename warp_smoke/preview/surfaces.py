"""Meshes of the set as VTK draws them: with their baked light, or with their material under the stage's lights."""

from dataclasses import replace

import numpy as np
import pyvista as pv

from warp_smoke.preview.color import expose_codes, linear_to_srgb, to_bytes
from warp_smoke.preview.opacity import lie_alike, plain_opacity, read_opacity, with_alpha
from warp_smoke.record import value_at
from warp_smoke.scene import Material, Procedural, Surface, Texture
from warp_smoke.shading.procedural import make_picture
from warp_smoke.shading.textures import Picture

COMPUTED_SIZE = 1024  # at most, of computed pictures [texels]
LARGEST_SIZE = 8192  # along a side, that all drivers draw [texels]
PLAIN = Texture(file="")  # placed by the surface's texture coordinates alone

_WRAPS = {
    "repeat": pv.Texture.WrapType.REPEAT,
    "clamp": pv.Texture.WrapType.CLAMP_TO_EDGE,
    "mirror": pv.Texture.WrapType.MIRRORED_REPEAT,
    "black": pv.Texture.WrapType.CLAMP_TO_BORDER,
}
# VTK adds up light in the space of its colours. They are linear here, so the sum is encoded at the end.
_ENCODE_SRGB = """//VTK::TCoord::Impl
  vec3 light = clamp(gl_FragData[0].rgb, 0.0, 1.0);
  gl_FragData[0].rgb = mix(12.92 * light, 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, light));
"""


class SurfaceActor:
    """One mesh of the set, initially with its material; exposures are in stops, each of which doubles the light.

    Attributes:
        surface: the scene's record.
        actor: what VTK draws.
    """

    def __init__(self, surface: Surface, ambient: np.ndarray, time: float):
        self.surface = surface
        mesh = surface.mesh
        # Each triangle's corners get their own points, since normals and UVs belong to corners.
        corners = mesh.points_at(time)[mesh.triangles].reshape(-1, 3)
        self._poly = pv.PolyData.from_regular_faces(corners, np.arange(len(corners)).reshape(-1, 3))
        if mesh.normals is not None:
            self._poly.point_data.active_normals = mesh.normals_at(time).reshape(-1, 3)
        self.actor = pv.Actor(mapper=pv.DataSetMapper(self._poly))
        self.actor.mapper.scalar_visibility = False
        self.actor.prop.interpolation = "flat" if mesh.normals is None else "phong"
        self._shown: tuple[object, float] = (None, 0.0)
        self.show_material(surface.material or Material(), ambient)

    def show_material(self, material: Material, ambient: np.ndarray, exposure: float = 0.0) -> None:
        """Draws a material, matte, under VTK's lights, which have the same exposure."""
        if not self._changes_to(material, exposure):
            return
        self.actor.prop.lighting = True
        self.actor.prop.opacity = plain_opacity(material)
        self.actor.mapper.scalar_visibility = False
        self.actor.texture = None
        has_picture = self.surface.mesh.uvs is not None and self._lay_picture(material)
        diffuse = np.ones(3) if has_picture else np.asarray(material.diffuse_color)
        self.actor.prop.SetDiffuseColor(*diffuse)
        self.actor.prop.SetAmbientColor(*(2.0**exposure * (diffuse * ambient + material.emissive_color)))
        self.actor.prop.ambient = self.actor.prop.diffuse = 1.0
        self.actor.prop.specular = 0.0
        self.actor.GetShaderProperty().ClearAllFragmentShaderReplacements()
        self.actor.GetShaderProperty().AddFragmentShaderReplacement("//VTK::TCoord::Impl", True, _ENCODE_SRGB, False)

    def _lay_picture(self, material: Material) -> bool:
        """Applies a material's picture to the mesh, with its opacity as alpha; returns whether it has colours."""
        color, opacity = material.diffuse_texture, material.opacity_texture
        place, pixels, tiles = color or opacity, None, (1, 1)
        if material.procedural is not None:
            place, pixels = PLAIN, _compute_picture(material.procedural)
        elif color is not None:
            pixels, tiles = _read_picture(color)
        has_colors = pixels is not None
        if opacity is not None:
            shares, opacity_tiles = read_opacity(material)
            tiles = tiles if has_colors else opacity_tiles
            if lie_alike(opacity, place) and opacity_tiles == tiles:
                white = np.full((*shares.shape, 3), 255, np.uint8)
                pixels = with_alpha(pixels if has_colors else white, shares)
                self.actor.prop.opacity = 1.0
            else:  # VTK places all channels of a texture in the same way
                self.actor.prop.opacity = float(shares.mean())
        if pixels is not None:
            self._lay_over(_laid_uvs(place, self.surface.mesh.uvs) / np.float32(tiles))
            self.actor.texture = make_texture(pixels, place.wrap_s)
            self.actor.texture.UseSRGBColorSpaceOn()  # VTK decodes it to linear light as it draws
        return has_colors

    def place(self, time: float) -> None:
        """Puts the mesh where it is at a time code."""
        self.actor.visibility = bool(value_at(self.surface.visible, time))
        self.actor.user_matrix = self.surface.transform_at(time).T
        mesh = self.surface.mesh
        if mesh.deforms:
            points = mesh.points_at(time)
            self._poly.points = points[mesh.triangles].reshape(-1, 3)
            if mesh.normals is not None:
                self._poly.point_data.active_normals = mesh.normals_at(time).reshape(-1, 3)

    def show_picture(self, pixels: np.ndarray, exposure: float = 0.0) -> None:
        """Draws a baked picture as it is: [h, w, 3] sRGB of 8 or 16 bits, or [h, w, 4] with opacity; top row first."""
        if self._changes_to(pixels, exposure):
            self._unlight()
            self._lay_over(self.surface.bake_uvs)
            self.actor.prop.opacity = 1.0
            colors, alpha = np.split(to_bytes(pixels), [3], axis=2)
            self.actor.texture = make_texture(np.dstack([expose_codes(colors, exposure), alpha]), "clamp")

    def show_colors(self, colors: np.ndarray, exposure: float = 0.0) -> None:
        """Draws baked colours as they are: linear RGB at each point of the mesh, [n, 3]."""
        if self._changes_to(colors, exposure):
            self._unlight()
            self.actor.prop.opacity = plain_opacity(self.surface.material or Material())
            self.actor.texture = None
            corners = linear_to_srgb(2.0**exposure * colors)[self.surface.mesh.triangles].reshape(-1, 3)
            self._poly.point_data.set_array(corners, "baked")
            self.actor.mapper.SetColorModeToDirectScalars()
            self._poly.point_data.active_scalars_name = "baked"
            self.actor.mapper.scalar_visibility = True

    def _lay_over(self, uvs: np.ndarray | None) -> None:
        """Sets the texture coordinates at the triangles' corners, [m, 3, 2]."""
        if uvs is not None:
            self._poly.point_data.active_texture_coordinates = uvs.reshape(-1, 2)

    def _changes_to(self, shown: object, exposure: float) -> bool:
        """Records what is to be drawn, at what exposure; returns whether that is a change."""
        same = shown is self._shown[0] and exposure == self._shown[1]
        self._shown = (shown, exposure)
        return not same

    def _unlight(self) -> None:
        self.actor.prop.lighting = False
        self.actor.prop.SetColor(1.0, 1.0, 1.0)
        self.actor.prop.diffuse = 0.0  # unlit, VTK shows the sum of ambient and diffuse colour
        self.actor.GetShaderProperty().ClearAllFragmentShaderReplacements()


def make_texture(pixels: np.ndarray, wrap: str) -> pv.Texture:
    """Makes a texture from [h, w, 3 or 4] uint8, top row first; only every n-th texel of one that is too large."""
    step = -(-max(pixels.shape) // LARGEST_SIZE)
    texture = pv.Texture(np.ascontiguousarray(pixels[::step, ::step]))
    texture.wrap = _WRAPS[wrap]
    texture.interpolate = True
    texture.mipmap = True
    return texture


def _read_picture(source: Texture) -> tuple[np.ndarray, tuple[int, int]]:
    """Reads a texture's colours, sRGB [h, w, 3] uint8, and its tiles along u and v.

    Its wrap mode along s is used along t too: VTK has only one.
    """
    picture = Picture.read(source.file, source.color_space)
    values = picture.levels[np.broadcast_to(picture.codes, (*picture.codes.shape[:2], 3))]
    return linear_to_srgb(values * source.scale[:3] + source.bias[:3]), picture.tiles


def _compute_picture(procedural: Procedural) -> np.ndarray:
    """Computes a picture's colours, sRGB [h, w, 3] uint8, with no more texels than a screen shows."""
    return make_picture(replace(procedural, size=min(procedural.size, COMPUTED_SIZE))).codes


def _laid_uvs(texture: Texture, uvs: np.ndarray) -> np.ndarray:
    """Returns texture coordinates scaled, rotated and translated as the texture asks."""
    angle = np.radians(texture.uv_rotation)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])  # of rows
    return (uvs * texture.uv_scale @ turn + texture.uv_translation).astype(np.float32)
