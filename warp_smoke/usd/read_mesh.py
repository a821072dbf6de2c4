"""Reading of triangle meshes, from gprims and from the control cage of `UsdGeomMesh`, and of points as small spheres.

Authored normals are used, even for meshes with a subdivision scheme. Without them, a mesh with the scheme `none` is
faceted and one with another scheme is smooth, as its limit surface would be.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from pxr import Usd, UsdGeom

from warp_smoke.geometry import Mesh, Points, corner_normals, normalized
from warp_smoke.record import FieldError, Samples, each_value, one_of, positive, value_at
from warp_smoke.scene import AXES
from warp_smoke.usd.names import MESH
from warp_smoke.usd.prims import uv_primvar
from warp_smoke.usd.reader import StageReader, whole_times
from warp_smoke.usd.triangulate import triangulate

# Normals this far from unit length are normalized; the rest keep their bits.
UNIT = 1e-5


def read_geometry(reader: StageReader, prim: Usd.Prim) -> Mesh:
    """Reads the shape of a prim for which `has_geometry` holds, in its local space.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    with reader.naming(prim.GetPath(), MESH):
        if prim.IsA(UsdGeom.Mesh):
            return _read_polygons(reader, UsdGeom.Mesh(prim))
        return _read_gprim(reader, prim)


def has_geometry(prim: Usd.Prim) -> bool:
    """Returns whether a prim's shape can be read: that of a mesh or another gprim with a surface."""
    return prim.IsA(UsdGeom.Mesh) or prim.GetTypeName() in GPRIMS


def read_spheres(reader: StageReader, prim: Usd.Prim) -> Points:
    """Reads the points of a `UsdGeomPoints`, in its local space.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    with reader.naming(prim.GetPath(), {}):
        points = _read_points(reader, UsdGeom.Points(prim))
        return Points(points, _read_widths(reader, prim, each_value(points).shape[1]))


def _read_widths(reader: StageReader, prim: Usd.Prim, count: int) -> np.ndarray | Samples:
    """Reads one width for each point, [n] float32, or Samples [t, n]."""
    geom, primvar = UsdGeom.Points(prim), UsdGeom.PrimvarsAPI(prim).GetPrimvar("widths")
    attribute, interpolation = geom.GetWidthsAttr(), geom.GetWidthsInterpolation()
    if primvar and primvar.HasAuthoredValue():
        attribute, interpolation = primvar.GetAttr(), primvar.GetInterpolation()

    def widths_at(time: float) -> np.ndarray:
        widths = _array(attribute, attribute.Get(time), np.float32)
        if interpolation == UsdGeom.Tokens.constant and len(widths) == 1:
            return np.repeat(widths, count)
        if len(widths) != count:
            allowed = f"{count}, one for each point, or one with constant interpolation"
            raise FieldError(str(prim.GetPath()), "widths", f"{len(widths)} values", allowed)
        return widths

    return reader.over_time(reader.sample_times([attribute]), widths_at)


def _read_polygons(reader: StageReader, mesh: UsdGeom.Mesh) -> Mesh:
    points = _read_points(reader, mesh)
    still_points = points.at(reader.start) if isinstance(points, Samples) else points
    counts = _still_array(reader, mesh.GetFaceVertexCountsAttr())
    indices = _still_array(reader, mesh.GetFaceVertexIndicesAttr())
    path = str(mesh.GetPath())
    if len(counts) and (counts.min() < 0 or counts.sum() != len(indices)):
        raise FieldError(path, "faceVertexCounts", f"{counts.sum()} corners in all", f"{len(indices)}, one per index")
    if len(indices) and not 0 <= indices.min() <= indices.max() < len(still_points):
        allowed = f"0…{len(still_points) - 1}, the points there are"
        raise FieldError(path, "faceVertexIndices", f"{indices.min()}…{indices.max()}", allowed)

    corners, polygon = triangulate(still_points, counts, indices)
    holes = _still_array(reader, mesh.GetHoleIndicesAttr())
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
        """Returns primvar values [·, d] at each triangle's corners, [m, 3, d]; None if their number is wrong."""
        places, needed = {
            UsdGeom.Tokens.constant: (np.zeros_like(corners), 1),
            UsdGeom.Tokens.uniform: (np.repeat(polygon[:, None], 3, axis=1), len(counts)),
            UsdGeom.Tokens.faceVarying: (corners, len(indices)),
        }.get(interpolation, (triangles, len(still_points)))
        return values[places] if len(values) == needed else None

    return Mesh(
        points,
        triangles,
        _read_normals(reader, mesh, points, triangles, each_corner),
        _read_uvs(reader, mesh, each_corner),
        None if np.array_equal(polygon, np.arange(len(counts))) else polygon.astype(np.int32),
    )


def _read_points(reader: StageReader, mesh: UsdGeom.PointBased) -> np.ndarray | Samples:
    """Reads the points, [n, 3] float32, or Samples [t, n, 3]."""
    attribute = mesh.GetPointsAttr()
    first = _array(attribute, attribute.Get(reader.start), np.float32, 3)
    times = reader.sample_times([attribute])
    every = [_array(attribute, attribute.Get(time), np.float32, 3) for time in times]
    if len(times) < 2 or all(np.array_equal(one, first, equal_nan=True) for one in every):
        return first
    if any(len(one) != len(first) for one in every):
        reader.warn(mesh.GetPrim(), "the number of points changes in time, which is not supported; the first is used")
        return first
    return Samples(np.array(times), np.stack(every))


def _read_normals(
    reader: StageReader,
    mesh: UsdGeom.Mesh,
    points: np.ndarray | Samples,
    triangles: np.ndarray,
    each_corner: Callable[[np.ndarray, str], np.ndarray | None],
) -> np.ndarray | Samples | None:
    """Reads unit normals at triangle corners, [m, 3, 3]; Samples [t, m, 3, 3] if they turn, None for a faceted mesh."""
    prim = mesh.GetPrim()
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
    smooth = mesh.GetSubdivisionSchemeAttr().Get() != UsdGeom.Tokens.none
    if primvar and primvar.HasAuthoredValue():
        attribute, interpolation = primvar.GetAttr(), primvar.GetInterpolation()
        value_at_time = primvar.ComputeFlattened
    else:
        attribute, interpolation = mesh.GetNormalsAttr(), mesh.GetNormalsInterpolation()
        value_at_time = attribute.Get
    times = reader.sample_times([attribute])
    given = {time: _array(attribute, value_at_time(time), np.float32, 3) for time in (*times, reader.start)}
    if len(given[reader.start]):
        if all(each_corner(values, interpolation) is not None for values in given.values()):

            def authored(time: float) -> np.ndarray:
                normals = each_corner(given[time], interpolation)
                if not np.all(np.isfinite(normals)):
                    raise FieldError(str(mesh.GetPath()), "normals", "NaN or infinity", "finite numbers")
                return _unit(normals, value_at(points, time), triangles)

            return reader.over_time(times, authored)
        count = len(given[reader.start])
        reader.warn(prim, f"{count} normals do not fit the mesh ({interpolation}); they are left out")
    if not smooth:
        return None
    times = points.times.tolist() if isinstance(points, Samples) else []
    times = sorted({*times, *(whole_times(times) if times else ())})
    return reader.over_time(times, lambda time: corner_normals(value_at(points, time), triangles, smooth=True))


def _unit(normals: np.ndarray, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Returns the normals at unit length; those of length zero become the face's."""
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
    """Reads texture coordinates at the triangles' corners, [m, 3, 2]; None if there are none that fit."""
    primvar = uv_primvar(mesh.GetPrim())
    if primvar is None:
        return None
    values = _array(primvar.GetAttr(), primvar.ComputeFlattened(reader.start), np.float32, 2)
    uvs = each_corner(values, primvar.GetInterpolation())
    if uvs is None:
        text = f"{primvar.GetName()} has {len(values)} values, which do not fit the mesh; they are left out"
        reader.warn(mesh.GetPrim(), text)
    elif not np.all(np.isfinite(uvs)):
        raise FieldError(str(mesh.GetPath()), primvar.GetName(), "NaN or infinity", "finite numbers")
    return uvs


def _still_array(reader: StageReader, attribute: Usd.Attribute) -> np.ndarray:
    """Reads an attribute's integers at the start, [n] int64."""
    return _array(attribute, reader.still(attribute), np.int64)


def _array(attribute: Usd.Attribute, values: object, dtype: type, width: int | None = None) -> np.ndarray:
    """Returns an attribute's values as [n], or as [n, width]; empty if it is unset.

    Raises:
        FieldError: the values have another type or shape.
    """
    shape = () if width is None else (width,)
    found = np.asarray(() if values is None else values)
    if not found.size:
        return np.zeros((0, *shape), dtype)
    kinds, allowed = ("iu", "whole numbers") if np.issubdtype(dtype, np.integer) else ("iuf", "numbers")
    if found.dtype.kind not in kinds or found.ndim != 1 + len(shape) or found.shape[1:] != shape:
        allowed = f"an array of {allowed}" + (f", {width} each" if width else "")
        raise FieldError(str(attribute.GetPrim().GetPath()), attribute.GetName(), values, allowed)
    with np.errstate(over="ignore"):  # values that become infinite are refused later
        return found.astype(dtype)


def _read_gprim(reader: StageReader, prim: Usd.Prim) -> Mesh:
    lengths, make = GPRIMS[prim.GetTypeName()]
    path = str(prim.GetPath())
    values = [positive(path, name, reader.still(prim.GetAttribute(name))) for name in lengths]
    if prim.HasAttribute("axis"):
        values.append(one_of(path, "axis", prim.GetAttribute("axis").Get(), AXES))
    return make(*values)


def _make_plane(width: float, length: float, axis: str) -> Mesh:
    """Makes a rectangle that faces along its axis."""
    (u, u_length), (v, v_length) = {  # u × v is the axis; USD defines which is width and which length
        "X": ((1, length), (2, width)),
        "Y": ((2, length), (0, width)),
        "Z": ((0, width), (1, length)),
    }[axis]
    u_edge, v_edge = u_length * np.eye(3)[u], v_length * np.eye(3)[v]
    return Mesh.grid(-(u_edge + v_edge) / 2, u_edge, v_edge)


# Attributes with lengths, and the function that makes a mesh of them and the axis; equal gprims share a mesh.
GPRIMS = {
    "Sphere": (("radius",), lru_cache(Mesh.sphere)),
    "Cube": (("size",), lru_cache(Mesh.box)),
    "Cylinder": (("radius", "height"), lru_cache(Mesh.cylinder)),
    "Cone": (("radius", "height"), lru_cache(Mesh.cone)),
    "Capsule": (("radius", "height"), lru_cache(Mesh.capsule)),
    "Plane": (("width", "length"), lru_cache(_make_plane)),
}
