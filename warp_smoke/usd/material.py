"""Materials that show baked lighting, and a variant set that switches between them and the user's own materials.

Each receiver of a `lit` bake gets a `UsdPreviewSurface` that only emits the picture: it is the final look, so the DCC's
lights must not add to it. A collection binding inside the variant `baked` of the variant set `smokeLook`, on the root
prim, binds it; the variant `dcc` is empty and shows the stage as the user made it. The binding sits on an ancestor and
is stronger than descendants, because a direct binding in a variant would be weaker than the user's own.

The file of every picture is also an attribute of its receiver, `asset smokeBaked:<bake>`, for scripts and shader
networks. Pictures use the mesh's own texture coordinates or, if these leave [0, 1], `primvars:st_bake`, computed from
them. A mesh without UVs carries primvars instead: `smokeLit`, `smokeVisibility`, `smokeShadow` and so on. Shadow maps,
which need no coordinates, become `smokeBaked:depth:<light>` on each receiver of a `depth` bake.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from warp_smoke.record import FieldError, Record, one_of
from warp_smoke.scene import SURFACE_BAKES, Surface
from warp_smoke.usd.prims import check_frames, editable, free_path, set_over_time, uv_primvar
from warp_smoke.uv_fit import BAKE_UVS, UvFit

VARIANT_SET = "smokeLook"
BAKED_LOOK, OWN_LOOK = "baked", "dcc"
BAKED_NAMESPACE = "smokeBaked"
_COLORS, _NORMALS, _NUMBERS = (
    Sdf.ValueTypeNames.Color3fArray,
    Sdf.ValueTypeNames.Normal3fArray,
    Sdf.ValueTypeNames.FloatArray,
)
VERTEX_PRIMVARS = {
    "lit": ("smokeLit", _COLORS),
    "irradiance": ("smokeIrradiance", _COLORS),
    "visibility": ("smokeVisibility", _NUMBERS),
    "smokeShadow": ("smokeShadow", _NUMBERS),
    "normal": ("smokeNormal", _NORMALS),
}
_PURPOSES = (UsdShade.Tokens.allPurpose, UsdShade.Tokens.preview, UsdShade.Tokens.full)


@dataclass(frozen=True, eq=False, kw_only=True)
class BakeResult(Record):
    """The pictures of one bake of a mesh with UVs.

    Attributes:
        surface: the receiver.
        bake: lit (sRGB), or irradiance, visibility, smokeShadow or normal (raw).
        files: path of the picture relative to the results layer (`./textures/…`), or one for each frame if it changes.
    """

    surface: Surface
    bake: str
    files: Mapping[int, str] | str

    def __post_init__(self):
        one_of(self.surface.path, "bake", self.bake, SURFACE_BAKES)
        check_frames(self.surface.path, "files", self.files)


@dataclass(frozen=True, eq=False, kw_only=True)
class VertexBakeResult(Record):
    """One bake at the points of a mesh without UVs.

    Attributes:
        surface: the receiver.
        bake: one of `scene.SURFACE_BAKES`.
        values: at each point, linear RGB [n, 3] for lit and irradiance, directions [n, 3] for normal, else fractions of
            light [n]; one array, or one for each frame if they change.
    """

    surface: Surface
    bake: str
    values: Mapping[int, np.ndarray] | np.ndarray

    def __post_init__(self):
        one_of(self.surface.path, "bake", self.bake, SURFACE_BAKES)
        check_frames(self.surface.path, "values", self.values)
        count = len(self.surface.mesh.points_at(0.0))
        shape = (count,) if VERTEX_PRIMVARS[self.bake][1] == _NUMBERS else (count, 3)
        for values in self.values.values() if isinstance(self.values, Mapping) else [self.values]:
            if values.shape != shape:
                raise FieldError(self.surface.path, "values", f"of shape {values.shape}", f"{shape} for {self.bake}")


@dataclass(frozen=True, eq=False, kw_only=True)
class DepthMapResult(Record):
    """The pictures of a light's shadow map.

    Attributes:
        surface: a receiver that bakes `depth`, lit by the light.
        light: the light's name, unique among those of the scene.
        files: as in `BakeResult`.
    """

    surface: Surface
    light: str
    files: Mapping[int, str] | str

    def __post_init__(self):
        check_frames(self.surface.path, "files", self.files)


def define_bakes(stage: Usd.Stage, bakes: Iterable[BakeResult | VertexBakeResult | DepthMapResult]) -> None:
    """Authors the bakes, and the materials that show them, in the stage's edit target."""
    for bake in bakes:
        receiver = editable(stage, bake.surface.path)
        if isinstance(bake, VertexBakeResult):
            _define_primvar(receiver, bake)
        elif isinstance(bake, DepthMapResult):
            _name_files(receiver, f"depth:{bake.light}", bake.files)
        else:
            _define_pictures(receiver, bake)


def define_procedural(stage: Usd.Stage, path: str, file: str) -> None:
    """Makes a procedural picture the diffuse colour of the material at a path, with the texture coordinates `st`."""
    material = UsdShade.Material(stage.GetPrimAtPath(path))
    surface, _, _ = material.ComputeSurfaceSource()
    uv = define_shader(material, "proceduralCoordinates", "UsdPrimvarReader_float2")
    uv.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    picture = define_shader(material, "procedural", "UsdUVTexture")
    picture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(file)
    _show(picture, uv, "sRGB", "repeat")
    diffuse = surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    diffuse.ConnectToSource(picture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))


def _show(picture: UsdShade.Shader, uv: UsdShade.Shader, color_space: str, wrap: str) -> None:
    """Connects a picture to its texture coordinates."""
    picture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set(color_space)
    for name in ("wrapS", "wrapT"):
        picture.CreateInput(name, Sdf.ValueTypeNames.Token).Set(wrap)
    result = uv.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    picture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(result)


def _name_files(receiver: Usd.Prim, name: str, files: Mapping[int, str] | str) -> None:
    """Writes the pictures' paths to an attribute of their receiver."""
    set_over_time(receiver.CreateAttribute(f"{BAKED_NAMESPACE}:{name}", Sdf.ValueTypeNames.Asset, True), files)


def _define_pictures(receiver: Usd.Prim, bake: BakeResult) -> None:
    name = _define_uvs(receiver, bake.surface.bake_fit)
    _name_files(receiver, bake.bake, bake.files)
    if bake.bake != "lit":
        return
    material = _define_emitter(receiver)
    uv = define_shader(material, "st", "UsdPrimvarReader_float2")
    uv.CreateInput("varname", Sdf.ValueTypeNames.String).Set(name)
    picture = define_shader(material, "lit", "UsdUVTexture")
    set_over_time(picture.CreateInput("file", Sdf.ValueTypeNames.Asset).GetAttr(), bake.files)
    _show(picture, uv, "sRGB", "clamp")
    _emit(material, picture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
    _keep_opacity(material, picture, bake.surface)
    _bind(receiver, material)


def _keep_opacity(material: UsdShade.Material, picture: UsdShade.Shader, receiver: Surface) -> None:
    """Connects opacity to the picture's alpha, which holds it if any of the receiver's own materials is see-through."""
    thresholds = [each.opacity_threshold for each in receiver.materials if each.is_see_through]
    if not thresholds:
        return
    surface, _, _ = material.ComputeSurfaceSource()
    alpha = picture.CreateOutput("a", Sdf.ValueTypeNames.Float)
    surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(alpha)
    if all(thresholds):
        surface.CreateInput("opacityThreshold", Sdf.ValueTypeNames.Float).Set(0.5)  # holes are 0 in the picture


def _define_primvar(receiver: Usd.Prim, bake: VertexBakeResult) -> None:
    name, value_type = VERTEX_PRIMVARS[bake.bake]
    primvar = UsdGeom.PrimvarsAPI(receiver).CreatePrimvar(name, value_type, UsdGeom.Tokens.vertex)
    set_over_time(primvar.GetAttr(), bake.values)
    if bake.bake != "lit":
        return
    material = _define_emitter(receiver)
    reader = define_shader(material, "lit", "UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set(name)
    _emit(material, reader.CreateOutput("result", Sdf.ValueTypeNames.Float3))
    _bind(receiver, material)


def _define_uvs(mesh: Usd.Prim, fit: UvFit | None) -> str:
    """Returns the name of the pictures' texture coordinates: the mesh's own, or `st_bake`, authored here from them."""
    primvar = uv_primvar(mesh)
    if primvar is None:
        raise ValueError(f"{mesh.GetPath()}: has baked pictures but no texture coordinates to show them with")
    if fit is None:
        return primvar.GetPrimvarName()
    kind = Sdf.ValueTypeNames.TexCoord2fArray
    fitted = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(BAKE_UVS, kind, primvar.GetInterpolation())
    fitted.Set(Vt.Vec2fArray.FromNumpy(fit(primvar.Get())))
    if primvar.IsIndexed():
        fitted.SetIndices(primvar.GetIndices())
    return BAKE_UVS


def define_material(prim: Usd.Prim, name: str) -> UsdShade.Material:
    """Defines a new material in the scope `Looks` under the root prim above a prim."""
    stage = prim.GetStage()
    looks = stage.GetPrimAtPath(_root(prim).GetPath().AppendChild("Looks"))
    if not looks:
        looks = UsdGeom.Scope.Define(stage, _root(prim).GetPath().AppendChild("Looks")).GetPrim()
    return UsdShade.Material.Define(stage, free_path(looks, name))


def _define_emitter(receiver: Usd.Prim) -> UsdShade.Material:
    """Defines a new material `<Receiver>_baked`, with a surface that reflects nothing."""
    material = define_material(receiver, f"{receiver.GetName()}_baked")
    surface = define_shader(material, "Surface", "UsdPreviewSurface")
    black = Gf.Vec3f(0.0)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(black)
    surface.CreateInput("useSpecularWorkflow", Sdf.ValueTypeNames.Int).Set(1)
    surface.CreateInput("specularColor", Sdf.ValueTypeNames.Color3f).Set(black)
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    # Blender takes reflection from this, not from the specular colour.
    surface.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(1.0)
    material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return material


def _emit(material: UsdShade.Material, color: UsdShade.Output) -> None:
    surface, _, _ = material.ComputeSurfaceSource()
    surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(color)


def define_shader(material: UsdShade.Material, name: str, identifier: str) -> UsdShade.Shader:
    """Defines a shader inside a material; the identifier names its node type."""
    shader = UsdShade.Shader.Define(material.GetPrim().GetStage(), material.GetPath().AppendChild(name))
    shader.CreateIdAttr(identifier)
    return shader


def _bind(receiver: Usd.Prim, material: UsdShade.Material) -> None:
    """Binds a material in the variant `baked`, for each purpose in which the user's own would still show."""
    root = _root(receiver)
    variants = root.GetVariantSets().AddVariantSet(VARIANT_SET)
    for variant in (OWN_LOOK, BAKED_LOOK):
        variants.AddVariant(variant)
        variants.SetVariantSelection(variant)
    name = material.GetPrim().GetName()
    api = UsdShade.MaterialBindingAPI.Apply(root)
    collection = Usd.CollectionAPI.Apply(root, name)
    collection.IncludePath(receiver.GetPath())
    subsets = UsdShade.MaterialBindingAPI(receiver).GetMaterialBindSubsets()
    parts = [receiver, *(subset.GetPrim() for subset in subsets)]
    with variants.GetVariantEditContext():
        for purpose in _PURPOSES:
            bound, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(parts, purpose)
            if any(each.GetPath() != material.GetPath() for each in bound):
                api.Bind(collection, material, name, UsdShade.Tokens.strongerThanDescendants, purpose)


def _root(prim: Usd.Prim) -> Usd.Prim:
    """Returns the root prim above (or at) a prim; usually the stage's default prim."""
    return prim.GetStage().GetPrimAtPath(prim.GetPath().GetPrefixes()[0])
