"""Materials: the bound `UsdPreviewSurface`, with a `UsdUVTexture` on its diffuse colour."""

from pxr import Ar, Sdf, Usd, UsdShade

from warp_smoke.scene import Material, Texture
from warp_smoke.usd.names import MATERIAL, TEXTURE
from warp_smoke.usd.reader import StageReader, shortest_decimal

# What UsdPreviewSurface falls back to.
PREVIEW_SURFACE = {
    "diffuseColor": (0.18, 0.18, 0.18),
    "emissiveColor": (0.0, 0.0, 0.0),
    "useSpecularWorkflow": 0,
    "specularColor": (0.0, 0.0, 0.0),
    "metallic": 0.0,
    "roughness": 0.5,
    "ior": 1.5,
}
# Inputs that surfaces are read without, and the values at which they do nothing.
WITHOUT_EFFECT = {
    "normal": (0.0, 0.0, 1.0),
    "opacity": 1.0,
    "opacityThreshold": 0.0,
    "occlusion": 1.0,
    "displacement": 0.0,
    "clearcoat": 0.0,
}
# As its specification says, a texture without wrap modes, in a file that has none either, is black outside [0, 1].
WRAP_MODES = {"useMetadata": "black"}


class MaterialReader:
    """Reads each material of a stage once."""

    def __init__(self, reader: StageReader):
        self._reader = reader
        self._materials: dict[Sdf.Path, Material | None] = {}

    def bound_to(self, prim: Usd.Prim) -> Material | None:
        """The material of a prim; None, with a warning, if it is not a `UsdPreviewSurface`; None if it has none.

        Raises:
            ValueError: one line naming file, prim and attribute.
        """
        binding = UsdShade.MaterialBindingAPI(prim)
        if any(UsdShade.MaterialBindingAPI(one.GetPrim()).ComputeBoundMaterial()[0] for one in _subsets(binding)):
            self._reader.warn(prim, "materials of its face subsets are not supported; the mesh's own one is used")
        material, _ = binding.ComputeBoundMaterial(UsdShade.Tokens.full)
        if not material:
            return None
        path = material.GetPath()
        if path not in self._materials:
            self._materials[path] = self._read(material)
        return self._materials[path]

    def _read(self, material: UsdShade.Material) -> Material | None:
        surface, _, _ = material.ComputeSurfaceSource()
        if not surface or surface.GetShaderId() != "UsdPreviewSurface":
            text = "only UsdPreviewSurface is supported; what it is bound to is read as grey"
            self._reader.warn(material.GetPrim(), text)
            return None
        for name, value in WITHOUT_EFFECT.items():
            source = _source(surface, name)
            if source and (_is_output(source) or self._reader.still(source) != value):
                self._reader.warn(surface.GetPrim(), f"inputs:{name} is not supported; it has no effect")

        values = {name: self._value(surface, name) for name in PREVIEW_SURFACE if name != "diffuseColor"}
        source = _source(surface, "diffuseColor")
        texture, diffuse = None, PREVIEW_SURFACE["diffuseColor"]
        textured = source is not None and _is_output(source)
        if textured:
            texture = self._read_texture(surface, source)
            hidden = surface.GetInput("diffuseColor").GetAttr()
            if hidden.HasAuthoredValue():
                diffuse = self._reader.still(hidden)
        elif source is not None:
            diffuse = self._reader.still(source)

        r0 = values["specularColor"]
        if not values["useSpecularWorkflow"]:
            n = values["ior"]
            r0 = (shortest_decimal(((n - 1.0) / (n + 1.0)) ** 2),) * 3
            metallic = values["metallic"]
            if metallic and textured:
                text = "inputs:metallic with a textured diffuseColor is not supported; it has no effect"
                self._reader.warn(surface.GetPrim(), text)
            elif metallic:
                pairs = zip(r0, diffuse, strict=True)
                r0 = tuple(shortest_decimal((1.0 - metallic) * a + metallic * b) for a, b in pairs)
                diffuse = tuple(shortest_decimal((1.0 - metallic) * a) for a in diffuse)
        with self._reader.naming(surface.GetPath(), MATERIAL):
            return Material(
                path=str(material.GetPath()),
                diffuse_color=diffuse,
                diffuse_texture=texture,
                fresnel_r0=r0,
                roughness=values["roughness"],
                emissive_color=values["emissiveColor"],
            )

    def _value(self, shader: UsdShade.Shader, name: str) -> object:
        """An input's number; its fallback, with a warning, if it comes from another shader."""
        source = _source(shader, name)
        if source is None:
            return PREVIEW_SURFACE[name]
        if _is_output(source):
            self._reader.warn(shader.GetPrim(), f"a texture on inputs:{name} is not supported; its default is used")
            return PREVIEW_SURFACE[name]
        return self._reader.still(source)

    def _read_texture(self, surface: UsdShade.Shader, source: Usd.Attribute) -> Texture | None:
        """The texture that an output belongs to; None, with a warning, where it cannot be used."""
        shader = UsdShade.Shader(source.GetPrim())
        prim = shader.GetPrim()
        if shader.GetShaderId() != "UsdUVTexture":
            text = f"inputs:diffuseColor from {shader.GetShaderId()} is not supported; its default is used"
            self._reader.warn(surface.GetPrim(), text)
            return None
        if source.GetName() != "outputs:rgb":
            self._reader.warn(prim, f"{source.GetName()} alone is not supported as a colour; all three are used")
        coordinates = _source(shader, "st")
        if coordinates and UsdShade.Shader(coordinates.GetPrim()).GetShaderId() == "UsdTransform2d":
            self._reader.warn(coordinates.GetPrim(), "UsdTransform2d is not supported; it has no effect")

        file = _source(shader, "file")
        asset = self._reader.still(file) if file else None
        if not asset or not asset.path:
            raise self._reader.error(prim.GetPath(), "inputs:file", "unset", "a picture")
        if "<UDIM>" in asset.path or Ar.IsPackageRelativePath(asset.resolvedPath):
            text = f"inputs:file is {asset.path}: tiles (UDIM) and files inside .usdz are not supported; it is left out"
            self._reader.warn(prim, text)
            return None
        if not asset.resolvedPath:
            raise self._reader.error(prim.GetPath(), "inputs:file", f"@{asset.path}@", "a file that exists")

        fields = {"file": asset.resolvedPath}
        for field in ("wrap_s", "wrap_t", "color_space", "scale", "bias"):
            given = _source(shader, TEXTURE[field].removeprefix("inputs:"))
            if given:
                fields[field] = self._reader.still(given)
        for field in ("wrap_s", "wrap_t"):
            mode = fields.get(field, "useMetadata")
            fields[field] = WRAP_MODES.get(mode, mode)
        with self._reader.naming(prim.GetPath(), TEXTURE):
            return Texture(**fields)


def _subsets(binding: UsdShade.MaterialBindingAPI) -> list:
    return binding.GetMaterialBindSubsets() if binding.GetPrim().IsA("Mesh") else []


def _source(shader: UsdShade.Shader, name: str) -> Usd.Attribute | None:
    """The attribute that an input's value comes from: its own, the material's, or another shader's output."""
    given = shader.GetInput(name)
    attributes = given.GetValueProducingAttributes() if given else ()
    return attributes[0] if attributes else None


def _is_output(attribute: Usd.Attribute) -> bool:
    return UsdShade.Output.IsOutput(attribute)
