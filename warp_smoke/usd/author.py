"""Scene → USD stage, for scenes built in Python: the stage reads back as an equal scene, within the limits of USD.

Most numbers are stored in single precision; records of the same kind come back in the order of the stage's tree;
`Samples` that do not vary come back as plain values; surfaces that are never visible do not come back.
"""

from pathlib import Path

from pxr import Sdf, Usd, UsdGeom, UsdLux, UsdVol

from warp_smoke.geometry import Points
from warp_smoke.record import FieldError
from warp_smoke.scene import (
    ArrayCollider,
    ArrayEmitter,
    Camera,
    Collider,
    Emitter,
    Material,
    Prim,
    Scene,
    SmokeDomain,
    Surface,
)
from warp_smoke.usd.author_light import author_light
from warp_smoke.usd.author_material import author_material
from warp_smoke.usd.author_mesh import author_points, author_shape, author_surface
from warp_smoke.usd.author_prim import author_smoke_fields, author_transform, set_value
from warp_smoke.usd.names import CAMERA
from warp_smoke.usd.prims import free_path
from warp_smoke.usd.schema import register_schema

ROOT = "/World"


def author_scene(scene: Scene, path: str | Path) -> None:
    """Writes a scene to a USD file.

    Args:
        scene: the scene to write.
        path: a .usd, .usda or .usdc file.

    Raises:
        ValueError: the records do not fit on one stage: a path is not valid in USD, is shared by different things, or
            lies inside another record's path.
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
        author_emitter = author_points if isinstance(emitter.mesh, Points) else author_shape
        author_smoke_fields(author_emitter(stage, emitter), "SmokeEmitterAPI", emitter)
    for collider in scene.colliders:
        author_smoke_fields(author_shape(stage, collider), "SmokeColliderAPI", collider)
    for path_of_guide in {r.path for r in (*scene.emitters, *scene.colliders)} - {s.path for s in scene.surfaces}:
        UsdGeom.Imageable(stage.GetPrimAtPath(path_of_guide)).CreatePurposeAttr(UsdGeom.Tokens.guide)
    for material in _materials(scene):
        author_material(stage, material, Path(path).resolve().parent)
    for surface in scene.surfaces:
        author_surface(stage, surface)
    for light in scene.lights:
        author_light(stage, light)
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
    """Raises FieldError unless each path is valid in USD, stands for one thing, and lies inside no other path."""
    for record in (*scene.emitters, *scene.colliders):
        if isinstance(record, ArrayEmitter | ArrayCollider):
            raise FieldError(record.path, "shape", "arrays over cells", "a mesh or points, which a stage can hold")
    shapes: dict[str, Emitter | Collider | Surface] = {}
    for record in (*scene.emitters, *scene.colliders, *scene.surfaces):
        first = shapes.setdefault(record.path, record)
        place, first_place = (Prim(path=record.path, transform=one.transform) for one in (record, first))
        if record.mesh != first.mesh or place != first_place:
            allowed = "the same shape and place for all of them"
            raise FieldError(record.path, "mesh", "different among the records with this path", allowed)
    paths = [*shapes, *(one.path for one in (*scene.domains, *scene.lights, *_materials(scene)))]
    if scene.camera is not None:
        paths.append(scene.camera.path)
    taken = set()
    for path in paths:
        if not Sdf.Path.IsValidPathString(path) or not Sdf.Path(path).IsPrimPath():
            raise FieldError(path, "path", path, "letters, digits and _ between slashes")
        if path in taken:
            raise FieldError(path, "path", path, "one kind of thing at each path")
        taken.add(path)
    for path in paths:
        for outer in taken.intersection(map(str, Sdf.Path(path).GetPrefixes()[:-1])):
            raise FieldError(path, "path", path, f"a path that is not inside {outer}")


def _materials(scene: Scene) -> list[Material]:
    """Returns the distinct materials of the scene's surfaces."""
    materials = []
    for surface in scene.surfaces:
        for material in (surface.material, *(each.material for each in surface.subsets)):
            if material is not None and material not in materials:
                materials.append(material)
    return materials


def _author_domain(stage: Usd.Stage, domain: SmokeDomain) -> None:
    """Authors a Cube if the domain is a cube around its origin, else a Volume with an extent."""
    if set(domain.upper) == {domain.upper[0]} and set(domain.lower) == {-domain.upper[0]}:
        cube = UsdGeom.Cube.Define(stage, domain.path)
        cube.CreateSizeAttr(2.0 * domain.upper[0])
        cube.CreateExtentAttr([domain.lower, domain.upper])
        cube.CreatePurposeAttr(UsdGeom.Tokens.guide)
    else:
        UsdVol.Volume.Define(stage, domain.path).CreateExtentAttr([domain.lower, domain.upper])
    prim = stage.GetPrimAtPath(domain.path)
    author_transform(prim, domain)
    author_smoke_fields(prim, "SmokeDomainAPI", domain)


def _author_camera(stage: Usd.Stage, camera: Camera) -> None:
    prim = UsdGeom.Camera.Define(stage, camera.path).GetPrim()
    for field, name in CAMERA.items():
        set_value(prim.GetAttribute(name), getattr(camera, field))
    prim.GetAttribute("clippingRange").Set((camera.near, camera.far))
    author_transform(prim, camera)
