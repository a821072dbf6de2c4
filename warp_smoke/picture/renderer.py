"""One camera's pictures of a scene, frame after frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_smoke.geometry import transform_points
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher
from warp_smoke.picture.light import PictureLight
from warp_smoke.picture.smoke import scattering_smoke
from warp_smoke.picture.smoke_volume import SmokeVolume
from warp_smoke.record import FieldError, value_at
from warp_smoke.scene import Material, Scene
from warp_smoke.shading.looks import make_looks, without_pictures
from warp_smoke.shading.primary_rays import (
    Dressing,
    Hits,
    add_light,
    add_sample,
    camera_view,
    cast_rays,
    encode_picture,
    interpolate_corners,
    show_background,
    triangle_table,
)
from warp_smoke.shading.radiance import shade_light
from warp_smoke.shading.smoke_march import march_smoke
from warp_smoke.shading.srgb import make_srgb_table
from warp_smoke.shading.surface_points import SurfaceDetail, SurfacePoints, allocate_detail, look_up_detail
from warp_smoke.shadow.casters import Casters

SHADINGS = ("pixel", "vertex")
MAX_PIXELS = 2**26


class PictureRenderer:
    """Renders a scene through its camera."""

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
        """Reads the materials' pictures and allocates the picture.

        Args:
            launcher: where to compute.
            scene: the scene, with a camera.
            width: of the picture [pixels].
            height: of the picture [pixels].
            samples: along each side of a pixel: samples² rays.
            shading: light for each pixel (Phong) or each corner of a triangle (Gouraud).

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
        self._width, self._height, self._count = width, height, width * height
        self._dressing = _dress(scene)
        self._looks = make_looks(launcher, self._dressing.materials)
        count, zeros = self._count, launcher.zeros
        self._points = self._allocate_points(count)
        self._detail = self._allocate_detail(count)
        self._hits = Hits()
        self._hits.triangle = zeros(count, "picture", dtype=int)
        self._hits.weights = zeros(count, "picture", dtype=wp.vec2)
        self._hits.distance = zeros(count, "picture")
        self._color, self._radiance, self._mean = (zeros(count, "picture", dtype=wp.vec3) for _ in range(3))
        self._visibility = zeros(count, "picture")
        self._codes = zeros((count, 3), "picture", dtype=wp.uint8)
        self._srgb = make_srgb_table(launcher)

    def _allocate_points(self, count: int) -> SurfacePoints:
        zeros = self._launcher.zeros
        points = SurfacePoints()
        points.positions = zeros(count, "picture", dtype=wp.vec3)
        points.normals = zeros(count, "picture", dtype=wp.vec3)
        points.tangents = zeros(count if self._dressing.needs_tangents else 1, "picture", dtype=wp.vec4)
        points.uvs = zeros(count, "picture", dtype=wp.vec2)
        points.material = zeros(count, "picture", dtype=int)
        return points

    def _allocate_detail(self, count: int) -> SurfaceDetail:
        return allocate_detail(self._launcher, count, "picture", self._dressing.materials)

    def render(self, time: float, volumes: Sequence[SmokeVolume] = ()) -> np.ndarray:
        """The picture at a time code, sRGB [height, width, 3] uint8, first row at the top.

        Args:
            time: time code.
            volumes: the smoke at that time; none of it may overlap.
        """
        scene, launcher, count = self._scene, self._launcher, self._count
        self._time = time
        self._origin = _middle(scene, volumes, time)
        self._place_casters()
        self._view = camera_view(scene.camera, self._origin, time, self._width, self._height)
        eye = self._view.eye
        self._eye = wp.vec4(eye[0], eye[1], eye[2], 1.0)
        lights = [light for light in scene.lights if light.shines and value_at(light.enabled, time)]
        placed = (volumes, self._origin, time)
        self._lights = [
            PictureLight(launcher, light, scene.surfaces, self._casters[light.shadowed_by], *placed) for light in lights
        ]
        far_first = sorted(volumes, key=lambda each: -self._distance_to(each.lattice))
        smoky = [each for each in far_first if each.domain.extinction and each.density.any()]
        lit = (self._lights, scene.ambient, self._origin, time)
        smokes = [scattering_smoke(launcher, each, *lit) for each in smoky]
        corners = self._shade_corners() if self._shading == "vertex" else None
        places = [(n + 0.5) / self._samples for n in range(self._samples)]
        self._mean.zero_()
        for y in places:
            for x in places:
                self._cast(x, y, corners)
                for smoke in smokes:
                    march_smoke(launcher, count, smoke, self._view, (x, y), self._hits.distance, self._color)
                add_sample(launcher, count, self._color, 1.0 / self._samples**2, self._mean)
        encode_picture(launcher, count, self._mean, self._srgb, self._codes)
        return self._codes.numpy().reshape(self._height, self._width, 3).copy()

    def _place_casters(self) -> None:
        """The triangles that rays meet: all visible ones, and for light linking those that shadow a light."""
        scene, launcher = self._scene, self._launcher
        self._casters = {}
        for linked in {None, *(light.shadowed_by for light in scene.lights)}:
            surfaces = tuple(s for s in scene.surfaces if linked is None or s.path in linked)
            self._casters[linked] = Casters(launcher, surfaces, self._origin)
            self._casters[linked].update(self._time)
        order = self._casters[None].surface_of_triangle
        self._table = triangle_table(launcher, scene.surfaces, order, self._dressing, self._origin, self._time)

    def _cast(self, x: float, y: float, corners: "_Corners | None") -> None:
        """One sample of each pixel: the light of the surfaces that its ray meets."""
        launcher, count = self._launcher, self._count
        mesh = self._casters[None].mesh.id
        cast_rays(launcher, count, mesh, self._looks, self._view, x, y, self._table, self._points, self._hits)
        ambient = wp.vec3(*self._scene.ambient)
        if corners is None:
            look_up_detail(launcher, count, self._looks, self._points, self._eye, ambient, self._detail)
            self._color.assign(self._detail.unlit)
        else:
            interpolate_corners(launcher, count, self._hits, corners.unlit, ambient, self._color)
        for index, light in enumerate(self._lights):
            if corners is None:
                args = (self._looks, self._points, self._detail, self._eye, self._radiance)
                shade_light(launcher, count, light.source, *args)
            else:
                args = (self._hits, corners.radiance[index], wp.vec3(0.0), self._radiance)
                interpolate_corners(launcher, count, *args)
            light.shadow(self._points, self._visibility)
            args = (self._radiance, self._visibility, light.through(self._points.positions))
            places = (self._hits.triangle, self._table.surface, light.takes, self._color)
            add_light(launcher, count, *args, *places)
        show_background(launcher, count, self._hits.triangle, ambient, self._color)

    def _shade_corners(self) -> "_Corners":
        """Unshadowed light at the corners of all triangles."""
        launcher, mesh = self._launcher, self._casters[None].mesh
        count = len(mesh.points)
        points = self._allocate_points(count)
        points.positions = mesh.points
        for name in ("normals", "uvs", "tangents"):
            values = getattr(self._table, name)
            if values.shape[0] * 3 == count:
                getattr(points, name).assign(values.flatten())
        points.material.assign(np.repeat(self._table.material.numpy(), 3))
        detail = self._allocate_detail(count)
        ambient = wp.vec3(*self._scene.ambient)
        look_up_detail(launcher, count, self._looks, points, self._eye, ambient, detail)
        lit = [launcher.zeros(count, "picture", dtype=wp.vec3) for _ in self._lights]
        for light, radiance in zip(self._lights, lit, strict=True):
            shade_light(launcher, count, light.source, self._looks, points, detail, self._eye, radiance)
        return _Corners(lit, detail.unlit)

    def _distance_to(self, lattice: Lattice) -> float:
        middle = transform_points(lattice.cells_to_world(), np.asarray(lattice.shape) / 2)
        return float(np.linalg.norm(middle - self._scene.camera.transform_at(self._time)[3, :3]))


@dataclass(frozen=True)
class _Corners:
    """Light at the corners of triangles, [3 m] vec3: of each source, and without any."""

    radiance: list[wp.array]
    unlit: wp.array


def _dress(scene: Scene) -> Dressing:
    """The materials of a scene's surfaces; without their pictures where there are no texture coordinates."""
    materials, index = [Material()], []
    for surface in scene.surfaces:
        places = []
        for material in surface.materials:
            if surface.mesh.uvs is None and material.has_pictures:
                material = without_pictures(material)
            if material not in materials:
                materials.append(material)
            places.append(materials.index(material))
        index.append(np.asarray(places, np.int32)[surface.material_of_triangle])
    return Dressing(tuple(materials), tuple(index))


def _middle(scene: Scene, volumes: Sequence[SmokeVolume], time: float) -> np.ndarray:
    """Origin of set space: the middle of what is visible."""
    visible = [s for s in scene.surfaces if value_at(s.visible, time) and len(s.mesh.triangles)]
    corners = [transform_points(s.transform_at(time), s.mesh.points_at(time)) for s in visible]
    corners += [transform_points(v.lattice.cells_to_world(), [np.zeros(3), v.lattice.shape]) for v in volumes]
    if not corners:
        return np.zeros(3)
    points = np.concatenate(corners)
    return 0.5 * (points.min(axis=0) + points.max(axis=0))
