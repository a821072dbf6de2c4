"""Smoke materials for one renderer each, since there is no portable volume shader.

Each dims light by the domain's extinction and scatters it by the albedo, both from the density grid alone. The layer
`NAME.<renderer>.usda` holds the materials and is the root layer's strongest sublayer. Karma: `kma_volume` with
MaterialX nodes that read the grid. Arnold: `standard_volume`. Omniverse RTX does not draw a `UsdVol.Volume`, so it gets
a box with `OmniVolumeDensity`, whose local space is the grid's.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdVol, Vt

from warp_smoke.record import one_of
from warp_smoke.scene import Scene, SmokeDomain
from warp_smoke.usd.material import define_material, define_shader
from warp_smoke.usd.prims import free_path, set_over_time
from warp_smoke.usd.quiet import usd_kept_quiet
from warp_smoke.usd.volume import DOMAIN_RELATIONSHIP, GRID_NAMES
from warp_smoke.usd.write import replacing_layer, set_metadata

_COLOR, _NUMBER, _STRING = Sdf.ValueTypeNames.Color3f, Sdf.ValueTypeNames.Float, Sdf.ValueTypeNames.String
_BOX_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_BOX_NORMALS = ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1))


@usd_kept_quiet()
def write_volume_shader(root: Path, scene: Scene, renderer: str) -> Path:
    """Writes materials for all the smoke in a run's results into a separate layer, and adds it to the root layer.

    Args:
        root: the root layer of the results.
        scene: the scene that was run.
        renderer: one of `VOLUME_SHADERS`.

    Returns:
        The layer's path.

    Raises:
        ValueError: the renderer is not one of these.
        OSError: a layer cannot be written.
    """
    define = VOLUME_SHADERS[one_of("run", "volume shader", renderer, tuple(VOLUME_SHADERS))]
    path = root.with_name(f"{root.stem}.{renderer}.usda")
    layer = Sdf.Layer.FindOrOpen(str(root))
    below = [each for each in layer.subLayerPaths if each != f"./{path.name}"]
    layer.subLayerPaths = below
    over = Sdf.Layer.CreateAnonymous(".usda")
    set_metadata(over, layer, scene)
    stage = Usd.Stage.Open(layer, over)
    stage.SetEditTarget(over)
    domains = {domain.path: domain for domain in scene.domains}
    for prim in list(stage.Traverse()):
        targets = prim.GetRelationship(DOMAIN_RELATIONSHIP).GetTargets() if prim.IsA(UsdVol.Volume) else []
        if targets and "density" in UsdVol.Volume(prim).GetFieldPaths():
            define(UsdVol.Volume(prim), domains[str(targets[0])], scene.meters_per_unit)
    with replacing_layer(path) as partial:
        over.Export(str(partial))
    layer.subLayerPaths = [f"./{path.name}", *below]
    with replacing_layer(root) as partial:
        layer.Export(str(partial))
    return path


def _coefficients(domain: SmokeDomain, meters_per_unit: float) -> np.ndarray:
    """Returns the extinction coefficients of red, green and blue at density 1 in the file [1/stage unit]."""
    return np.multiply(domain.extinction_color, domain.extinction / domain.density_scale * meters_per_unit)


def _define_karma(volume: UsdVol.Volume, domain: SmokeDomain, meters_per_unit: float) -> None:
    """Defines σ_s = albedo · σ · density and σ_a = (1 − albedo) · σ · density."""
    prim = volume.GetPrim()
    material = define_material(prim, f"{prim.GetName()}_karma")
    grid = define_shader(material, "density", "ND_geompropvalue_float")
    grid.CreateInput("geomprop", _STRING).Set(GRID_NAMES["density"])
    density = grid.CreateOutput("out", _NUMBER)
    smoke = define_shader(material, "Smoke", "kma_volume")
    taken, albedo = _coefficients(domain, meters_per_unit), np.array(domain.albedo)
    for name, factor in (("scattering", taken * albedo), ("absorption", taken * (1 - albedo))):
        product = define_shader(material, name, "ND_multiply_color3FA")
        product.CreateInput("in1", _COLOR).Set(Gf.Vec3f(*factor.tolist()))
        product.CreateInput("in2", _NUMBER).ConnectToSource(density)
        smoke.CreateInput(name, _COLOR).ConnectToSource(product.CreateOutput("out", _COLOR))
    material.CreateVolumeOutput("kma").ConnectToSource(smoke.CreateOutput("out", Sdf.ValueTypeNames.Token))
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def _define_arnold(volume: UsdVol.Volume, domain: SmokeDomain, meters_per_unit: float) -> None:
    """Defines one density for all colours, their mean, since `standard_volume` has no other."""
    prim = volume.GetPrim()
    material = define_material(prim, f"{prim.GetName()}_arnold")
    smoke = define_shader(material, "Smoke", "arnold:standard_volume")
    smoke.CreateInput("density", _NUMBER).Set(float(_coefficients(domain, meters_per_unit).mean()))
    smoke.CreateInput("density_channel", _STRING).Set(GRID_NAMES["density"])
    smoke.CreateInput("scatter", _NUMBER).Set(1.0)
    smoke.CreateInput("scatter_color", _COLOR).Set(Gf.Vec3f(domain.albedo))
    smoke.CreateInput("emission_mode", _STRING).Set("none")
    material.CreateVolumeOutput("arnold").ConnectToSource(smoke.CreateOutput("out", Sdf.ValueTypeNames.Token))
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def _define_omniverse(volume: UsdVol.Volume, domain: SmokeDomain, meters_per_unit: float) -> None:
    """Defines a box around the grid, in the grid's local space, whose material reads the files itself."""
    prim = volume.GetPrim()
    stage = prim.GetStage()
    material = define_material(prim, f"{prim.GetName()}_omniverse")
    smoke = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Smoke"))
    smoke.SetSourceAsset(Sdf.AssetPath("OmniVolumeDensity.mdl"), "mdl")
    smoke.SetSourceAssetSubIdentifier("OmniVolumeDensity", "mdl")
    file = UsdVol.OpenVDBAsset.Get(stage, volume.GetFieldPath("density")).GetFilePathAttr()
    files = {int(time): file.Get(time).path for time in file.GetTimeSamples()}
    set_over_time(smoke.CreateInput("volume_density_texture", Sdf.ValueTypeNames.Asset).GetAttr(), files)
    smoke.CreateInput("volume_density_scale", _NUMBER).Set(float(_coefficients(domain, meters_per_unit).mean()))
    smoke.CreateInput("volume_albedo", _COLOR).Set(Gf.Vec3f(domain.albedo))
    material.CreateVolumeOutput("mdl").ConnectToSource(smoke.CreateOutput("out", Sdf.ValueTypeNames.Token))

    extent = volume.GetExtentAttr().Get()
    (x0, y0, z0), (x1, y1, z1) = extent
    box = UsdGeom.Mesh.Define(stage, free_path(prim.GetParent(), f"{prim.GetName()}_omniverse"))
    box.CreatePointsAttr(Vt.Vec3fArray([Gf.Vec3f(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]))
    box.CreateFaceVertexCountsAttr([4] * 6)
    box.CreateFaceVertexIndicesAttr([corner for face in _BOX_FACES for corner in face])
    box.CreateNormalsAttr(Vt.Vec3fArray([Gf.Vec3f(normal) for normal in _BOX_NORMALS]))
    box.SetNormalsInterpolation(UsdGeom.Tokens.uniform)
    box.CreateExtentAttr(extent)
    box.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    operations = UsdGeom.Xformable(prim).GetOrderedXformOps()
    for operation in operations:
        own = box.GetPrim().CreateAttribute(operation.GetName(), operation.GetAttr().GetTypeName(), False)
        own.Set(operation.Get())
    box.SetXformOpOrder([UsdGeom.XformOp(box.GetPrim().GetAttribute(each.GetName())) for each in operations])
    UsdGeom.PrimvarsAPI(box).CreatePrimvar("isVolume", Sdf.ValueTypeNames.Bool).Set(True)
    UsdShade.MaterialBindingAPI.Apply(box.GetPrim()).Bind(material)


VOLUME_SHADERS: dict[str, Callable[[UsdVol.Volume, SmokeDomain, float], None]] = {
    "karma": _define_karma,
    "arnold": _define_arnold,
    "omniverse": _define_omniverse,
}
