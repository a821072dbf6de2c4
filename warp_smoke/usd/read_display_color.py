"""Materials of surfaces without a bound one: `primvars:displayColor` and `displayOpacity`, as viewers show them.

A material has one colour, so faces of different colours become face subsets.
"""

import numpy as np
from pxr import Usd, UsdGeom

from warp_smoke.geometry import Mesh
from warp_smoke.record import LARGEST
from warp_smoke.scene import Material, MaterialSubset
from warp_smoke.usd.reader import StageReader, shortest_decimal

# Colours of one surface; each becomes a material of its own.
MOST_COLORS = 64
# Name of a primvar, number of components of its values, and the largest value allowed.
_COLOR, _OPACITY = ("displayColor", 3, LARGEST), ("displayOpacity", 1, 1.0)


def read_display_color(
    reader: StageReader, prim: Usd.Prim, mesh: Mesh
) -> tuple[Material | None, tuple[MaterialSubset, ...]]:
    """Makes materials from the display colour (linear RGB) and opacity of a prim without a material.

    Args:
        reader: the stage's reader; takes warnings about what cannot be shown as authored.
        prim: a mesh or another prim with a surface.
        mesh: its shape.

    Returns:
        The material of most faces, or None without either primvar, and the subsets of the other faces.
    """
    colors, opacities = (_read_faces(reader, prim, *primvar) for primvar in (_COLOR, _OPACITY))
    if colors is None and opacities is None:
        return None, ()
    colors = np.array([Material().diffuse_color]) if colors is None else colors
    opacities = np.ones((1, 1)) if opacities is None else opacities
    count = max(len(colors), len(opacities))
    every = np.hstack([np.broadcast_to(values, (count, values.shape[1])) for values in (colors, opacities)])
    looks, look_of_face, faces_of_look = np.unique(every, axis=0, return_inverse=True, return_counts=True)
    materials = [
        Material(
            path=f"{prim.GetPath()}_displayColor" + (f"_{n}" if len(looks) > 1 else ""),
            diffuse_color=tuple(map(shortest_decimal, look[:3])),
            opacity=shortest_decimal(look[3]),
        )
        for n, look in enumerate(looks)
    ]
    for material in materials:
        warn_of_shadow(reader, prim, "primvars:displayOpacity", material)
    most = int(np.argmax(faces_of_look))
    if len(looks) == 1:
        return materials[most], ()
    face_of_triangle = np.arange(len(mesh.triangles)) if mesh.faces is None else mesh.faces
    look_of_triangle = look_of_face.ravel()[face_of_triangle]
    subsets = (
        MaterialSubset(
            path=f"{prim.GetPath()}/displayColor_{n}",
            triangles=np.flatnonzero(look_of_triangle == n),
            material=material,
        )
        for n, material in enumerate(materials)
        if n != most
    )
    return materials[most], tuple(subsets)


def warn_of_shadow(reader: StageReader, prim: Usd.Prim, name: str, material: Material) -> None:
    """Warns that the shadow of a partly transparent surface is all or nothing."""
    if material.opacity_texture is not None or (material.is_blended and material.casts_shadow):
        reader.warn(prim, f"{name}: its shadow is that of an opaque surface")
    elif material.is_blended and material.opacity > 0.0:
        reader.warn(prim, f"{name}: it casts no shadow, since it hides less than half")


def warn_of_instances_colors(reader: StageReader, instancer: Usd.Prim) -> None:
    """Warns if the instances of a `PointInstancer` have colours of their own, which are not used."""
    primvar = UsdGeom.PrimvarsAPI(instancer).GetPrimvar("displayColor")
    if primvar and primvar.HasValue() and primvar.GetInterpolation() != UsdGeom.Tokens.constant:
        reader.warn(instancer, "primvars:displayColor of each instance is not supported; the prototypes' is used")


def _read_faces(reader: StageReader, prim: Usd.Prim, name: str, width: int, largest: float) -> np.ndarray | None:
    """Reads a primvar's value on each face of a mesh, [faces, width], or the same on all of them, [1, width].

    Returns None if there are no values, or, with a warning, if they cannot be used.
    """
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    if not primvar or not primvar.HasValue():
        return None
    reader.still(primvar.GetAttr())
    values = np.atleast_1d(primvar.ComputeFlattened(reader.start))
    if not values.size:
        return None
    if values.dtype.kind not in "fiu" or values.size != len(values) * width:
        reader.warn(prim, f"primvars:{name} does not hold values of {width} numbers each; it is left out")
        return None
    values = values.astype(np.float64).reshape(-1, width)
    if not np.all((values >= 0.0) & (values <= largest)):
        reader.warn(prim, f"primvars:{name} has values other than 0 to {largest:g}; it is left out")
        return None
    at_corners, counts = _at_corners(prim, values, primvar.GetInterpolation(), reader.start)
    if at_corners is None:
        text = f"{len(values)} values, which do not fit the prim ({primvar.GetInterpolation()}); they are left out"
        reader.warn(prim, f"primvars:{name} has {text}")
        return None
    if np.all(at_corners == at_corners[:1]):
        return at_corners[:1]
    first = at_corners[np.minimum(np.cumsum(counts) - counts, len(at_corners) - 1)]
    whole = np.array_equal(np.repeat(first, counts, axis=0), at_corners)
    if whole and len(np.unique(first, axis=0)) <= MOST_COLORS:
        return first
    text = f"varies inside faces or has more than {MOST_COLORS} values, which is not supported; its mean is used"
    reader.warn(prim, f"primvars:{name} {text}")
    return at_corners.mean(axis=0, keepdims=True)


def _at_corners(
    prim: Usd.Prim, values: np.ndarray, interpolation: str, time: float
) -> tuple[np.ndarray | None, np.ndarray]:
    """Returns primvar values at each face's corners, None if their number is wrong, and the faces' corner counts.

    A prim that is not a mesh counts as one face, with all its values at the corners.
    """
    if interpolation == UsdGeom.Tokens.constant:
        return (values if len(values) == 1 else None), np.ones(1, int)
    if not prim.IsA(UsdGeom.Mesh):
        return values, np.array([len(values)])
    mesh = UsdGeom.Mesh(prim)
    counts, indices = (
        np.asarray(attribute.Get(time), np.int64)
        for attribute in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    )
    places, needed = {
        UsdGeom.Tokens.uniform: (np.repeat(np.arange(len(counts)), counts), len(counts)),
        UsdGeom.Tokens.faceVarying: (np.arange(len(indices)), len(indices)),
    }.get(interpolation, (indices, len(mesh.GetPointsAttr().Get(time))))
    return (values[places] if len(values) == needed else None), counts
