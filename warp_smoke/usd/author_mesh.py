"""Authoring of meshes and points, with the materials, receivers and face subsets on them."""

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

from warp_smoke.geometry import Mesh
from warp_smoke.record import FieldError, Samples, each_value
from warp_smoke.scene import Collider, Emitter, Material, Surface
from warp_smoke.usd.author_prim import author_smoke_fields, author_transform, author_visibility


def author_shape(stage: Usd.Stage, record: Emitter | Collider | Surface) -> Usd.Prim:
    """Authors the Mesh of a record, unless another record with the same path has done so; returns its prim."""
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
    author_transform(geom.GetPrim(), record)
    return geom.GetPrim()


def author_points(stage: Usd.Stage, emitter: Emitter) -> Usd.Prim:
    """Authors the Points of an emitter; returns their prim."""
    geom = UsdGeom.Points.Define(stage, emitter.path)
    points, widths = emitter.mesh.points, emitter.mesh.widths
    for attribute, value in ((geom.CreatePointsAttr(), points), (geom.CreateWidthsAttr(), widths)):
        times = value.times.tolist() if isinstance(value, Samples) else [Usd.TimeCode.Default()]
        for time, one in zip(times, each_value(value), strict=True):
            attribute.Set(Vt.Vec3fArray.FromNumpy(one) if one.ndim == 2 else Vt.FloatArray.FromNumpy(one), time)
    every, radius = each_value(points).reshape(-1, 3), each_value(widths).max(initial=0.0) / 2.0
    if len(every):
        geom.CreateExtentAttr([(every.min(axis=0) - radius).tolist(), (every.max(axis=0) + radius).tolist()])
    author_transform(geom.GetPrim(), emitter)
    return geom.GetPrim()


def author_surface(stage: Usd.Stage, surface: Surface) -> None:
    """Authors a surface's Mesh, unless another record has done so, and its material, face subsets and receiver."""
    prim = author_shape(stage, surface)
    author_visibility(prim, surface.visible)
    if surface.receiver is not None:
        author_smoke_fields(prim, "SmokeReceiverAPI", surface.receiver)
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
