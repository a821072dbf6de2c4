"""What is interpolated over the triangles that a picture's rays hit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_smoke.geometry import winding_flips
from warp_smoke.launch import Launcher
from warp_smoke.material import Material
from warp_smoke.scene import Surface
from warp_smoke.shading.looks import without_coordinates
from warp_smoke.shading.placement import place_normals, place_points
from warp_smoke.shading.tangents import corner_tangents


@wp.struct
class TriangleTable:
    """What is interpolated over triangles, in the order of the rays' mesh.

    Attributes:
        normals, tangents, uvs: at each corner, [m, 3]; one row of tangents or uvs where no material needs them.
        material: index into `Looks.materials`, [m].
        surface: index into the scene's surfaces, [m].
    """

    normals: wp.array2d[wp.vec3]
    tangents: wp.array2d[wp.vec4]
    uvs: wp.array2d[wp.vec2]
    material: wp.array[int]
    surface: wp.array[int]


@dataclass(frozen=True)
class Dressing:
    """Materials as surfaces can show them.

    Attributes:
        materials: all materials.
        index: for each surface, the index of each triangle's material, [m] int32.
        warnings: what surfaces cannot show.
    """

    materials: tuple[Material, ...]
    index: tuple[np.ndarray, ...]
    warnings: tuple[str, ...]

    @property
    def needs_tangents(self) -> bool:
        """Whether any material needs tangent space."""
        return any(material.needs_tangents for material in self.materials)

    @property
    def is_blended(self) -> bool:
        """Whether any material is blended with what lies behind it."""
        return any(material.is_blended for material in self.materials)


def dress_surfaces(surfaces: Sequence[Surface]) -> Dressing:
    """Collects the materials of surfaces, without pictures where there are no texture coordinates."""
    materials, index, warnings = [Material()], [], []
    for surface in surfaces:
        places = []
        for material in surface.materials:
            if surface.mesh.uvs is None:
                material, missing = without_coordinates(material, surface.path)
                warnings += missing
            if material not in materials:
                materials.append(material)
            places.append(materials.index(material))
        index.append(np.asarray(places, np.int32)[surface.material_of_triangle])
    return Dressing(tuple(materials), tuple(index), tuple(dict.fromkeys(warnings)))


def triangle_table(
    launcher: Launcher,
    surfaces: Sequence[Surface],
    surface_of_triangle: np.ndarray,
    dressing: Dressing,
    origin: np.ndarray,
    time: float,
) -> TriangleTable:
    """Makes the table of the visible surfaces at a time code.

    Args:
        launcher: where to allocate.
        surfaces: all of the scene's.
        surface_of_triangle: index of the surface of each of the mesh's triangles, [m]; surface by surface.
        dressing: the surfaces' materials.
        origin: world position of set space's origin, [3] float64.
        time: time code.
    """
    normals, tangents, uvs, material = [], [], [], []
    for index in dict.fromkeys(surface_of_triangle.tolist()):
        surface, mesh = surfaces[index], surfaces[index].mesh
        order = slice(None, None, -1 if winding_flips(surface.transform_at(time)) else 1)
        corner_normals = place_normals(surface, time)
        corner_uvs = np.zeros((len(mesh.triangles), 3, 2), np.float32) if mesh.uvs is None else mesh.uvs
        material.append(dressing.index[index])
        normals.append(corner_normals[:, order])
        uvs.append(corner_uvs[:, order])
        if any(dressing.materials[n].needs_tangents for n in np.unique(dressing.index[index])):
            points = place_points(surface, origin, time)
            tangents.append(corner_tangents(points, mesh.triangles, corner_normals, corner_uvs)[:, order])
        elif dressing.needs_tangents:
            tangents.append(np.zeros((len(mesh.triangles), 3, 4), np.float32))
    table = TriangleTable()

    def put(parts: list, width: int, dtype: type) -> wp.array:
        values = np.concatenate(parts) if parts else np.zeros((1, 3, width))
        return launcher.array(np.ascontiguousarray(values, np.float32), "picture", dtype=dtype)

    table.normals, table.uvs = put(normals, 3, wp.vec3), put(uvs, 2, wp.vec2)
    table.tangents = put(tangents, 4, wp.vec4)
    surface_index = surface_of_triangle if len(surface_of_triangle) else np.zeros(1, np.int32)
    table.surface = launcher.array(surface_index.astype(np.int32), "picture")
    table.material = launcher.array(np.concatenate(material or [np.zeros(1, np.int32)]), "picture")
    return table
