"""Pictures of a scene through one camera, frame after frame."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warp_smoke.geometry import transform_points
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher
from warp_smoke.picture.light import PictureLight
from warp_smoke.picture.smoke import scattering_smoke
from warp_smoke.picture.smoke_volume import SmokeVolume
from warp_smoke.picture.tile import CornerLight, PlacedSet, Tile
from warp_smoke.record import FieldError, value_at
from warp_smoke.scene import Scene, Surface
from warp_smoke.shading.looks import make_looks
from warp_smoke.shading.radiance import shade_light
from warp_smoke.shading.srgb import make_srgb_table
from warp_smoke.shading.surface_points import allocate_detail, allocate_points, look_up_detail
from warp_smoke.shading.triangle_table import TriangleTable, dress_surfaces, triangle_table
from warp_smoke.shading.view import camera_view
from warp_smoke.shadow.casters import Casters

SHADINGS = ("pixel", "vertex")
MAX_PIXELS = 2**26
# Pixels that are rendered together: their data stays in the processor's cache, and costly rows, such as those of a
# floor in relief, are shared among its threads.
_TILE_PIXELS = 2**15


class PictureRenderer:
    """Renders a scene through its camera.

    Attributes:
        warnings: what in the scene cannot be shown as it is.
    """

    def __init__(
        self,
        launcher: Launcher,
        scene: Scene,
        width: int,
        height: int,
        *,
        samples: int = 1,
        shading: str = "pixel",
    ):
        """Prepares the materials and reads their textures.

        Args:
            launcher: where to compute.
            scene: the scene, with a camera.
            width: of the picture [pixels].
            height: of the picture [pixels].
            samples: along each side of a pixel: samples² rays.
            shading: light per pixel (Phong) or per corner of a triangle (Gouraud).

        Raises:
            ValueError: there is no camera, a number is not allowed, or a texture cannot be read.
        """
        if scene.camera is None:
            raise FieldError(str(scene.source or "scene"), "camera", None, "a UsdGeomCamera, to render through")
        if not (width >= 1 and height >= 1 and width * height <= MAX_PIXELS):
            raise ValueError(f"size is {width}x{height}; allowed: 1x1 to {MAX_PIXELS} pixels")
        if not 1 <= samples <= 64:
            raise ValueError(f"samples is {samples}; allowed: 1 to 64")
        if shading not in SHADINGS:
            raise ValueError(f"shading is {shading}; allowed: {', '.join(SHADINGS)}")
        self._launcher, self._scene, self._samples, self._shading = launcher, scene, samples, shading
        self._width, self._height = width, height
        self._dressing = dress_surfaces(scene.surfaces)
        self.warnings = (*scene.warnings, *self._dressing.warnings)
        self._looks = make_looks(launcher, self._dressing.materials)
        self._tile: Tile | None = None

    def render(self, time: float, volumes: Sequence[SmokeVolume] = ()) -> np.ndarray:
        """Renders the picture at a time code, sRGB [height, width, 3] uint8, first row at the top.

        Args:
            time: time code.
            volumes: the smoke at that time; volumes must not overlap.
        """
        scene = self._scene
        total = self._width * self._height
        origin = _middle(scene, volumes, time)
        placed = self._place(volumes, origin, time)
        count = -(-total // -(-total // _TILE_PIXELS))  # tiles of one size
        if self._tile is None:
            self._tile = Tile(self._launcher, count, self._dressing, make_srgb_table(self._launcher))
        picture = np.empty((total, 3), np.uint8)
        for first in range(0, total, count):
            view = camera_view(scene.camera, origin, time, self._width, self._height, first)
            picture[first : first + count] = self._tile.render(placed, view, self._samples)[: total - first]
        return picture.reshape(self._height, self._width, 3)

    def _place(self, volumes: Sequence[SmokeVolume], origin: np.ndarray, time: float) -> PlacedSet:
        """Places the set at a time code, with the light of its smoke and, for Gouraud shading, of its corners."""
        scene, launcher = self._scene, self._launcher
        seen, casters = self._place_casters(origin, time)
        order = seen.surface_of_triangle
        table = triangle_table(launcher, scene.surfaces, order, self._dressing, origin, time)
        lights = [
            PictureLight(launcher, light, scene.surfaces, casters[light.path], volumes, origin, time)
            for light in scene.lights
            if light.shines and value_at(light.enabled, time)
        ]
        eye = scene.camera.transform_at(time)[3, :3]
        far_first = sorted(volumes, key=lambda each: -np.linalg.norm(_center(each.lattice) - eye))
        smoky = [each for each in far_first if each.domain.extinction and each.density.any()]
        smokes = [scattering_smoke(launcher, each, lights, scene.ambient, origin, time) for each in smoky]
        place = wp.vec4(*(eye - origin), 1.0)
        corners = self._shade_corners(seen, table, lights, place) if self._shading == "vertex" else None
        ambient = wp.vec3(*scene.ambient)
        return PlacedSet(seen.mesh, table, self._looks, lights, smokes, corners, place, ambient)

    def _place_casters(self, origin: np.ndarray, time: float) -> tuple[Casters, dict[str, Casters]]:
        """Returns all visible triangles, which camera rays hit, and for each light those that block it."""
        scene, placed = self._scene, {}

        def place(surfaces: Sequence[Surface]) -> Casters:
            paths = tuple(surface.path for surface in surfaces)
            if paths not in placed:
                placed[paths] = Casters(self._launcher, surfaces, origin)
                placed[paths].update(time)
            return placed[paths]

        return place(scene.surfaces), {light.path: place(scene.shadowing(light)) for light in scene.lights}

    def _shade_corners(
        self, casters: Casters, table: TriangleTable, lights: Sequence[PictureLight], eye: wp.vec4
    ) -> CornerLight:
        """Computes unshadowed light at the corners of all triangles."""
        launcher, mesh, materials = self._launcher, casters.mesh, self._dressing.materials
        count = len(mesh.points)
        points = allocate_points(launcher, count, "picture", self._dressing.needs_tangents)
        points.positions = mesh.points
        for name in ("normals", "uvs", "tangents"):
            values = getattr(table, name)
            if values.shape[0] * 3 == count:
                getattr(points, name).assign(values.flatten())
        points.material.assign(np.repeat(table.material.numpy(), 3))
        detail = allocate_detail(launcher, count, "picture", materials)
        look_up_detail(launcher, count, self._looks, points, eye, wp.vec3(*self._scene.ambient), detail)
        lit = [launcher.zeros(count, "picture", dtype=wp.vec3) for _ in lights]
        for light, radiance in zip(lights, lit, strict=True):
            shade_light(launcher, count, light.source, self._looks, points, detail, eye, radiance)
        return CornerLight(lit, detail.unlit)


def _center(lattice: Lattice) -> np.ndarray:
    """Returns the world position of a lattice's middle, [3]."""
    return transform_points(lattice.cells_to_world(), np.asarray(lattice.shape) / 2)


def _middle(scene: Scene, volumes: Sequence[SmokeVolume], time: float) -> np.ndarray:
    """Returns the origin of set space: the middle of everything visible."""
    visible = [s for s in scene.surfaces if value_at(s.visible, time) and len(s.mesh.triangles)]
    corners = [transform_points(s.transform_at(time), s.mesh.points_at(time)) for s in visible]
    corners += [transform_points(v.lattice.cells_to_world(), [np.zeros(3), v.lattice.shape]) for v in volumes]
    if not corners:
        return np.zeros(3)
    points = np.concatenate(corners)
    return 0.5 * (points.min(axis=0) + points.max(axis=0))
