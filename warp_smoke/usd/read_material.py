"""Reading of materials: the bound `UsdPreviewSurface`, with `UsdUVTexture`s on the inputs that are used.

A texture on displacement provides the heights for parallax; `SmokeMaterialAPI` on the Material adds what USD cannot
express. A prim without a bound material takes its display colour.
"""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from warp_smoke.geometry import Mesh
from warp_smoke.picture_file import UDIM
from warp_smoke.record import finite, positive
from warp_smoke.scene import Material, MaterialSubset, Procedural, Texture
from warp_smoke.usd.names import MATERIAL, PROCEDURAL, TEXTURE, TRANSFORM_2D, smoke_attribute
from warp_smoke.usd.prims import uv_primvar
from warp_smoke.usd.read_display_color import read_display_color, warn_of_shadow
from warp_smoke.usd.reader import StageReader, shortest_decimal
from warp_smoke.usd.schema import schema_attributes

# The fallback values of UsdPreviewSurface.
PREVIEW_SURFACE = {
    "diffuseColor": (0.18, 0.18, 0.18),
    "emissiveColor": (0.0, 0.0, 0.0),
    "useSpecularWorkflow": 0,
    "specularColor": (0.0, 0.0, 0.0),
    "metallic": 0.0,
    "roughness": 0.5,
    "ior": 1.5,
    "occlusion": 1.0,
    "opacity": 1.0,
    "opacityThreshold": 0.0,
}
# Inputs that are ignored, and the values at which they have no effect.
WITHOUT_EFFECT = {"clearcoat": 0.0}
# The inputs that may come from a texture, and the record's fields for them.
TEXTURED = {
    "diffuseColor": "diffuse_texture",
    "specularColor": "specular_texture",
    "emissiveColor": "emissive_texture",
    "metallic": "metallic_texture",
    "roughness": "roughness_texture",
    "occlusion": "occlusion_texture",
    "opacity": "opacity_texture",
}
_COLORS = ("diffuseColor", "specularColor", "emissiveColor", "normal")
# The inputs used only through a texture, with the record's fields, and the values at which they have no effect.
RELIEF = {"normal": ("normal_texture", (0.0, 0.0, 1.0)), "displacement": ("height_texture", 0.0)}
# Maps a normal map's values 0…1 to −1…1.
NORMAL_SCALE, NORMAL_BIAS = (2.0, 2.0, 2.0), (-1.0, -1.0, -1.0)
# By the specification, a texture with wrap modes neither on the prim nor in its file is black outside [0, 1].
WRAP_MODES = {"useMetadata": "black"}

_SMOKE_FIELDS = ("reflection", "gloss", "parallax", "parallax_scale", "parallax_bias")


class MaterialReader:
    """Reads each material of a stage once."""

    def __init__(self, reader: StageReader):
        self._reader = reader
        self._materials: dict[Sdf.Path, Material | None] = {}
        self._coordinates: dict[Sdf.Path, set[str]] = {}  # primvars that a material's textures use
        self._unbound: dict[Sdf.Path, tuple[Material | None, tuple[MaterialSubset, ...]]] = {}

    def look_of(self, prim: Usd.Prim, mesh: Mesh) -> tuple[Material | None, tuple[MaterialSubset, ...]]:
        """Reads the material of a prim, or without one its display colour, and the materials of its face subsets.

        Raises:
            ValueError: one line naming file, prim and attribute.
        """
        material, subsets = self.bound_to(prim), self.bound_to_subsets(prim, mesh)
        if material is not None or _is_bound(prim):
            return material, subsets
        if prim.GetPath() not in self._unbound:
            self._unbound[prim.GetPath()] = read_display_color(self._reader, prim, mesh)
        material, colored = self._unbound[prim.GetPath()]
        if material is None:
            return None, subsets
        bound = (each for each in subsets if _is_bound(prim.GetStage().GetPrimAtPath(each.path)))
        return material, (*bound, *colored)

    def bound_to(self, prim: Usd.Prim) -> Material | None:
        """Reads the material of a prim; None if it has none or, with a warning, one other than a `UsdPreviewSurface`.

        Raises:
            ValueError: one line naming file, prim and attribute.
        """
        binding = UsdShade.MaterialBindingAPI(prim)
        material, _ = binding.ComputeBoundMaterial(UsdShade.Tokens.full)
        if not material:
            for path in binding.GetDirectBindingRel().GetTargets():
                self._reader.warn(prim, f"material:binding names {path}, which is not a material; grey is used")
            return None
        path = material.GetPath()
        if path not in self._materials:
            self._materials[path] = self._read(material)
        self._warn_of_coordinates(prim, path)
        return self._materials[path]

    def _warn_of_coordinates(self, prim: Usd.Prim, material: Sdf.Path) -> None:
        """Warns if textures use coordinates that a mesh has, but not the ones that are read."""
        mesh = prim.GetParent() if prim.IsA(UsdGeom.Subset) else prim
        used, asked = uv_primvar(mesh), self._coordinates.get(material, set())
        for name in sorted(asked - {used.GetPrimvarName()}) if used else ():
            if UsdGeom.PrimvarsAPI(mesh).FindPrimvarWithInheritance(name).HasValue():
                text = f"{material} uses primvars:{name}, which is not supported; {used.GetName()} is used instead"
                self._reader.warn(mesh, text)

    def bound_to_subsets(self, prim: Usd.Prim, mesh: Mesh) -> tuple[MaterialSubset, ...]:
        """Reads the materials of a mesh's face subsets in the family `materialBind`.

        Raises:
            ValueError: one line naming file, prim and attribute.
        """
        if not prim.IsA(UsdGeom.Mesh):
            return ()
        faces = np.arange(len(mesh.triangles)) if mesh.faces is None else mesh.faces
        count, found = len(UsdGeom.Mesh(prim).GetFaceVertexCountsAttr().Get(self._reader.start) or ()), []
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            each = subset.GetPrim()
            if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face:
                self._reader.warn(each, "a materialBind subset of anything but faces is not supported; it is left out")
                continue
            indices = np.asarray(self._reader.still(subset.GetIndicesAttr()) or (), np.int64)
            if len(indices) and not 0 <= indices.min() <= indices.max() < count:
                shown, allowed = f"{indices.min()}…{indices.max()}", f"0…{count - 1}, the faces there are"
                raise self._reader.error(each.GetPath(), "indices", shown, allowed)
            triangles = np.flatnonzero(np.isin(faces, indices))
            found.append(MaterialSubset(path=str(each.GetPath()), triangles=triangles, material=self.bound_to(each)))
        return tuple(found)

    def _read(self, material: UsdShade.Material) -> Material | None:
        surface, _, _ = material.ComputeSurfaceSource()
        if not surface or surface.GetShaderId() != "UsdPreviewSurface":
            text = "only UsdPreviewSurface is supported; grey is used instead"
            self._reader.warn(material.GetPrim(), text)
            return None
        for name, value in WITHOUT_EFFECT.items():
            source = _source(surface, name)
            if source and (_is_output(source) or self._reader.still(source) != value):
                self._reader.warn(surface.GetPrim(), f"inputs:{name} is not supported; it has no effect")

        values = self._read_values(surface)
        textures = {field: self._texture_on(surface, name) for name, field in TEXTURED.items()}
        for name, (field, without) in RELIEF.items():
            textures[field] = self._texture_on(surface, name)
            source = _source(surface, name)
            if source and not _is_output(source) and self._reader.still(source) != without:
                self._reader.warn(
                    surface.GetPrim(), f"inputs:{name} without a texture is not supported; it has no effect"
                )
        self._check_normal_map(surface, textures["normal_texture"])
        self._coordinates[material.GetPath()] = {_coordinates(surface, name) for name in (*TEXTURED, *RELIEF)} - {None}
        smoke = self._read_smoke_fields(material.GetPrim())
        values |= _reflectance(values, textures)
        names = MATERIAL | {field: smoke_attribute(field) for field in smoke}
        with self._reader.naming(surface.GetPath(), names):
            read = Material(
                path=str(material.GetPath()),
                diffuse_color=values["diffuseColor"],
                fresnel_r0=values["specularColor"],
                metallic=values["metallic"],
                roughness=values["roughness"],
                emissive_color=values["emissiveColor"],
                occlusion=values["occlusion"],
                opacity=values["opacity"],
                opacity_threshold=values["opacityThreshold"],
                **textures,
                **smoke,
            )
        warn_of_shadow(self._reader, surface.GetPrim(), "inputs:opacity", read)
        return read

    def _read_smoke_fields(self, prim: Usd.Prim) -> dict[str, object]:
        """Reads the fields that `SmokeMaterialAPI` fills."""
        if "SmokeMaterialAPI" not in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
            return {}
        authored = {}
        for name in schema_attributes()["SmokeMaterialAPI"]:
            attribute = prim.GetAttribute(name)
            if attribute and attribute.HasAuthoredValue():
                authored[name] = self._reader.still(attribute)
        procedural = {field: authored.pop(name) for field, name in PROCEDURAL.items() if name in authored}
        fields = {field: authored[name] for field in _SMOKE_FIELDS if (name := smoke_attribute(field)) in authored}
        if "kind" in procedural:
            with self._reader.naming(prim.GetPath(), PROCEDURAL):
                fields["procedural"] = Procedural(**procedural)
        elif procedural:
            self._reader.warn(
                prim, f"{PROCEDURAL[next(iter(procedural))]} has no effect, since smoke:procedural is unset"
            )
        return fields

    def _check_normal_map(self, surface: UsdShade.Shader, texture: Texture | None) -> None:
        """Warns if a normal map's values are not mapped to directions from −1 to 1, or are marked as sRGB."""
        if texture is None:
            return
        if (texture.scale[:3], texture.bias[:3]) != (NORMAL_SCALE, NORMAL_BIAS):
            found = f"{texture.scale[:3]} and {texture.bias[:3]}"
            text = f"scale and bias of the normal map are {found}; 8-bit directions need (2, 2, 2) and (-1, -1, -1)"
            self._reader.warn(surface.GetPrim(), text)
        if texture.color_space == "sRGB":
            self._reader.warn(surface.GetPrim(), "the normal map is marked as sRGB; directions are stored raw")

    def _read_values(self, surface: UsdShade.Shader) -> dict[str, float | tuple[float, ...]]:
        """Reads the numbers of a `UsdPreviewSurface`."""
        path, values = str(surface.GetPath()), {}
        with self._reader.naming(path, {}):
            for name, fallback in PREVIEW_SURFACE.items():
                check = positive if name == "ior" else finite
                values[name] = check(path, f"inputs:{name}", self._value(surface, name), np.shape(fallback))
        return values

    def _value(self, shader: UsdShade.Shader, name: str) -> object:
        """Reads an input's number; if it is connected to another shader, the input's authored value or its fallback."""
        source = _source(shader, name)
        if source is None:
            return PREVIEW_SURFACE[name]
        if not _is_output(source):
            return self._reader.still(source)
        if name not in TEXTURED:
            text = f"inputs:{name} from {source.GetPrim().GetPath()} is not supported; its default is used"
            self._reader.warn(shader.GetPrim(), text)
        hidden = shader.GetInput(name).GetAttr()
        return self._reader.still(hidden) if hidden.HasAuthoredValue() and name in TEXTURED else PREVIEW_SURFACE[name]

    def _texture_on(self, surface: UsdShade.Shader, name: str) -> Texture | None:
        """Reads the texture that an input comes from; None if there is none or, with a warning, an unusable one."""
        source = _source(surface, name)
        if source is None or not _is_output(source):
            return None
        shader = UsdShade.Shader(source.GetPrim())
        prim = shader.GetPrim()
        if shader.GetShaderId() != "UsdUVTexture":
            text = f"inputs:{name} from {shader.GetShaderId()} is not supported; its default is used"
            self._reader.warn(surface.GetPrim(), text)
            return None
        channel = source.GetBaseName()
        if name in _COLORS and channel != "rgb":
            self._reader.warn(prim, f"{source.GetName()} alone is not supported as a colour; all three are used")
            channel = "rgb"
        fields = {"channel": channel} | self._read_transform(shader)
        file = _source(shader, "file")
        asset = self._reader.still(file) if file else None
        if not asset or not asset.path:
            raise self._reader.error(prim.GetPath(), "inputs:file", "unset", "a picture")
        fields["file"] = asset.resolvedPath or _resolved_tiles(file, asset.path)
        if not fields["file"]:
            raise self._reader.error(prim.GetPath(), "inputs:file", f"@{asset.path}@", "a file that exists")
        for field in ("wrap_s", "wrap_t", "color_space", "scale", "bias"):
            given = _source(shader, TEXTURE[field].removeprefix("inputs:"))
            if given:
                fields[field] = self._reader.still(given)
        for field in ("wrap_s", "wrap_t"):
            mode = fields.get(field, "useMetadata")
            fields[field] = WRAP_MODES.get(mode, mode)
        if UDIM in fields["file"]:  # beyond the tiles there is nothing to repeat
            fields |= {"wrap_s": "clamp", "wrap_t": "clamp"}
        with self._reader.naming(prim.GetPath(), TEXTURE):
            return Texture(**fields)

    def _read_transform(self, texture: UsdShade.Shader) -> dict[str, object]:
        """Reads a texture's `UsdTransform2d`; empty if it has none."""
        coordinates = _source(texture, "st")
        if not coordinates or UsdShade.Shader(coordinates.GetPrim()).GetShaderId() != "UsdTransform2d":
            return {}
        shader = UsdShade.Shader(coordinates.GetPrim())
        before = _source(shader, "in")
        if before and UsdShade.Shader(before.GetPrim()).GetShaderId() == "UsdTransform2d":
            self._reader.warn(
                before.GetPrim(), "a UsdTransform2d before another one is not supported; it has no effect"
            )
        sources = {field: _source(shader, name.removeprefix("inputs:")) for field, name in TRANSFORM_2D.items()}
        fields = {field: self._reader.still(source) for field, source in sources.items() if source}
        with self._reader.naming(shader.GetPath(), TRANSFORM_2D):
            Texture(file="", **fields)  # checked here, where the prim is known
        return fields


def _is_bound(prim: Usd.Prim) -> bool:
    """Returns whether a prim names a material, existing or not, or inherits one."""
    binding = UsdShade.MaterialBindingAPI(prim)
    named = binding.GetDirectBindingRel().GetTargets()
    return bool(named or binding.ComputeBoundMaterial(UsdShade.Tokens.full)[0])


def _reflectance(values: dict[str, object], textures: dict[str, Texture | None]) -> dict[str, object]:
    """Returns reflectance at normal incidence or metalness, as the workflow needs; removes the other's textures."""
    if values["useSpecularWorkflow"]:
        textures["metallic_texture"] = None
        return {"metallic": 0.0}
    textures["specular_texture"] = None
    n = values["ior"]
    return {"specularColor": (shortest_decimal(((n - 1.0) / (n + 1.0)) ** 2),) * 3}


def _resolved_tiles(file: Usd.Attribute, path: str) -> str:
    """The path of a picture in tiles, with `<UDIM>` for their numbers; empty if it is none, or no tile is there."""
    if not UsdShade.UdimUtils.IsUdimIdentifier(path):
        return ""
    layers = (spec.layer for spec in file.GetPropertyStack())
    return next(filter(None, (UsdShade.UdimUtils.ResolveUdimPath(path, layer) for layer in layers)), "")


def _source(shader: UsdShade.Shader, name: str) -> Usd.Attribute | None:
    """Returns the attribute that an input's value comes from: its own, the material's, or another shader's output."""
    given = shader.GetInput(name)
    attributes = given.GetValueProducingAttributes() if given else ()
    return attributes[0] if attributes else None


def _coordinates(surface: UsdShade.Shader, name: str) -> str | None:
    """Returns the primvar that an input's texture takes its coordinates from; None if that is not authored."""
    shader = surface
    for link in (name, "st", "in"):
        source = _source(shader, link)
        if not source or not _is_output(source):
            return None
        shader = UsdShade.Shader(source.GetPrim())
        if shader.GetShaderId() == "UsdPrimvarReader_float2":
            varname = _source(shader, "varname")
            return str(varname.Get()) if varname else None
    return None


def _is_output(attribute: Usd.Attribute) -> bool:
    return UsdShade.Output.IsOutput(attribute)
