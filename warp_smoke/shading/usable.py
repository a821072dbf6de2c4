"""What a receiver can be baked with: texels or points, and its materials as its texture coordinates allow."""

import numpy as np

from warp_smoke.launch import Launcher
from warp_smoke.scene import Material, Surface
from warp_smoke.shading.looks import without_coordinates, without_relief
from warp_smoke.shading.texels import TexelMap
from warp_smoke.shading.vertices import VertexMap
from warp_smoke.uv_fit import BAKE_UVS

# Adjacent charts may share up to this part of their texels when coordinates are fitted into [0, 1].
_OVERLAP_OF_ROUNDING = 0.01


def map_surface(launcher: Launcher, surface: Surface, origin: np.ndarray) -> tuple[TexelMap | VertexMap, tuple]:
    """Returns a receiver's texels, or its points where its texture coordinates cannot hold a picture, and warnings."""
    uvs, path = surface.mesh.uvs, surface.path
    instead = f"colours at its {surface.mesh.points_at(0.0).shape[0]} points are baked instead of a texture"
    if uvs is None:
        return VertexMap(launcher, surface, origin), (f"{path}: no texture coordinates; {instead}",)
    if not np.all(np.isfinite(uvs)):
        return VertexMap(launcher, surface, origin), (f"{path}: texture coordinates are not finite; {instead}",)
    texels = TexelMap(launcher, surface, origin)
    if texels.count == 0:
        return VertexMap(launcher, surface, origin), (f"{path}: texture coordinates cover no area; {instead}",)
    warnings = ()
    if surface.bake_fit is not None:
        reach = f"{path}: texture coordinates reach over {uvs.min():g}…{uvs.max():g}"
        if texels.overlapping > _OVERLAP_OF_ROUNDING * texels.count:
            warning = f"{reach} and overlap in {texels.overlapping} of {texels.count} texels; {instead}"
            return VertexMap(launcher, surface, origin), (warning,)
        warnings = (f"{reach}; the bake uses its own set within [0, 1], primvars:{BAKE_UVS}",)
    if texels.overlapping:
        warning = f"{path}: texture coordinates overlap in {texels.overlapping} of {texels.count} texels"
        warnings += (f"{warning}; these show only the first of the triangles there",)
    return texels, warnings


def usable_materials(surface: Surface, places: TexelMap | VertexMap) -> tuple[tuple[Material, ...], tuple]:
    """Returns a receiver's materials, without what its texture coordinates do not allow, and warnings."""
    usable, warnings = [], []
    for material in surface.materials:
        if places.uvs is None:
            material, missing = without_coordinates(material, surface.path)
            warnings += missing
        elif isinstance(places, VertexMap) and material.needs_tangents:
            warnings.append(f"{surface.path}: normals and heights of {material.path} are left out of colours at points")
            material = without_relief(material)
        usable.append(material)
    return tuple(usable), tuple(warnings)
