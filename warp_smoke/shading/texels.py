"""The texels of a receiver's texture, as points on its surface."""

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Surface
from warp_smoke.shading.placement import Placement, place_normals, place_points
from warp_smoke.shading.shadow_terminator import Facet, facet_normal, lifted_point
from warp_smoke.shading.tangents import corner_tangents
from warp_smoke.shading.texel_picture import Change, TexelPicture, spread_texels
from warp_smoke.shading.uv_raster import cover_texels

wp.set_module_options({"enable_backward": False})


class TexelMap:
    """The texels that show a surface with texture coordinates.

    A texel belongs to the triangle under its centre; one whose square only overlaps a chart represents the chart's
    nearest point. Texture coordinates outside [0, 1] are fitted into it. Pictures have their first row at the top
    (v = 1).

    Attributes:
        count: number of texels n.
        size: texels along a side of the picture.
        points: in set space, [n] vec3.
        normals: unit surface normals, [n] vec3.
        shadow_points: where shadows of surfaces are looked up (see `shadow_terminator`), [n] vec3; `points` themselves
            unless the mesh is smooth.
        facets: unit normals of the triangles, [n] vec3; `normals` themselves unless the mesh is smooth.
        tangents: tangents and signs, [n] vec4 (see `tangents`); one element if none of its materials needs them.
        uvs: the surface's own texture coordinates, [n, 2] float32 on the host.
        material: index into the surface's materials, [n] int32 on the host.
        picture: encodes values at the texels as pictures.
        overlapping: number of texels that several triangles share; they show the first.
    """

    def __init__(self, launcher: Launcher, surface: Surface, origin: np.ndarray):
        mesh = surface.mesh
        self._launcher, self._surface, self._origin = launcher, surface, origin
        self._placement = Placement(surface)
        self.size = surface.receiver.texture_size
        coverage = cover_texels(surface.bake_uvs, self.size)
        self.count, self.overlapping = len(coverage.texel), coverage.overlapping
        weights = coverage.weights.astype(np.float32)
        a, b, c = mesh.uvs[coverage.triangle].transpose(1, 0, 2)
        self.uvs = a + weights[:, :1] * (b - a) + weights[:, 1:] * (c - a)

        self._triangle = launcher.array(coverage.triangle.astype(np.int32), "bake")
        self._weights = launcher.array(weights, "bake", dtype=wp.vec2)
        self._corners = launcher.array(mesh.triangles.astype(np.int32), "bake", dtype=wp.vec3i)
        self._mesh_points = launcher.zeros(len(mesh.points_at(0.0)), "bake", dtype=wp.vec3)
        self._corner_normals = launcher.zeros((len(mesh.triangles), 3), "bake", dtype=wp.vec3)
        self.points = launcher.zeros(self.count, "bake", dtype=wp.vec3)
        self.normals = launcher.zeros(self.count, "bake", dtype=wp.vec3)
        self.shadow_points, self.facets = self.points, self.normals
        if mesh.is_smooth:
            self.shadow_points = launcher.zeros(self.count, "bake", dtype=wp.vec3)
            self.facets = launcher.zeros(self.count, "bake", dtype=wp.vec3)
        self.material = surface.material_of_triangle[coverage.triangle]
        self._needs_tangents = any(material.needs_tangents for material in surface.materials)
        self._corner_tangents = launcher.zeros((self._rows(len(mesh.triangles)), 3), "bake", dtype=wp.vec4)
        self.tangents = launcher.zeros(self._rows(self.count), "bake", dtype=wp.vec4)
        source = spread_texels(coverage.texel, self.size)
        self.picture = TexelPicture(launcher, source, surface.receiver.texture_bits)

    def _rows(self, count: int) -> int:
        return count if self._needs_tangents else 1

    def update(self, time: float) -> bool:
        """Moves points and normals to a time code; returns whether they moved."""
        if not self._placement.changed(time):
            return False
        points, normals = place_points(self._surface, self._origin, time), place_normals(self._surface, time)
        self._mesh_points.assign(points)
        self._corner_normals.assign(normals)
        place = (self._triangle, self._weights, self._corners, self._mesh_points, self._corner_normals)
        self._launcher.launch_each(_place_texels, self.count, *place, self.points, self.normals)
        if self._surface.mesh.is_smooth:
            args = (*place, self.points, self.normals, self.shadow_points, self.facets)
            self._launcher.launch_each(_lift_texels, self.count, *args)
        if self._needs_tangents:
            mesh = self._surface.mesh
            self._corner_tangents.assign(corner_tangents(points, mesh.triangles, normals, mesh.uvs))
            args = (self._triangle, self._weights, self._corner_tangents, self.tangents)
            self._launcher.launch_each(_place_tangents, self.count, *args)
        return True

    def color_picture(self, name: str, colors: wp.array, change: Change | None = None) -> np.ndarray:
        """Encodes linear RGB of texels, vec3, as an sRGB picture, [size, size, 3]; gaps show the nearest texel.

        Args:
            name: of the picture, which keeps what does not change.
            colors: of all n texels, or of those in `change`.
            change: the texels that change; all unless given.
        """
        return self._squared(self.picture.colors(name, colors, change or self.picture.whole))

    def linear_picture(self, name: str, colors: wp.array, change: Change | None = None) -> np.ndarray:
        """Encodes linear RGB of texels, vec3, as raw codes, [size, size, 3] uint16; otherwise as `color_picture`."""
        return self._squared(self.picture.linear(name, colors, change or self.picture.whole))

    def share_picture(self, name: str, shares: wp.array, change: Change | None = None) -> np.ndarray:
        """Encodes shares 0…1 of texels, float, as raw codes, [size, size]; otherwise as `color_picture`."""
        return self._squared(self.picture.shares(name, shares, change or self.picture.whole))

    def direction_picture(self, directions: wp.array) -> np.ndarray:
        """Encodes unit vectors of all texels, [n] vec3, as ½ (n + 1), [size, size, 3]; otherwise as `color_picture`."""
        return self._squared(self.picture.directions(directions))

    def _squared(self, codes: np.ndarray) -> np.ndarray:
        return codes.reshape(self.size, self.size, *codes.shape[1:]).copy()


@wp.kernel
def _place_texels(
    rows: Rows,
    triangle: wp.array[int],
    weights: wp.array[wp.vec2],
    corners: wp.array[wp.vec3i],
    mesh_points: wp.array[wp.vec3],
    corner_normals: wp.array2d[wp.vec3],
    points_out: wp.array[wp.vec3],
    normals_out: wp.array[wp.vec3],
):
    """points[s] = p₀ + w₁ (p₁ − p₀) + w₂ (p₂ − p₀), exact where all three are equal; normals likewise, normalized."""
    s = rows.first + wp.tid()
    t = triangle[s]
    w = weights[s]
    c = corners[t]
    p = mesh_points[c[0]]
    n = corner_normals[t, 0]
    points_out[s] = p + w[0] * (mesh_points[c[1]] - p) + w[1] * (mesh_points[c[2]] - p)
    normals_out[s] = wp.normalize(n + w[0] * (corner_normals[t, 1] - n) + w[1] * (corner_normals[t, 2] - n))


@wp.kernel
def _lift_texels(
    rows: Rows,
    triangle: wp.array[int],
    weights: wp.array[wp.vec2],
    corners: wp.array[wp.vec3i],
    mesh_points: wp.array[wp.vec3],
    corner_normals: wp.array2d[wp.vec3],
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    shadow_points_out: wp.array[wp.vec3],
    facets_out: wp.array[wp.vec3],
):
    """shadow_points[s] = points[s] lifted towards the tangent planes at the corners of its triangle."""
    s = rows.first + wp.tid()
    t = triangle[s]
    w = weights[s]
    c = corners[t]
    f = Facet(
        mesh_points[c[0]],
        mesh_points[c[1]],
        mesh_points[c[2]],
        corner_normals[t, 0],
        corner_normals[t, 1],
        corner_normals[t, 2],
    )
    shadow_points_out[s] = lifted_point(f, points[s], wp.vec3(1.0 - w[0] - w[1], w[0], w[1]))
    facets_out[s] = facet_normal(f, normals[s])


@wp.kernel
def _place_tangents(
    rows: Rows,
    triangle: wp.array[int],
    weights: wp.array[wp.vec2],
    corner_tangents: wp.array2d[wp.vec4],
    tangents_out: wp.array[wp.vec4],
):
    """tangents[s] = t₀ + w₁ (t₁ − t₀) + w₂ (t₂ − t₀), with the sign of the triangle's own corner."""
    s = rows.first + wp.tid()
    i = triangle[s]
    w = weights[s]
    t = corner_tangents[i, 0]
    tangents_out[s] = t + w[0] * (corner_tangents[i, 1] - t) + w[1] * (corner_tangents[i, 2] - t)
