"""USD stage → Scene.

The modules for each kind of prim say what is read, and what is ignored with a warning: `read_smoke`, `read_mesh`,
`read_light`, `read_material`, `read_camera`.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Pcp, Sdf, Tf, Usd, UsdGeom, UsdLux

from warp_smoke.geometry import Mesh
from warp_smoke.record import each_value
from warp_smoke.scene import Collider, Emitter, Light, Scene, SmokeDomain, Surface
from warp_smoke.usd.names import STAGE, TRANSFORM
from warp_smoke.usd.quiet import usd_kept_quiet
from warp_smoke.usd.read_camera import choose_camera, read_camera
from warp_smoke.usd.read_display_color import warn_of_instances_colors
from warp_smoke.usd.read_instances import InstanceReader, instanced_prims
from warp_smoke.usd.read_light import is_ambient, link_light, read_ambient, read_light
from warp_smoke.usd.read_material import MaterialReader
from warp_smoke.usd.read_mesh import has_geometry, read_geometry, read_spheres
from warp_smoke.usd.read_smoke import (
    read_collider,
    read_domain,
    read_emitter,
    read_receiver,
    stray_attributes,
    unknown_schemas,
)
from warp_smoke.usd.reader import StageReader, bad_input
from warp_smoke.usd.schema import register_schema
from warp_smoke.usd.stage_metadata import ineffective_metadata
from warp_smoke.usd.volume import DOMAIN_RELATIONSHIP

DEFAULT_FRAMES = 48
MISSING = (Pcp.ErrorInvalidAssetPath, Pcp.ErrorInvalidSublayerPath, Pcp.ErrorUnresolvedPrimPath)
PARTS_OF_THE_SET = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)


def read_scene(path: str | Path, camera: str | None = None) -> Scene:
    """Reads a USD stage.

    Args:
        path: a .usd, .usda, .usdc or .usdz file.
        camera: prim path of the camera to look through; see `choose_camera`.

    Returns:
        The scene; its `warnings` name what is not supported.

    Raises:
        ValueError: the file is missing or does not parse, something it refers to is missing, or a value is not
            allowed: one line naming file, prim and attribute.
    """
    register_schema()
    if Path(path).is_dir():
        raise ValueError(f"{path}: is a folder; allowed: the file of a stage")
    if not Path(path).is_file():
        raise ValueError(f"{path}: no such file")
    with usd_kept_quiet():
        try:
            scene = read_stage(Usd.Stage.Open(str(path)), str(path), camera)
        except Tf.ErrorException as error:  # also raised while values of a damaged file are read
            raise ValueError(f"{path}: not a USD stage: {usd_message(error.args[0])}") from None
        except UnicodeDecodeError:
            raise ValueError(f"{path}: not a USD stage: its names are not UTF-8") from None
    return replace(scene, source=Path(path).resolve())


def read_stage(stage: Usd.Stage, file: str, camera: str | None = None) -> Scene:
    """Reads an open stage.

    Args:
        stage: the stage.
        file: how errors name it.
        camera: as for `read_scene`.

    Returns:
        The scene; its `warnings` name what is not supported.

    Raises:
        ValueError: something the stage refers to is missing, or a value is not allowed: one line naming file, prim
            and attribute.
    """
    composition_errors = stage.GetCompositionErrors()
    for error in composition_errors:
        if isinstance(error, MISSING):
            raise ValueError(f"{file}: {error.rootSite.path}: {usd_message(error)}")
    ineffective = dict(ineffective_metadata(stage))
    if not stage.GetDefaultPrim():
        allowed = "; ".join(filter(None, ("the name of a root prim", ineffective.get("defaultPrim"))))
        raise bad_input(file, "/", "defaultPrim", "unset", allowed)
    settings = _read_settings(stage, file)
    reader = StageReader(file, settings.start)
    for error in composition_errors:
        reader.warn(stage.GetPrimAtPath(error.rootSite.path) or stage.GetPseudoRoot(), usd_message(error))
    for name, remark in ineffective.items():
        reader.warn(stage.GetPseudoRoot(), f"{name} is unset; {remark}")
    contents = _Contents(reader)
    for prim in _prims(stage):
        contents.add(reader, prim)

    if contents.domains and not UsdGeom.StageHasAuthoredMetersPerUnit(stage):
        reader.warn(stage.GetPseudoRoot(), _unset_unit(contents.domains[0], settings))
    if contents.domains and not _has_times(stage):
        reader.warn(stage.GetPseudoRoot(), f"no start and end time codes; {settings.start} to {settings.end} are used")
    if stage.HasAuthoredMetadata("framesPerSecond") and stage.GetFramesPerSecond() != stage.GetTimeCodesPerSecond():
        text = "framesPerSecond differs from timeCodesPerSecond, which is not supported; each time code is a frame"
        reader.warn(stage.GetPseudoRoot(), text)
    seen_from = choose_camera(reader, stage, contents.cameras, camera)
    return replace(
        settings,
        domains=contents.domains,
        emitters=contents.emitters,
        colliders=contents.colliders,
        surfaces=contents.surfaces,
        lights=contents.linked_lights(),
        camera=read_camera(reader, seen_from) if seen_from else None,
        ambient=tuple(map(float, contents.ambient)),
        warnings=reader.warnings,
    )


class _Contents:
    """The records of a stage, collected prim by prim."""

    def __init__(self, reader: StageReader):
        self._materials = MaterialReader(reader)
        self._shared_meshes: dict[Sdf.Path, Mesh] = {}
        self.domains: list[SmokeDomain] = []
        self.emitters: list[Emitter] = []
        self.colliders: list[Collider] = []
        self.surfaces: list[Surface] = []
        self._lights: list[tuple[Usd.Prim, Light]] = []
        self.cameras: list[Usd.Prim] = []
        self.ambient = np.zeros(3)

    def add(self, reader: StageReader, prim: Usd.Prim) -> None:
        """Adds the records that one prim, or one instance's copy of it, stands for."""
        applied = set(prim.GetPrimTypeInfo().GetAppliedAPISchemas())
        for text in (*unknown_schemas(applied), *stray_attributes(prim, applied)):
            reader.warn(prim, text)
        instanced = isinstance(reader, InstanceReader)
        if instanced and (is_ambient(prim) or "SmokeDomainAPI" in applied):
            reader.warn(prim, "it is not supported in a prototype of a PointInstancer; it is left out")
        elif "SmokeDomainAPI" in applied:
            self.domains.append(read_domain(reader, prim))
        elif prim.IsA(UsdGeom.PointInstancer):
            warn_of_instances_colors(reader, prim)
            for inside, each in instanced_prims(reader, prim):
                self.add(inside, each)
        elif has_geometry(prim):
            self._add_geometry(reader, prim, applied)
        elif prim.IsA(UsdGeom.Points) and "SmokeEmitterAPI" in applied and "SmokeColliderAPI" not in applied:
            self.emitters.append(read_emitter(reader, prim, read_spheres(reader, prim)))
        elif applied & {"SmokeEmitterAPI", "SmokeColliderAPI"}:
            kind = f"{min(applied & {'SmokeEmitterAPI', 'SmokeColliderAPI'})} on {prim.GetTypeName() or 'no type'}"
            allowed = "that schema on a Mesh, Sphere, Cube, Cylinder, Cone, Capsule or Plane; SmokeEmitterAPI on Points"
            raise reader.error(prim.GetPath(), "apiSchemas", kind, allowed)
        elif is_ambient(prim):
            self.ambient += read_ambient(reader, prim)
        elif prim.HasAPI(UsdLux.LightAPI):
            light = read_light(reader, prim)
            if light:
                self._lights.append((prim, light))
        elif prim.IsA(UsdGeom.Camera) and not instanced:
            self.cameras.append(prim)
        elif prim.GetTypeName() == "SkelRoot":
            reader.warn(prim, "skinning is not supported; meshes keep their points")
        elif _is_left_out(reader, prim):
            reader.warn(prim, f"a {prim.GetTypeName()} is not supported; it is left out")

    def linked_lights(self) -> list[Light]:
        """Returns the lights with their linking; call it once everything that they may be linked to is added."""
        paths = [record.path for record in (*self.surfaces, *self.domains)]
        return [link_light(prim, light, paths) for prim, light in self._lights]

    def _add_geometry(self, reader: StageReader, prim: Usd.Prim, applied: set[str]) -> None:
        emits, collides, receives = (f"Smoke{role}API" in applied for role in ("Emitter", "Collider", "Receiver"))
        seen = _seen(reader, prim)
        if receives and not seen:
            reader.warn(prim, "SmokeReceiverAPI has no effect, since the mesh is invisible or a guide or proxy")
        if not (emits or collides or seen):
            return
        mesh = self._shape(reader, prim)
        if not len(mesh.triangles):
            reader.warn(prim, "it has no faces; it is left out")
            return
        if emits:
            self.emitters.append(read_emitter(reader, prim, mesh))
        if collides:
            self.colliders.append(read_collider(reader, prim, mesh))
        if not seen:
            return
        if receives and not prim.IsA(UsdGeom.Mesh):
            text = f"SmokeReceiverAPI on a {prim.GetTypeName()} has no effect: only a Mesh has texture coordinates"
            reader.warn(prim, text)
        if receives and isinstance(reader, InstanceReader):
            reader.warn(prim, "SmokeReceiverAPI has no effect: instances of a PointInstancer are not baked")
            receives = False
        if prim.HasAPI(UsdLux.LightAPI):
            reader.warn(prim, "a mesh that is a light is not supported; it does not shine")
        material, subsets = self._materials.look_of(prim, mesh)
        with reader.naming(prim.GetPath(), {"transform": TRANSFORM}):
            self.surfaces.append(
                Surface(
                    path=reader.path(prim),
                    transform=reader.transform(prim),
                    mesh=mesh,
                    material=material,
                    subsets=subsets,
                    visible=reader.visible(prim),
                    receiver=read_receiver(reader, prim) if receives and prim.IsA(UsdGeom.Mesh) else None,
                    instancer=reader.instancer if isinstance(reader, InstanceReader) else None,
                    holds_bakes=prim.IsA(UsdGeom.Mesh) and not isinstance(reader, InstanceReader),
                )
            )

    def _shape(self, reader: StageReader, prim: Usd.Prim) -> Mesh:
        """Returns the mesh of a prim, shared among the instances of a prototype."""
        if not prim.IsInstanceProxy() and not isinstance(reader, InstanceReader):
            return read_geometry(reader, prim)
        path = prim.GetPrimInPrototype().GetPath() if prim.IsInstanceProxy() else prim.GetPath()
        if path not in self._shared_meshes:
            self._shared_meshes[path] = read_geometry(reader, prim)
        return self._shared_meshes[path]


def _is_left_out(reader: StageReader, prim: Usd.Prim) -> bool:
    """Returns whether a prim is visible but cannot be read; the smoke of a run does not count."""
    known = prim.GetTypeName() == "Skeleton" or prim.HasRelationship(DOMAIN_RELATIONSHIP)
    return prim.IsA(UsdGeom.Boundable) and not known and _seen(reader, prim)


def _seen(reader: StageReader, prim: Usd.Prim) -> bool:
    """Returns whether a prim belongs to the set: ever visible, and no guide, proxy or Omniverse volume box."""
    purpose = UsdGeom.Imageable(prim).ComputePurpose()
    solid = not prim.GetAttribute("primvars:isVolume").Get()
    return solid and purpose in PARTS_OF_THE_SET and bool(np.any(each_value(reader.visible(prim))))


def _prims(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    """Yields all prims, including those of native instances, but not the prototypes under a PointInstancer."""
    prims = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
    for prim in prims:
        if prim.IsA(UsdGeom.PointInstancer):
            prims.PruneChildren()
        yield prim


def _read_settings(stage: Usd.Stage, file: str) -> Scene:
    """Returns an empty scene with the stage's times, units and up axis."""
    start = _whole(stage.GetStartTimeCode()) if stage.HasAuthoredMetadata("startTimeCode") else 1
    end = _whole(stage.GetEndTimeCode()) if stage.HasAuthoredMetadata("endTimeCode") else start + DEFAULT_FRAMES - 1
    with StageReader(file, start).naming("/", STAGE):
        return Scene(
            start=start,
            end=end,
            time_codes_per_second=stage.GetTimeCodesPerSecond(),
            meters_per_unit=UsdGeom.GetStageMetersPerUnit(stage),
            up_axis=UsdGeom.GetStageUpAxis(stage),
        )


def _unset_unit(domain: SmokeDomain, settings: Scene) -> str:
    """Returns the warning that the stage's unit is unset, with the size that a domain has as a result."""
    size = np.linalg.norm(domain.transform_at(settings.start)[:3, :3], axis=1) * np.subtract(domain.upper, domain.lower)
    metres = " × ".join(f"{length * settings.meters_per_unit:.3g}" for length in size)
    return f"metersPerUnit is unset, which in USD makes a unit a centimetre: {domain.path} is {metres} m"


def _has_times(stage: Usd.Stage) -> bool:
    return stage.HasAuthoredMetadata("startTimeCode") and stage.HasAuthoredMetadata("endTimeCode")


def _whole(time: float) -> float | int:
    """Returns a time code as int if it is whole; else unchanged, for Scene to refuse."""
    return int(time) if float(time).is_integer() else time


def usd_message(error: Tf.Error | Pcp.ErrorBase) -> str:
    """Returns USD's message of an error in one line; it may quote bytes that are not text."""
    try:
        text = error.commentary if isinstance(error, Tf.Error) else str(error)
    except UnicodeDecodeError as undecoded:
        text = undecoded.object.decode(errors="replace")
    return " ".join(text.split())
