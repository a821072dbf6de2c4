"""Authoring of materials as `UsdPreviewSurface`, and as `SmokeMaterialAPI` for what that cannot express."""

import os
from dataclasses import fields
from pathlib import Path

from pxr import Sdf, Usd, UsdShade

from warp_smoke.material import COLOR_TEXTURES, DATA_TEXTURES
from warp_smoke.record import FieldError
from warp_smoke.scene import Material, Texture
from warp_smoke.usd.names import MATERIAL, PROCEDURAL, TEXTURE, TRANSFORM_2D, smoke_fields
from warp_smoke.usd.schema import schema_attributes

TEXTURED_INPUTS = {
    **dict.fromkeys(COLOR_TEXTURES, Sdf.ValueTypeNames.Color3f),
    **dict.fromkeys(DATA_TEXTURES, Sdf.ValueTypeNames.Float),
    "normal_texture": Sdf.ValueTypeNames.Normal3f,
}


def author_material(stage: Usd.Stage, material: Material, folder: Path) -> None:
    """Authors a `UsdPreviewSurface`: in the specular workflow, which stores the reflectance, unless there is metal."""
    prim = UsdShade.Material.Define(stage, material.path)
    surface = UsdShade.Shader.Define(stage, f"{material.path}/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    prim.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    metal = material.metallic > 0.0 or material.metallic_texture is not None
    surface.CreateInput("useSpecularWorkflow", Sdf.ValueTypeNames.Int).Set(not metal)
    color, number = Sdf.ValueTypeNames.Color3f, Sdf.ValueTypeNames.Float
    plain = {"emissive_color": color, "roughness": number}
    if metal:
        plain["metallic"] = number
        surface.CreateInput("ior", number).Set(_index_of_refraction(material))
    else:
        plain["fresnel_r0"] = color
    plain |= {
        field: number
        for field, default in (("occlusion", 1.0), ("opacity", 1.0), ("opacity_threshold", 0.0))
        if getattr(material, field) != default
    }
    for field, kind in plain.items():
        surface.CreateInput(MATERIAL[field].removeprefix("inputs:"), kind).Set(getattr(material, field))
    surface.CreateInput("diffuseColor", color).Set(material.diffuse_color)
    for field, kind in TEXTURED_INPUTS.items():
        texture = getattr(material, field)
        if texture is not None:
            shader = _author_texture(stage, material, field, texture, folder)
            given = surface.CreateInput(MATERIAL[field].removeprefix("inputs:"), kind)
            given.ConnectToSource(shader.ConnectableAPI(), texture.channel)
    _author_material_fields(prim.GetPrim(), material)


def _index_of_refraction(material: Material) -> float:
    """Returns n with r₀ = ((n − 1)/(n + 1))²; the metallic workflow cannot express any other reflectance."""
    r0 = material.fresnel_r0
    if r0 != (r0[0],) * 3 or r0[0] >= 1.0 or material.specular_texture is not None:
        raise FieldError(material.path, "fresnel_r0", r0, "grey, below 1 and without a texture, where there is metal")
    return (1.0 + r0[0] ** 0.5) / (1.0 - r0[0] ** 0.5)


def _author_material_fields(prim: Usd.Prim, material: Material) -> None:
    """Authors `SmokeMaterialAPI` if any of its fields differs from the default."""
    definitions = schema_attributes()["SmokeMaterialAPI"]
    authored = {}
    defaults = {field.name: field.default for field in fields(Material)}
    for field, name in smoke_fields(Material, definitions).items():
        if field != "procedural" and getattr(material, field) != defaults[field]:
            authored[name] = getattr(material, field)
    if material.procedural is not None:
        authored |= {name: getattr(material.procedural, field) for field, name in PROCEDURAL.items()}
    if authored:
        prim.AddAppliedSchema("SmokeMaterialAPI")
    for name, value in authored.items():
        prim.CreateAttribute(name, definitions[name].value_type, False, definitions[name].variability).Set(value)


def _author_texture(
    stage: Usd.Stage, material: Material, field: str, texture: Texture, folder: Path
) -> UsdShade.Shader:
    reader = UsdShade.Shader.Define(stage, f"{material.path}/TextureCoordinates")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    name = "".join(word.capitalize() for word in field.split("_"))
    coordinates = reader
    if (texture.uv_scale, texture.uv_rotation, texture.uv_translation) != ((1.0, 1.0), 0.0, (0.0, 0.0)):
        coordinates = UsdShade.Shader.Define(stage, f"{material.path}/{name}Coordinates")
        coordinates.CreateIdAttr("UsdTransform2d")
        pair, number = Sdf.ValueTypeNames.Float2, Sdf.ValueTypeNames.Float
        coordinates.CreateInput("in", pair).ConnectToSource(reader.ConnectableAPI(), "result")
        for part, attribute in TRANSFORM_2D.items():
            kind = number if part == "uv_rotation" else pair
            coordinates.CreateInput(attribute.removeprefix("inputs:"), kind).Set(getattr(texture, part))
    shader = UsdShade.Shader.Define(stage, f"{material.path}/{name}")
    shader.CreateIdAttr("UsdUVTexture")
    given = shader.CreateInput("st", Sdf.ValueTypeNames.Float2)
    given.ConnectToSource(coordinates.ConnectableAPI(), "result")
    file = Path(os.path.relpath(texture.file, folder)).as_posix()
    values = {"file": Sdf.AssetPath(file if file.startswith("../") else f"./{file}")}
    kinds = {"file": Sdf.ValueTypeNames.Asset, "scale": Sdf.ValueTypeNames.Float4, "bias": Sdf.ValueTypeNames.Float4}
    for part, attribute in TEXTURE.items():
        given = shader.CreateInput(attribute.removeprefix("inputs:"), kinds.get(part, Sdf.ValueTypeNames.Token))
        given.Set(values.get(part, getattr(texture, part)))
    output = Sdf.ValueTypeNames.Float3 if texture.channel == "rgb" else Sdf.ValueTypeNames.Float
    shader.CreateOutput(texture.channel, output)
    return shader
