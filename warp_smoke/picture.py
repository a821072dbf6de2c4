"""The ray-cast picture of a scene: surfaces by the bakes' own shading, shadows by rays, smoke marched along rays.

It is what baked textures are checked against: at the same point it has the same value.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import warp as wp

from warp_smoke.files import write_png
from warp_smoke.geometry import transform_points
from warp_smoke.kernels import smoke_shadow_kernels
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, load_kernels
from warp_smoke.record import FieldError, value_at
from warp_smoke.scene import Light, Material, Scene, SmokeDomain
from warp_smoke.shading.light_source import light_source
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
from warp_smoke.shading.smoke_march import ScatteringSmoke, cell_centres, face_light, march_smoke, scatter_light
from warp_smoke.shading.srgb import make_srgb_table
from warp_smoke.shading.surface_points import SurfaceDetail, SurfacePoints, allocate_detail, look_up_detail
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.light_buffer import buffer_serves, set_to_cells
from warp_smoke.shadow.methods import SMOKE_SHADOWS
from warp_smoke.shadow.ray_traced import RayTracedShadow
from warp_smoke.usd.own_look import open_in_own_look
from warp_smoke.usd.read_volume import read_volumes

_KERNELS = ("shading.primary_rays", "shading.radiance", "shading.surface_points", "shadow.ray_traced")
SHADINGS = ("pixel", "vertex")
# Slices in a layer of the light buffer: smoke shadows itself, so that each slice counts.
_SLICES_IN_A_LAYER = 2
MAX_PIXELS = 2**26


@dataclass(frozen=True, eq=False)
class SmokeVolume:
    """Smoke at one time.

    Attributes:
        domain: gives its extinction and albedo.
        lattice: where its cells lie.
        density: [nx, ny, nz] float32 at cell centres.
    """

    domain: SmokeDomain
    lattice: Lattice
    density: np.ndarray


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
        self._lights = [_Shining(self, light, volumes) for light in lights]
        far_first = sorted(volumes, key=lambda each: -self._distance_to(each.lattice))
        smokes = [self._scattering(each) for each in far_first if each.domain.extinction and each.density.any()]
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

    def _scattering(self, volume: SmokeVolume) -> ScatteringSmoke:
        """The smoke's box with the light that arrives in it."""
        density, lattice = _cropped(volume.density, volume.lattice)
        launcher, domain = self._launcher, volume.domain
        to_cells = set_to_cells(lattice, self._origin)
        points = launcher.array(cell_centres(lattice.shape, np.linalg.inv(to_cells)), "smoke_light", dtype=wp.vec3)
        count = lattice.cells
        ambient = np.tile(np.float32(self._scene.ambient), (count, 1))
        smoke = ScatteringSmoke()
        smoke.density = launcher.array(density, "smoke_light")
        smoke.light = launcher.array(ambient, "smoke_light", dtype=wp.vec3)
        smoke.from_set = wp.mat44(to_cells.T.astype(np.float32))
        smoke.extinction = wp.vec3(*(domain.extinction * lattice.h * np.asarray(domain.extinction_color)))
        smoke.albedo, smoke.step = wp.vec3(*domain.albedo), 0.5
        facing = SurfacePoints()
        facing.positions, facing.normals = points, launcher.zeros(count, "smoke_light", dtype=wp.vec3)
        visibility = launcher.zeros(count, "smoke_light")
        for light in self._lights:
            if light.light.lights(domain.path):
                face_light(launcher, points, light.source, facing.normals)
                light.shadow(facing, visibility)
                scatter_light(launcher, points, light.source, visibility, light.through(points), smoke.light)
        return smoke

    def _distance_to(self, lattice: Lattice) -> float:
        middle = transform_points(lattice.cells_to_world(), np.asarray(lattice.shape) / 2)
        return float(np.linalg.norm(middle - self._scene.camera.transform_at(self._time)[3, :3]))


@dataclass(frozen=True)
class _Corners:
    """Light at the corners of triangles, [3 m] vec3: of each source, and without any."""

    radiance: list[wp.array]
    unlit: wp.array


class _Shining:
    """A light of the picture with its shadows."""

    def __init__(self, renderer: PictureRenderer, light: Light, volumes: Sequence[SmokeVolume]):
        launcher, time, origin = renderer._launcher, renderer._time, renderer._origin
        self._launcher, self.light = launcher, light
        self.source = light_source(light, origin, time)
        takes = [
            (light.lights(s.path), *((s.receiver.receive_shadow, s.receiver.receive_smoke) if s.receiver else (1, 1)))
            for s in renderer._scene.surfaces
        ]
        self.takes = launcher.array(np.array(takes or [(1, 1, 1)], np.float32), "picture", dtype=wp.vec3)
        self._shadow = None
        casters = renderer._casters[light.shadowed_by]
        if light.shadow_enable and len(casters.surface_of_triangle):
            exact = replace(light, shadow_filter="area" if light.shadow_filter == "area" else "exact")
            bounds = np.stack([casters.lower, casters.upper])
            self._shadow = RayTracedShadow(launcher, exact, casters, bounds)
            self._shadow.update(time)
        self._smoke, self._channels = [], 1
        for each in volumes:
            if light.shadow_enable and each.domain.dims_light and light.may_be_shadowed_by(each.domain.path):
                self._smoke.append(_smoke_shadow(launcher, light, each, origin, time))
                self._channels = max(self._channels, 3 if each.domain.colors_light else 1)
        self._through: dict[int, wp.array] = {}

    def shadow(self, points: SurfacePoints, visibility_out: wp.array) -> None:
        """Writes the share of the light that passes surfaces."""
        if self._shadow is None:
            visibility_out.fill_(1.0)
        else:
            self._shadow.visibility(points.positions, points.normals, visibility_out)

    def through(self, positions: wp.array) -> wp.array:
        """The share of the light that passes smoke, [1 or 3, n]."""
        count = len(positions)
        if count not in self._through:
            self._through[count] = self._launcher.zeros((self._channels, count), "picture")
        share = self._through[count]
        share.fill_(1.0)
        for each in self._smoke:
            each.transmittance(positions, share)
        return share


def _smoke_shadow(launcher: Launcher, light: Light, volume: SmokeVolume, origin: np.ndarray, time: float):
    domain = volume.domain
    method = light.smoke_shadow if buffer_serves(light, volume.lattice, [time]) else "ray_traced"
    light = replace(light, smoke_shadow=method, smoke_shadow_layer=light.smoke_shadow_layer or _SLICES_IN_A_LAYER)
    make = SMOKE_SHADOWS[method]
    shadow = make(launcher, volume.lattice, light, origin, domain.extinction, domain.extinction_color)
    shadow.update(launcher.array(np.ascontiguousarray(volume.density), "smoke_light"), time)
    return shadow


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


def _cropped(density: np.ndarray, lattice: Lattice) -> tuple[np.ndarray, Lattice]:
    """The box of cells with smoke, and one more around them as far as there are any."""
    box = []
    for axis, size in enumerate(density.shape):
        busy = np.flatnonzero(density.any(axis=tuple({0, 1, 2} - {axis})))
        box.append((max(busy[0] - 1, 0), min(busy[-1] + 2, size)))
    lower = np.array([first for first, _ in box])
    to_world = np.array(lattice.to_world)
    to_world[3, :3] += lattice.voxel_size * lower @ lattice.axes
    cropped = np.ascontiguousarray(density[tuple(slice(*each) for each in box)])
    return cropped, replace(lattice, shape=cropped.shape, to_world=to_world)


def render_kernels(scene: Scene, volumes: Sequence[SmokeVolume]) -> list[str]:
    """Names of the kernel modules that a picture needs."""
    names = set(_KERNELS)
    if volumes:
        names.add("shading.smoke_march")
        names |= {name for light in scene.lights for name in smoke_shadow_kernels(light.smoke_shadow)}
    return [f"warp_smoke.{name}" for name in sorted(names)]


def render_picture(
    scene: Scene,
    time: float,
    volumes: Sequence[SmokeVolume] = (),
    *,
    size: tuple[int, int] = (640, 360),
    samples: int = 1,
    shading: str = "pixel",
    device: str = "cpu",
    threads: int | None = None,
) -> np.ndarray:
    """A picture of a scene through its camera.

    Args:
        scene: the scene.
        time: time code.
        volumes: the smoke at that time.
        size: width and height [pixels].
        samples: along each side of a pixel: samples² rays.
        shading: light for each `pixel` or each `vertex`.
        device: `cpu`, `cuda` or `cuda:N`.
        threads: CPU threads; all unless given.

    Returns:
        sRGB [height, width, 3] uint8, first row at the top.

    Raises:
        ValueError: the scene has no camera, a texture cannot be read, or a number is not allowed.
    """
    launcher = Launcher(device, threads)
    renderer = PictureRenderer(launcher, scene, *size, samples=samples, shading=shading)
    load_kernels(render_kernels(scene, volumes), device)
    return renderer.render(time, volumes)


def render(
    path: str | Path,
    output: str | Path,
    *,
    frame: int | None = None,
    size: tuple[int, int] = (640, 360),
    samples: int = 2,
    shading: str = "pixel",
    device: str = "cpu",
    threads: int | None = None,
) -> Path:
    """Writes a picture of a stage, or of the results in a folder, through the stage's camera.

    Smoke that a run has written is read from its files; that of any other stage is simulated up to the frame.

    Args:
        path: a USD stage, or a folder written by `run`.
        output: the `.png` file.
        frame: the frame; the middle one unless given.
        size: width and height [pixels].
        samples: along each side of a pixel: samples² rays.
        shading: light for each `pixel` or each `vertex`.
        device: `cpu`, `cuda` or `cuda:N`.
        threads: CPU threads; all unless given.

    Returns:
        The file.

    Raises:
        ValueError: the stage or one of its files is damaged, has no camera, or a number is not allowed.
        OSError: a file cannot be read or written.
    """
    if Path(output).suffix.lower() != ".png":
        raise ValueError(f"output is {output}; allowed: a name that ends in .png")
    stage, scene = open_in_own_look(path)
    if frame is None:
        frame = (scene.start + scene.end) // 2
    launcher = Launcher(device, threads)
    renderer = PictureRenderer(launcher, scene, *size, samples=samples, shading=shading)
    volumes = [SmokeVolume(*each) for each in read_volumes(stage, scene, frame)]
    if not volumes and scene.domains:
        volumes = simulate_smoke(scene, frame, device, threads)
    load_kernels(render_kernels(scene, volumes), device)
    write_png(Path(output), renderer.render(frame, volumes))
    return Path(output)


def simulate_smoke(scene: Scene, frame: int, device: str = "cpu", threads: int | None = None) -> list[SmokeVolume]:
    """The smoke of a scene at a frame, by its fluid alone.

    Raises:
        ValueError: the frame is none of the scene's, or the device cannot hold the smoke.
    """
    from warp_smoke.simulation import Simulation

    if frame not in scene.frames:
        raise ValueError(f"frame is {frame}; allowed: {scene.start}…{scene.end}")
    surfaces = [replace(surface, receiver=None) for surface in scene.surfaces]
    domains = [replace(domain, grids=("density",)) for domain in scene.domains]
    simulation = Simulation(replace(scene, surfaces=surfaces, domains=domains), device=device, threads=threads)
    made = None
    while simulation.plan.domains and simulation.frame != frame:
        made = simulation.step()
    return [
        SmokeVolume(each.domain, each.lattice, made.smoke[each.domain.path].density) for each in simulation.plan.domains
    ]
