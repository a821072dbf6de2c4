"""Materials and their pictures on the device: one table for everything that is shaded together."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.material import (
    CHANNELS,
    COLOR_TEXTURES,
    GLOSS_ROLES,
    PARALLAXES,
    REFLECTIONS,
    TEXTURES,
    WRAP_MODES,
    Material,
    Texture,
)
from warp_smoke.shading.procedural import make_picture
from warp_smoke.shading.textures import Picture, read_texture

wp.set_module_options({"enable_backward": False})

_REPEAT, _CLAMP, _MIRROR = (wp.constant(WRAP_MODES.index(mode)) for mode in ("repeat", "clamp", "mirror"))
_RED, _ALPHA = (wp.constant(CHANNELS.index(channel)) for channel in ("r", "a"))
# Texel coordinates beyond this are clipped, so that they fit an int.
_FARTHEST = wp.constant(1.0e9)


@wp.struct
class TextureLook:
    """A picture in `Looks.texels`, and its placement on a surface: uv has the texel coordinates turned · uv + moved."""

    first: int
    width: int
    height: int
    wrap_s: int
    wrap_t: int
    channel: int
    scale: wp.vec4
    bias: wp.vec4
    turned: wp.mat22
    moved: wp.vec2


@wp.struct
class MaterialLook:
    """A `Material`, with textures as indices (−1 for none), tokens as indices into tuples of `warp_smoke.material`."""

    diffuse: wp.vec3
    r0: wp.vec3
    emissive: wp.vec3
    roughness: float
    metallic: float
    occlusion: float
    opacity: float
    opacity_threshold: float
    reflection: int
    gloss: int
    parallax: int
    parallax_scale: float
    parallax_bias: float
    diffuse_texture: int
    specular_texture: int
    emissive_texture: int
    normal_texture: int
    height_texture: int
    roughness_texture: int
    metallic_texture: int
    occlusion_texture: int
    opacity_texture: int


@wp.struct
class Looks:
    """All materials, their textures, and the textures' texels as linear RGBA, rows from the top."""

    materials: wp.array[MaterialLook]
    textures: wp.array[TextureLook]
    texels: wp.array[wp.vec4]


def make_looks(launcher: Launcher, materials: Sequence[Material]) -> Looks:
    """Reads the materials' pictures and copies everything to the device; a shared picture is stored once.

    Args:
        launcher: where to allocate.
        materials: the materials of the surfaces that are shaded.

    Raises:
        FieldError: a texture's file cannot be read.
    """
    table = _TextureTable()
    found = [_material_look(material, table) for material in materials]
    looks, device = Looks(), launcher.device
    looks.materials = wp.array(found, dtype=MaterialLook, device=device)
    looks.textures = wp.array(table.textures or [TextureLook()], dtype=TextureLook, device=device)
    texels = np.concatenate(table.texels or [np.zeros((1, 4), np.float32)])
    looks.texels = launcher.array(texels, "textures", dtype=wp.vec4)
    return looks


class _TextureTable:
    """Textures and their pictures' texels, as they are copied to the device.

    Attributes:
        textures: in the order in which they were added.
        texels: linear RGBA of each picture, [texels, 4] float32.
    """

    def __init__(self):
        self.textures: list[TextureLook] = []
        self.texels: list[np.ndarray] = []
        self._places: dict[tuple, tuple[int, tuple[int, int], tuple[int, int]]] = {}  # see `_texture_look`
        self._count = 0

    def add(self, texture: Texture, key: tuple, read: Callable[[], Picture]) -> int:
        """Adds a texture, and its picture unless this key is already stored; returns the texture's index."""
        if key not in self._places:
            picture = read()
            linear = picture.linear()
            self._places[key] = self._count, linear.shape[:2], picture.tiles
            self.texels.append(linear.reshape(-1, 4))
            self._count += len(self.texels[-1])
        self.textures.append(_texture_look(texture, *self._places[key]))
        return len(self.textures) - 1


def _material_look(material: Material, table: _TextureTable) -> MaterialLook:
    """Returns a material in the form that kernels take, and adds its textures to the table."""
    look = MaterialLook()
    look.diffuse, look.r0 = wp.vec3(*material.diffuse_color), wp.vec3(*material.fresnel_r0)
    look.emissive = wp.vec3(*material.emissive_color)
    for field in ("roughness", "metallic", "occlusion", "opacity", "opacity_threshold"):
        setattr(look, field, getattr(material, field))
    look.reflection = REFLECTIONS.index(material.reflection)
    look.gloss = GLOSS_ROLES.index(material.gloss)
    look.parallax = PARALLAXES.index(material.parallax if material.has_relief else "none")
    look.parallax_scale, look.parallax_bias = material.parallax_scale, material.parallax_bias
    for field in TEXTURES:
        texture, index = getattr(material, field), -1
        if texture is not None:
            key = (texture.file, texture.color_space, field in COLOR_TEXTURES)
            index = table.add(texture, key, partial(read_texture, material, field))
        setattr(look, field, index)
    if material.procedural is not None:
        computed = partial(make_picture, material.procedural)
        look.diffuse_texture = table.add(Texture(file="procedural"), (material.path, "procedural"), computed)
    return look


def without_coordinates(material: Material, surface: str) -> tuple[Material, tuple[str, ...]]:
    """Returns a material without pictures, for a surface without texture coordinates, and a warning if it had any."""
    if not material.has_pictures:
        return material, ()
    warning = f"{surface}: the textures of {material.path} have no coordinates; its colours are used"
    return replace(material, procedural=None, **dict.fromkeys(TEXTURES)), (warning,)


def without_relief(material: Material) -> Material:
    """Returns a material without the textures that need tangents."""
    return replace(material, normal_texture=None, height_texture=None)


def _texture_look(texture: Texture, first: int, size: tuple[int, int], tiles: tuple[int, int]) -> TextureLook:
    """A texture as kernels see it.

    Args:
        texture: how it lies on a surface.
        first: where its picture's texels begin.
        size: of the picture, (height, width).
        tiles: unit squares of texture coordinates that the picture covers along u and v.
    """
    look, (height, width) = TextureLook(), size
    look.first, look.width, look.height = first, width, height
    look.wrap_s, look.wrap_t = WRAP_MODES.index(texture.wrap_s), WRAP_MODES.index(texture.wrap_t)
    look.channel = CHANNELS.index(texture.channel)
    look.scale, look.bias = wp.vec4(*texture.scale), wp.vec4(*texture.bias)
    # UsdTransform2d scales, then rotates, then translates; rows run from the top, so v changes sign.
    angle = math.radians(texture.uv_rotation)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    to_texels = np.diag([width / tiles[0], -height / tiles[1]])
    look.turned = wp.mat22((to_texels @ turn @ np.diag(texture.uv_scale)).astype(np.float32))
    look.moved = wp.vec2(*(to_texels @ np.asarray(texture.uv_translation) + (-0.5, height - 0.5)))
    return look


@wp.func
def _wrap(index: int, count: int, mode: int):
    """The texel to use for an index that may lie outside the picture; −1 for black."""
    if mode == _REPEAT:
        m = index % count
        return wp.where(m < 0, m + count, m)
    if mode == _CLAMP:
        return wp.clamp(index, 0, count - 1)
    if mode == _MIRROR:
        m = index % (2 * count)
        m = wp.where(m < 0, m + 2 * count, m)
        return wp.min(m, 2 * count - 1 - m)
    return wp.where(index >= 0 and index < count, index, -1)


@wp.func
def _texel(looks: Looks, first: int, column: int):
    """A texel of the row that starts at `first`; black where either index is −1."""
    if first < 0 or column < 0:
        return wp.vec4(0.0)
    return looks.texels[first + column]


@wp.func
def _row_start(texture: TextureLook, row: int):
    """Where a row of texels starts; −1 for black."""
    i = _wrap(row, texture.height, texture.wrap_t)
    return wp.where(i < 0, -1, texture.first + i * texture.width)


@wp.func
def sample_texture(looks: Looks, index: int, uv: wp.vec2):
    """Scale · texel + bias, linear RGBA, bilinear between the four nearest texels.

    Texel (row, column) has its centre at u = (column + ½)/w, v = 1 − (row + ½)/h.
    """
    texture = looks.textures[index]
    x = texture.turned * uv + texture.moved
    s = wp.clamp(x[0], -_FARTHEST, _FARTHEST)
    t = wp.clamp(x[1], -_FARTHEST, _FARTHEST)
    left = wp.floor(s)
    upper = wp.floor(t)
    f = s - left
    g = t - upper
    i = _row_start(texture, int(upper))
    below = _row_start(texture, int(upper) + 1)
    j = _wrap(int(left), texture.width, texture.wrap_s)
    right = _wrap(int(left) + 1, texture.width, texture.wrap_s)
    first = (1.0 - f) * _texel(looks, i, j) + f * _texel(looks, i, right)
    second = (1.0 - f) * _texel(looks, below, j) + f * _texel(looks, below, right)
    return wp.cw_mul((1.0 - g) * first + g * second, texture.scale) + texture.bias


@wp.func
def sample_number(looks: Looks, index: int, uv: wp.vec2):
    """The channel that a texture of numbers uses; red where it names all three."""
    rgba = sample_texture(looks, index, uv)
    return rgba[wp.clamp(looks.textures[index].channel, _RED, _ALPHA) - _RED]


@wp.func
def color_at(looks: Looks, index: int, uv: wp.vec2, plain: wp.vec3):
    """A texture's colour, not below 0, or the plain one where there is no texture."""
    if index < 0:
        return plain
    rgba = sample_texture(looks, index, uv)
    return wp.vec3(wp.max(rgba[0], 0.0), wp.max(rgba[1], 0.0), wp.max(rgba[2], 0.0))


@wp.func
def share_of(looks: Looks, index: int, uv: wp.vec2, plain: float):
    """A texture's number within 0…1, or the plain one where there is no texture."""
    if index < 0:
        return plain
    return wp.clamp(sample_number(looks, index, uv), 0.0, 1.0)


@wp.func
def opacity_at(looks: Looks, m: MaterialLook, uv: wp.vec2):
    """Share of the light from behind that a surface hides: 0 or 1 where the material has a threshold."""
    opacity = share_of(looks, m.opacity_texture, uv, m.opacity)
    if m.opacity_threshold > 0.0:
        return wp.where(opacity >= m.opacity_threshold, 1.0, 0.0)
    return opacity
