"""Geometry as triangle meshes: `UsdGeomMesh` as its cage, and the gprims.

Normals: those authored, for meshes with a subdivision scheme too. Without any, a mesh with scheme `none` is faceted
and one with another scheme is smooth, as its limit surface would be.
"""

from collections.abc import Callable

import numpy as np
from pxr import Usd, UsdGeom

from warp_smoke.geometry import Mesh, corner_normals, normalized
from warp_smoke.record import FieldError, Samples, one_of, positive
from warp_smoke.scene import AXES
from warp_smoke.usd.names import MESH
from warp_smoke.usd.prims import uv_primvar
from warp_smoke.usd.reader import StageReader
from warp_smoke.usd.triangulate import triangulate

# Normals this far from unit length are normalized; the rest keep their bits.
UNIT = 1e-5


def read_geometry(reader: StageReader, prim: Usd.Prim) -> Mesh:
    """The shape of a prim for which `has_geometry` holds, in its local space.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    with reader.naming(prim.GetPath(), MESH):
        if prim.IsA(UsdGeom.Mesh):
            return _read_polygons(reader, UsdGeom.Mesh(prim))
        return GPRIMS[prim.GetTypeName()](reader, prim)


def has_geometry(prim: Usd.Prim) -> bool:
    """Whether a prim's shape can be read: a mesh or a gprim with a surface."""
    return prim.IsA(UsdGeom.Mesh) or prim.GetTypeName() in GPRIMS


def _read_polygons(reader: StageReader, mesh: UsdGeom.Mesh) -> Mesh:
    points = _read_points(reader, mesh)
    still_points = points.at(reader.start) if isinstance(points, Samples) else points
    counts = _array(reader.still(mesh.GetFaceVertexCountsAttr()), np.int64)
    indices = _array(reader.still(mesh.GetFaceVertexIndicesAttr()), np.int64)
    path = str(mesh.GetPath())
    if len(counts) and (counts.min() < 0 or counts.sum() != len(indices)):
        raise FieldError(path, "faceVertexCounts", f"{counts.sum()} corners in all", f"{len(indices)}, one an index")
    if len(indices) and not 0 <= indices.min() <= indices.max() < len(still_points):
        allowed = f"0…{len(still_points) - 1}, the points there are"
        raise FieldError(path, "faceVertexIndices", f"{indices.min()}…{indices.max()}", allowed)

    corners, polygon = triangulate(still_points, counts, indices)
    holes = _array(reader.still(mesh.GetHoleIndicesAttr()), np.int64)
    if len(holes):
        solid = ~np.isin(polygon, holes)
        corners, polygon = corners[solid], polygon[solid]
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        corners = corners[:, ::-1]
    triangles = indices[corners]
    flat = np.count_nonzero(~corner_normals(still_points, triangles)[:, 0].any(axis=1))
    if flat:
        reader.warn(mesh.GetPrim(), f"{flat} of {len(triangles)} triangles have no area")

    def each_corner(values: np.ndarray, interpolation: str) -> np.ndarray | None:
        """Primvar values [·, d] at each triangle's corners, [m, 3, d]; None if there are not as many as needed."""
        places, needed = {
            UsdGeom.Tokens.constant: (np.zeros_like(corners), 1),
            UsdGeom.Tokens.uniform: (np.repeat(polygon[:, None], 3, axis=1), len(counts)),
            UsdGeom.Tokens.faceVarying: (corners, len(indices)),
        }.get(interpolation, (triangles, len(still_points)))
        return values[places] if len(values) == needed else None

    return Mesh(
        points,
        triangles,
        _read_normals(reader, mesh, isinstance(points, Samples), still_points, triangles, each_corner),
        _read_uvs(reader, mesh, each_corner),
    )


def _read_points(reader: StageReader, mesh: UsdGeom.Mesh) -> np.ndarray | Samples:
    """The points [n, 3] float32, or Samples [t, n, 3]."""
    attribute = mesh.GetPointsAttr()
    first = _array(attribute.Get(reader.start), np.float32).reshape(-1, 3)
    times = reader.sample_times([attribute])
    every = [_array(attribute.Get(time), np.float32).reshape(-1, 3) for time in times]
    if len(times) < 2 or all(np.array_equal(one, first, equal_nan=True) for one in every):
        return first
    if any(len(one) != len(first) for one in every):
        reader.warn(mesh.GetPrim(), "the number of points changes in time, which is not supported; the first is used")
        return first
    return Samples(np.array(times), np.stack(every))


def _read_normals(
    reader: StageReader,
    mesh: UsdGeom.Mesh,
    deforms: bool,
    points: np.ndarray,
    triangles: np.ndarray,
    each_corner: Callable[[np.ndarray, str], np.ndarray | None],
) -> np.ndarray | None:
    """Unit normals at the triangles' corners [m, 3, 3], or None for a faceted mesh."""
    prim = mesh.GetPrim()
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
    smooth = mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none
    if primvar and primvar.HasAuthoredValue():
        attribute, interpolation = primvar.GetAttr(), primvar.GetInterpolation()
        values = primvar.ComputeFlattened(reader.start)
    else:
        attribute, interpolation = mesh.GetNormalsAttr(), mesh.GetNormalsInterpolation()
        values = attribute.Get(reader.start)
    if deforms and (attribute.ValueMightBeTimeVarying() or (smooth and not values)):
        reader.warn(prim, "normals that move with the points are not supported; the mesh is faceted")
        return None
    if values:
        normals = each_corner(_array(values, np.float32).reshape(-1, 3), interpolation)
        if normals is not None:
            if not np.all(np.isfinite(normals)):
                raise FieldError(str(mesh.GetPath()), "normals", "NaN or infinity", "finite numbers")
            return _unit(normals, points, triangles)
        reader.warn(prim, f"{len(values)} normals do not fit the mesh ({interpolation}); they are left out")
    return corner_normals(points, triangles, smooth=True) if smooth else None


def _unit(normals: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Normals made unit; those of zero length become the face's."""
    exact = normals.astype(np.float64)
    length = np.linalg.norm(exact, axis=2, keepdims=True)
    off = np.abs(length - 1.0) > UNIT
    if not off.any():
        return normals
    exact = np.where(off, normalized(exact), exact)
    return np.where(length > 0, exact, corner_normals(points, triangles))


def _read_uvs(
    reader: StageReader, mesh: UsdGeom.Mesh, each_corner: Callable[[np.ndarray, str], np.ndarray | None]
) -> np.ndarray | None:
    """Texture coordinates at the triangles' corners, [m, 3, 2]."""
    primvar = uv_primvar(mesh.GetPrim())
    if primvar is None:
        return None
    values = _array(primvar.ComputeFlattened(reader.start), np.float32).reshape(-1, 2)
    uvs = each_corner(values, primvar.GetInterpolation())
    if uvs is None:
        text = f"{primvar.GetName()} has {len(values)} values, which do not fit the mesh; they are left out"
        reader.warn(mesh.GetPrim(), text)
    elif not np.all(np.isfinite(uvs)):
        raise FieldError(str(mesh.GetPath()), primvar.GetName(), "NaN or infinity", "finite numbers")
    return uvs


def _array(values: object, dtype: type) -> np.ndarray:
    return np.zeros(0, dtype) if values is None else np.asarray(values, dtype)


def _length(reader: StageReader, prim: Usd.Prim, name: str) -> float:
    return positive(str(prim.GetPath()), name, reader.still(prim.GetAttribute(name)))


def _axis(prim: Usd.Prim) -> str:
    return one_of(str(prim.GetPath()), "axis", prim.GetAttribute("axis").Get(), AXES)


def _read_sphere(reader: StageReader, prim: Usd.Prim) -> Mesh:
    return Mesh.sphere(_length(reader, prim, "radius"))


def _read_cube(reader: StageReader, prim: Usd.Prim) -> Mesh:
    return Mesh.box(_length(reader, prim, "size"))


def _read_cylinder(reader: StageReader, prim: Usd.Prim) -> Mesh:
    return Mesh.cylinder(_length(reader, prim, "radius"), _length(reader, prim, "height"), _axis(prim))


def _read_cone(reader: StageReader, prim: Usd.Prim) -> Mesh:
    return Mesh.cone(_length(reader, prim, "radius"), _length(reader, prim, "height"), _axis(prim))


def _read_capsule(reader: StageReader, prim: Usd.Prim) -> Mesh:
    return Mesh.capsule(_length(reader, prim, "radius"), _length(reader, prim, "height"), _axis(prim))


def _read_plane(reader: StageReader, prim: Usd.Prim) -> Mesh:
    """A rectangle facing its axis."""
    edges = {  # (u, v) with u × v along the axis, as UsdGeomPlane lays width and length
        "X": (("length", 1), ("width", 2)),
        "Y": (("length", 2), ("width", 0)),
        "Z": (("width", 0), ("length", 1)),
    }[_axis(prim)]
    u_edge, v_edge = (_length(reader, prim, name) * np.eye(3)[axis] for name, axis in edges)
    return Mesh.grid(-(u_edge + v_edge) / 2, u_edge, v_edge)


GPRIMS = {
    "Sphere": _read_sphere,
    "Cube": _read_cube,
    "Cylinder": _read_cylinder,
    "Cone": _read_cone,
    "Capsule": _read_capsule,
    "Plane": _read_plane,
}
