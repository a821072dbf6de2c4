"""Scene → USD stage, for scenes built in Python: what is authored reads back as an equal scene.

Equal, that is, as far as USD can hold it: most numbers are stored in single precision; records of one kind come back
in the order of the stage's tree; `Samples` that do not vary come back as plain values; surfaces that are never
visible are no part of the set.
"""

import os
from dataclasses import fields
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdVol, Vt

from warp_smoke.geometry import Mesh, Points
from warp_smoke.material import COLOR_TEXTURES, DATA_TEXTURES
from warp_smoke.record import FieldError, Samples, each_value
from warp_smoke.scene import (
    ArrayCollider,
    ArrayEmitter,
    Camera,
    Collider,
    DistantLight,
    Emitter,
    Light,
    Material,
    Prim,
    Receiver,
    Scene,
    SmokeDomain,
    SpotLight,
    Surface,
    Texture,
)
from warp_smoke.usd.names import CAMERA, LIGHT, MATERIAL, PROCEDURAL, TEXTURE, TRANSFORM_2D, smoke_fields
from warp_smoke.usd.prims import free_path
from warp_smoke.usd.schema import register_schema, schema_attributes

ROOT = "/World"
TEXTURED_INPUTS = {
    **dict.fromkeys(COLOR_TEXTURES, Sdf.ValueTypeNames.Color3f),
    **dict.fromkeys(DATA_TEXTURES, Sdf.ValueTypeNames.Float),
    "normal_texture": Sdf.ValueTypeNames.Normal3f,
}


def author_scene(scene: Scene, path: str | Path) -> None:
    """Writes a scene to a USD file.

    Args:
        scene: what to write.
        path: the file: .usd, .usda or .usdc.

    Raises:
        ValueError: the records cannot stand on one stage, since a path is not USD's, or is given to different
            things, or lies inside another record's.
    """
    _check_paths(scene)
    register_schema()
    stage = Usd.Stage.CreateInMemory()
    stage.SetStartTimeCode(scene.start)
    stage.SetEndTimeCode(scene.end)
    stage.SetTimeCodesPerSecond(scene.time_codes_per_second)
    stage.SetFramesPerSecond(scene.time_codes_per_second)
    UsdGeom.SetStageMetersPerUnit(stage, scene.meters_per_unit)
    stage.SetMetadata(UsdGeom.Tokens.upAxis, scene.up_axis)

    for domain in scene.domains:
        _author_domain(stage, domain)
    for emitter in scene.emitters:
        author_shape = _author_points if isinstance(emitter.mesh, Points) else _author_shape
        _author_smoke_fields(author_shape(stage, emitter), "SmokeEmitterAPI", emitter)
    for collider in scene.colliders:
        _author_smoke_fields(_author_shape(stage, collider), "SmokeColliderAPI", collider)
    for path_of_guide in {r.path for r in (*scene.emitters, *scene.colliders)} - {s.path for s in scene.surfaces}:
        UsdGeom.Imageable(stage.GetPrimAtPath(path_of_guide)).CreatePurposeAttr(UsdGeom.Tokens.guide)
    for material in _materials(scene):
        _author_material(stage, material, Path(path).resolve().parent)
    for surface in scene.surfaces:
        _author_surface(stage, surface)
    for light in scene.lights:
        _author_light(stage, light)
    if scene.camera is not None:
        _author_camera(stage, scene.camera)

    if not stage.GetPseudoRoot().GetChildren():
        stage.DefinePrim(ROOT, "Xform")
    for prim in stage.Traverse():
        if not prim.HasAuthoredTypeName():
            prim.SetTypeName("Xform")
    root = stage.GetPseudoRoot().GetChildren()[0]
    stage.SetDefaultPrim(root)
    if any(scene.ambient):
        dome = UsdLux.DomeLight.Define(stage, free_path(root if root.IsA("Xform") else root.GetParent(), "Ambient"))
        dome.CreateColorAttr(scene.ambient)
        dome.CreateIntensityAttr(1.0)
    stage.GetRootLayer().Export(str(path))


def _check_paths(scene: Scene) -> None:
    """Raises FieldError unless each path is USD's, stands for one thing, and lies inside no other one."""
    for record in (*scene.emitters, *scene.colliders):
        if isinstance(record, ArrayEmitter | ArrayCollider):
            raise FieldError(record.path, "shape", "arrays over cells", "a mesh or points, for a stage can hold them")
    shapes: dict[str, Emitter | Collider | Surface] = {}
    for record in (*scene.emitters, *scene.colliders, *scene.surfaces):
        first = shapes.setdefault(record.path, record)
        place, first_place = (Prim(path=record.path, transform=one.transform) for one in (record, first))
        if record.mesh != first.mesh or place != first_place:
            allowed = "one shape and place for all that it is"
            raise FieldError(record.path, "mesh", "another one for each of its records", allowed)
    paths = [*shapes, *(one.path for one in (*scene.domains, *scene.lights, *_materials(scene)))]
    if scene.camera is not None:
        paths.append(scene.camera.path)
    taken = set()
    for path in paths:
        if not Sdf.Path.IsValidPathString(path) or not Sdf.Path(path).IsPrimPath():
            raise FieldError(path, "path", path, "letters, digits and _ between slashes")
        if path in taken:
            raise FieldError(path, "path", path, "one kind of thing at a path")
        taken.add(path)
    for path in paths:
        for outer in taken.intersection(map(str, Sdf.Path(path).GetPrefixes()[:-1])):
            raise FieldError(path, "path", path, f"a path that is not inside {outer}")


def _materials(scene: Scene) -> list[Material]:
    """The different materials of the scene's surfaces."""
    materials = []
    for surface in scene.surfaces:
        for material in (surface.material, *(each.material for each in surface.subsets)):
            if material is not None and material not in materials:
                materials.append(material)
    return materials


def _set(attribute: Usd.Attribute, value: object) -> None:
    """Sets a value, or all samples of one that changes in time."""
    if isinstance(value, Samples):
        for time, sample in zip(value.times.tolist(), value.values.tolist(), strict=True):
            attribute.Set(tuple(sample) if isinstance(sample, list) else sample, time)
    else:
        attribute.Set(value)


def _author_smoke_fields(prim: Usd.Prim, schema: str, record: Prim | Receiver) -> None:
    """Applies a schema and sets what differs from the record's defaults, or was given."""
    prim.AddAppliedSchema(schema)
    definitions = schema_attributes()[schema]
    defaults = {field.name: field.default for field in fields(record)}
    for field, name in smoke_fields(type(record), definitions).items():
        value = getattr(record, field)
        if value != defaults[field] or field in record.given:
            definition = definitions[name]
            _set(prim.CreateAttribute(name, definition.value_type, False, definition.variability), value)


def _author_transform(prim: Usd.Prim, record: Prim) -> None:
    matrices = each_value(record.transform)
    if np.array_equal(matrices, np.eye(4)[None]):
        return
    operation = UsdGeom.Xformable(prim).AddTransformOp()
    if isinstance(record.transform, Samples):
        for time, matrix in zip(record.transform.times.tolist(), matrices, strict=True):
            operation.Set(Gf.Matrix4d(matrix), time)
    else:
        operation.Set(Gf.Matrix4d(matrices[0]))


def _author_visibility(prim: Usd.Prim, visible: bool | Samples) -> None:
    if visible is True:
        return
    attribute = UsdGeom.Imageable(prim).CreateVisibilityAttr()
    tokens = (UsdGeom.Tokens.invisible, UsdGeom.Tokens.inherited)
    if isinstance(visible, Samples):
        for time, on in zip(visible.times.tolist(), visible.values.tolist(), strict=True):
            attribute.Set(tokens[on], time)
    else:
        attribute.Set(tokens[visible])


def _author_domain(stage: Usd.Stage, domain: SmokeDomain) -> None:
    """A Cube where the domain is one around its origin, else a Volume with its extent."""
    if set(domain.upper) == {domain.upper[0]} and set(domain.lower) == {-domain.upper[0]}:
        cube = UsdGeom.Cube.Define(stage, domain.path)
        cube.CreateSizeAttr(2.0 * domain.upper[0])
        cube.CreateExtentAttr([domain.lower, domain.upper])
        cube.CreatePurposeAttr(UsdGeom.Tokens.guide)
    else:
        UsdVol.Volume.Define(stage, domain.path).CreateExtentAttr([domain.lower, domain.upper])
    prim = stage.GetPrimAtPath(domain.path)
    _author_transform(prim, domain)
    _author_smoke_fields(prim, "SmokeDomainAPI", domain)


def _author_shape(stage: Usd.Stage, record: Emitter | Collider | Surface) -> Usd.Prim:
    """The Mesh prim of a record, unless another record of the same path has made it."""
    prim = stage.GetPrimAtPath(record.path)
    if prim and prim.IsA(UsdGeom.Mesh):
        return prim
    mesh: Mesh = record.mesh
    geom = UsdGeom.Mesh.Define(stage, record.path)
    geom.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    geom.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.triangles), 3, np.int32)))
    geom.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.triangles.ravel()))
    times = mesh.points.times.tolist() if isinstance(mesh.points, Samples) else [Usd.TimeCode.Default()]
    for time, points in zip(times, each_value(mesh.points), strict=True):
        geom.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), time)
        geom.CreateExtentAttr().Set([points.min(axis=0).tolist(), points.max(axis=0).tolist()], time)
    if mesh.normals is not None:
        times = mesh.normals.times.tolist() if isinstance(mesh.normals, Samples) else [Usd.TimeCode.Default()]
        for time, normals in zip(times, each_value(mesh.normals), strict=True):
            geom.CreateNormalsAttr().Set(Vt.Vec3fArray.FromNumpy(normals.reshape(-1, 3)), time)
        geom.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
    if mesh.uvs is not None:
        values, indices = np.unique(mesh.uvs.reshape(-1, 2), axis=0, return_inverse=True)
        texture_coordinates = Sdf.ValueTypeNames.TexCoord2fArray
        st = UsdGeom.PrimvarsAPI(geom).CreatePrimvar("st", texture_coordinates, UsdGeom.Tokens.faceVarying)
        st.Set(Vt.Vec2fArray.FromNumpy(values))
        st.SetIndices(Vt.IntArray.FromNumpy(indices.ravel().astype(np.int32)))
    _author_transform(geom.GetPrim(), record)
    return geom.GetPrim()


def _author_points(stage: Usd.Stage, emitter: Emitter) -> Usd.Prim:
    """The Points prim of an emitter."""
    geom = UsdGeom.Points.Define(stage, emitter.path)
    points, widths = emitter.mesh.points, emitter.mesh.widths
    for attribute, value in ((geom.CreatePointsAttr(), points), (geom.CreateWidthsAttr(), widths)):
        times = value.times.tolist() if isinstance(value, Samples) else [Usd.TimeCode.Default()]
        for time, one in zip(times, each_value(value), strict=True):
            attribute.Set(Vt.Vec3fArray.FromNumpy(one) if one.ndim == 2 else Vt.FloatArray.FromNumpy(one), time)
    every, radius = each_value(points).reshape(-1, 3), each_value(widths).max(initial=0.0) / 2.0
    if len(every):
        geom.CreateExtentAttr([(every.min(axis=0) - radius).tolist(), (every.max(axis=0) + radius).tolist()])
    _author_transform(geom.GetPrim(), emitter)
    return geom.GetPrim()


def _author_surface(stage: Usd.Stage, surface: Surface) -> None:
    prim = _author_shape(stage, surface)
    _author_visibility(prim, surface.visible)
    if surface.receiver is not None:
        _author_smoke_fields(prim, "SmokeReceiverAPI", surface.receiver)
    _bind(prim, surface.material)
    for each in surface.subsets:
        if Sdf.Path(each.path).GetParentPath() != prim.GetPath():
            raise FieldError(each.path, "path", each.path, f"a path right below {surface.path}, whose faces it holds")
        subset = UsdGeom.Subset.Define(stage, each.path)
        subset.CreateElementTypeAttr(UsdGeom.Tokens.face)
        subset.CreateFamilyNameAttr(UsdShade.Tokens.materialBind)
        subset.CreateIndicesAttr(Vt.IntArray.FromNumpy(each.triangles))
        _bind(subset.GetPrim(), each.material)
    if surface.subsets:
        family = UsdGeom.Tokens.nonOverlapping
        UsdShade.MaterialBindingAPI(prim).SetMaterialBindSubsetsFamilyType(family)


def _bind(prim: Usd.Prim, material: Material | None) -> None:
    if material is not None:
        bound = UsdShade.Material.Get(prim.GetStage(), material.path)
        UsdShade.MaterialBindingAPI.Apply(prim).Bind(bound)


def _author_material(stage: Usd.Stage, material: Material, folder: Path) -> None:
    """A `UsdPreviewSurface`: in its specular workflow, which takes the reflectance as it is, unless it holds metal."""
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
    """The n of r₀ = ((n − 1)/(n + 1))²: the workflow with metal has no other reflectance."""
    r0 = material.fresnel_r0
    if r0 != (r0[0],) * 3 or r0[0] >= 1.0 or material.specular_texture is not None:
        raise FieldError(material.path, "fresnel_r0", r0, "grey, below 1 and without a texture, where there is metal")
    return (1.0 + r0[0] ** 0.5) / (1.0 - r0[0] ** 0.5)


def _author_material_fields(prim: Usd.Prim, material: Material) -> None:
    """What `SmokeMaterialAPI` holds, if any of it differs from the defaults."""
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


def _author_light(stage: Usd.Stage, light: Light) -> None:
    if isinstance(light, DistantLight):
        prim = UsdLux.DistantLight.Define(stage, light.path).GetPrim()
        names = ["color", "intensity", "normalize", "angle"]
    else:
        prim = UsdLux.SphereLight.Define(stage, light.path).GetPrim()
        prim.GetAttribute("extent").Set([(-light.radius,) * 3, (light.radius,) * 3])
        names = ["color", "intensity", "normalize", "radius"]
    if isinstance(light, SpotLight):
        UsdLux.ShapingAPI.Apply(prim)
        names += ["cone_angle", "cone_softness", "focus"]
    for name in names:
        _set(prim.GetAttribute(LIGHT[name]), getattr(light, name))
    if not light.shadow_enable:
        UsdLux.ShadowAPI.Apply(prim).CreateShadowEnableAttr(False)
    api = UsdLux.LightAPI(prim)
    _author_members(api.GetLightLinkCollectionAPI(), light.illuminates)
    _author_members(api.GetShadowLinkCollectionAPI(), light.shadowed_by)
    _author_visibility(prim, light.enabled)
    _author_transform(prim, light)
    _author_smoke_fields(prim, "SmokeLightAPI", light)


def _author_members(collection: Usd.CollectionAPI, paths: tuple[str, ...] | None) -> None:
    """Makes a light's collection hold these prims alone; None leaves it as it is, with everything in it."""
    if paths is not None:
        collection.CreateIncludeRootAttr(False)
        collection.CreateIncludesRel().SetTargets([Sdf.Path(path) for path in paths])


def _author_camera(stage: Usd.Stage, camera: Camera) -> None:
    prim = UsdGeom.Camera.Define(stage, camera.path).GetPrim()
    for field, name in CAMERA.items():
        prim.GetAttribute(name).Set(getattr(camera, field))
    prim.GetAttribute("clippingRange").Set((camera.near, camera.far))
    _author_transform(prim, camera)
