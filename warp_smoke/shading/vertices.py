"""The points of a receiver's mesh as bake locations, where its texture coordinates cannot hold a picture."""

import numpy as np
import warp as wp

from warp_smoke.geometry import normalized
from warp_smoke.launch import Launcher
from warp_smoke.scene import Surface
from warp_smoke.shading.placement import Placement, place_normals, place_points


class VertexMap:
    """The points of a mesh, with the interface of `TexelMap`; results are values at each point (`displayColor`).

    Attributes:
        count: number of points n.
        points: in set space, [n] vec3.
        normals: unit surface normals, [n] vec3: the mean of the mesh's normals around each point, or else the
            area-weighted mean of its faces; zero at a point without faces.
        shadow_points, facets: `points`, since facet corners lie on the smooth surface, and `normals`.
        tangents: one element; there are no tangent frames at points.
        uvs: texture coordinates of one of the corners at each point, [n, 2] float32 on the host, or None.
        material: index into the surface's materials, of a triangle at each point, [n] int32 on the host.
    """

    def __init__(self, launcher: Launcher, surface: Surface, origin: np.ndarray):
        mesh = surface.mesh
        self._surface, self._origin = surface, origin
        self._placement = Placement(surface)
        self.count = len(mesh.points_at(0.0))
        self.points = self.shadow_points = launcher.zeros(self.count, "bake", dtype=wp.vec3)
        self.normals = self.facets = launcher.zeros(self.count, "bake", dtype=wp.vec3)
        self.tangents = launcher.zeros(1, "bake", dtype=wp.vec4)
        self.uvs = None
        if mesh.uvs is not None and np.all(np.isfinite(mesh.uvs)):
            self.uvs = np.zeros((self.count, 2), np.float32)
            self.uvs[mesh.triangles] = mesh.uvs
        self.material = np.zeros(self.count, np.int32)
        self.material[mesh.triangles] = surface.material_of_triangle[:, None]

    def update(self, time: float) -> bool:
        """Moves points and normals to a time code; returns whether they moved."""
        if not self._placement.changed(time):
            return False
        normals = np.zeros((self.count, 3))
        triangles, corner_normals = self._surface.mesh.triangles, place_normals(self._surface, time, smooth=True)
        for corner in range(3):
            np.add.at(normals, triangles[:, corner], corner_normals[:, corner])
        self.points.assign(place_points(self._surface, self._origin, time))
        self.normals.assign(normalized(normals).astype(np.float32))
        return True

    def color_picture(self, name: str, colors: wp.array) -> np.ndarray:
        """Returns linear RGB at each point, [n, 3] float32; `name` is unused, since values at points need none."""
        return colors.numpy().copy()

    def linear_picture(self, name: str, colors: wp.array) -> np.ndarray:
        """Returns linear RGB at each point, [n, 3] float32."""
        return colors.numpy().copy()

    def direction_picture(self, directions: wp.array) -> np.ndarray:
        """Returns unit vectors at each point, [n, 3] float32."""
        return directions.numpy().copy()

    def share_picture(self, name: str, shares: wp.array) -> np.ndarray:
        """Returns shares 0…1 at each point, [n] float32."""
        return shares.numpy().copy()
