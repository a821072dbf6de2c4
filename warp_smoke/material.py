"""How surfaces look: materials, textures and procedural textures, as frozen records."""

from dataclasses import dataclass

from warp_smoke.record import FieldError, Record, at_least, finite, one_of, positive, whole

WRAP_MODES = ("repeat", "clamp", "mirror", "black")
COLOR_SPACES = ("auto", "sRGB", "raw")
CHANNELS = ("rgb", "r", "g", "b", "a")
REFLECTIONS = ("blinnPhong", "blinnPhongLdr", "energyConserving", "classic")
GLOSS_ROLES = ("exponent", "factor")
PARALLAXES = ("offset", "occlusion", "none")
PROCEDURALS = ("mandelbrot", "checker", "noise")
# Textures of colours, whose 8-bit files are sRGB unless they say otherwise, and textures of numbers.
COLOR_TEXTURES = ("diffuse_texture", "specular_texture", "emissive_texture")
DATA_TEXTURES = (
    "normal_texture",
    "height_texture",
    "roughness_texture",
    "metallic_texture",
    "occlusion_texture",
    "opacity_texture",
)
TEXTURES = COLOR_TEXTURES + DATA_TEXTURES


@dataclass(frozen=True, eq=False, kw_only=True)
class Texture(Record):
    """A picture on a surface (USD: `UsdUVTexture`, with coordinates from a `UsdTransform2d`).

    Attributes:
        file: absolute path; `PACKAGE[FILE]` for a file within a `.usdz` package.
        wrap_s, wrap_t: repeat, clamp, mirror or black.
        color_space: of the file: sRGB, raw, or auto (sRGB for 8-bit textures of colours, raw for all else).
        scale, bias: value = file · scale + bias, RGBA.
        channel: the channels used: rgb, or one of r, g, b, a.
        uv_scale, uv_rotation, uv_translation: coordinates are scaled, rotated counter-clockwise [degrees] and
            translated.
    """

    file: str
    wrap_s: str = "repeat"
    wrap_t: str = "repeat"
    color_space: str = "auto"
    scale: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    bias: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    channel: str = "rgb"
    uv_scale: tuple[float, float] = (1.0, 1.0)
    uv_rotation: float = 0.0
    uv_translation: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self):
        one_of(self.file, "wrap_s", self.wrap_s, WRAP_MODES)
        one_of(self.file, "wrap_t", self.wrap_t, WRAP_MODES)
        one_of(self.file, "color_space", self.color_space, COLOR_SPACES)
        one_of(self.file, "channel", self.channel, CHANNELS)
        for name, shape in (("scale", (4,)), ("bias", (4,)), ("uv_scale", (2,)), ("uv_translation", (2,))):
            self._store(name, finite(self.file, name, getattr(self, name), shape))
        self._store("uv_rotation", finite(self.file, "uv_rotation", self.uv_rotation))


@dataclass(frozen=True, eq=False, kw_only=True)
class Procedural(Record):
    """A procedural texture (USD: `smoke:procedural` on a Material); colours are linear RGB.

    Attributes:
        kind: mandelbrot, checker or noise.
        size: texels along a side.
        color1, color2: mandelbrot: the ends of the blend outside the set, by iterations; checker: the squares; noise:
            low and high.
        zoom, center, max_iterations: for the Mandelbrot set: z ← z² + c with c = 5 (uv − ½)/zoom + center.
        repeats: squares of the checker, or features of the noise, along a side.
    """

    kind: str
    size: int = 512
    color1: tuple[float, float, float] = (1.0, 0.0, 0.0)
    color2: tuple[float, float, float] = (0.0, 1.0, 0.0)
    zoom: float = 1.0
    center: tuple[float, float] = (0.0, 0.0)
    max_iterations: int = 50
    repeats: int = 8

    def __post_init__(self):
        path = "procedural"
        one_of(path, "kind", self.kind, PROCEDURALS)
        self._store("size", whole(path, "size", self.size, 1, 8192))
        self._store("max_iterations", whole(path, "max_iterations", self.max_iterations, 1, 128))
        self._store("repeats", whole(path, "repeats", self.repeats, 1, 4096))
        self._store("zoom", positive(path, "zoom", self.zoom))
        self._store("center", finite(path, "center", self.center, (2,)))
        for name in ("color1", "color2"):
            self._store(name, at_least(path, name, getattr(self, name), shape=(3,)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Material(Record):
    """How a surface reflects (Blinn-Phong with Schlick's Fresnel term); colours are linear RGB.

    Attributes:
        path: prim path.
        diffuse_color, diffuse_texture: the texture, if any, replaces the colour.
        procedural: a procedural texture, which replaces both.
        fresnel_r0, specular_texture: reflectance of the non-metal share at normal incidence.
        metallic, metallic_texture: share of metal, 0 to 1; metal has no diffuse term and a specular reflectance of
            the diffuse colour.
        roughness, roughness_texture: 0 to 1; the Blinn-Phong exponent is 256 (1 − roughness). Gloss is 1 − roughness.
        gloss: what the roughness texture does: it sets the exponent (`exponent`), or its gloss multiplies the
            highlight, whose exponent comes from `roughness` (`factor`).
        emissive_color, emissive_texture: light the surface emits.
        occlusion, occlusion_texture: share of the ambient light that arrives, 0 to 1.
        opacity, opacity_texture: share of the background that is hidden, 0 to 1.
        opacity_threshold: if above 0, the surface is a hole where opacity is below it and opaque elsewhere.
        normal_texture: normals in tangent space, −1 to 1 after the texture's scale and bias.
        height_texture: heights, 0 to 1, by which coordinates are shifted (`parallax`).
        reflection: blinnPhong, blinnPhongLdr (highlights squeezed into 0…1), energyConserving, or classic (no Fresnel
            term, exponent 64).
        parallax: offset, occlusion (marched, with shadows of the relief on itself), or none.
        parallax_scale, parallax_bias: shift of the coordinates = height · scale + bias.
    """

    path: str = "/Default"
    diffuse_color: tuple[float, float, float] = (0.18, 0.18, 0.18)
    diffuse_texture: Texture | None = None
    procedural: Procedural | None = None
    fresnel_r0: tuple[float, float, float] = (0.01, 0.01, 0.01)
    specular_texture: Texture | None = None
    metallic: float = 0.0
    metallic_texture: Texture | None = None
    roughness: float = 0.5
    roughness_texture: Texture | None = None
    gloss: str = "exponent"
    emissive_color: tuple[float, float, float] = (0.0, 0.0, 0.0)
    emissive_texture: Texture | None = None
    occlusion: float = 1.0
    occlusion_texture: Texture | None = None
    opacity: float = 1.0
    opacity_texture: Texture | None = None
    opacity_threshold: float = 0.0
    normal_texture: Texture | None = None
    height_texture: Texture | None = None
    reflection: str = "blinnPhong"
    parallax: str = "offset"
    parallax_scale: float = 0.04
    parallax_bias: float = -0.02

    def __post_init__(self):
        for name in ("diffuse_color", "fresnel_r0", "emissive_color"):
            self._store(name, at_least(self.path, name, getattr(self, name), shape=(3,)))
        for name in ("roughness", "metallic", "occlusion", "opacity", "opacity_threshold"):
            self._store(name, finite(self.path, name, getattr(self, name)))
            if not 0 <= getattr(self, name) <= 1:
                raise FieldError(self.path, name, getattr(self, name), "0 to 1")
        one_of(self.path, "gloss", self.gloss, GLOSS_ROLES)
        one_of(self.path, "reflection", self.reflection, REFLECTIONS)
        one_of(self.path, "parallax", self.parallax, PARALLAXES)
        for name in ("parallax_scale", "parallax_bias"):
            self._store(name, finite(self.path, name, getattr(self, name)))

    @property
    def has_pictures(self) -> bool:
        """Whether it has a texture or procedural texture, which need texture coordinates."""
        return self.procedural is not None or any(getattr(self, name) is not None for name in TEXTURES)

    @property
    def has_relief(self) -> bool:
        """Whether heights shift its texture coordinates, which makes them depend on the view."""
        return self.height_texture is not None and self.parallax != "none"

    @property
    def is_marched(self) -> bool:
        """Whether view and light rays are marched through its relief."""
        return self.has_relief and self.parallax == "occlusion"

    @property
    def is_see_through(self) -> bool:
        """Whether something behind it may be seen."""
        return self.opacity < 1.0 or self.opacity_texture is not None

    @property
    def is_blended(self) -> bool:
        """Whether it is blended with the background, rather than having holes."""
        return self.is_see_through and self.opacity_threshold == 0.0

    @property
    def casts_shadow(self) -> bool:
        """Whether it casts a shadow: a constant opacity must reach the threshold, or ½ without one; a texture does."""
        return self.opacity_texture is not None or self.opacity >= (self.opacity_threshold or 0.5)

    @property
    def needs_tangents(self) -> bool:
        """Whether it uses tangent space: it has a normal map or relief."""
        return self.normal_texture is not None or self.has_relief
