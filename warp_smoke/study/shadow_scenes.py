"""Scenes for measuring surface shadows: a ball and the Stanford bunny on a plane, and an edge, with known truth."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import warp as wp
import warp.examples

from warp_smoke.geometry import Mesh, corner_normals, normalized
from warp_smoke.launch import Launcher
from warp_smoke.scene import DistantLight, Light, PointLight, Scene, Surface
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.ray_traced import RayTracedShadow
from warp_smoke.study.light_answers import edge_penumbra, sphere_shadow_radius
from warp_smoke.study.smoke_plume import at

FLOOR = Mesh.grid((-4, 0, 4), (8, 0, 0), (0, 0, -8))
_ON_FLOOR = np.array([[-4.0, 0.0, -4.0], [4.0, 0.0, 4.0]])
FLOOR_POINTS = 192  # along a side
_ON_BUNNY = 20_000
# A point counts as well lit (or well shadowed) if all (or none) of a ball of this radius around the light is seen.
_CLEAR_OF_EDGES = 0.1
_TRUE_RAYS = 256


@dataclass(frozen=True, eq=False)
class ShadowScene:
    """Casters, a light, points that receive its shadow, and the light that they should get.

    Attributes:
        casters: what casts the shadow.
        light: each measurement sets its filter.
        bounds: lower and upper corner of all points, [2, 3].
        points, normals: on the device, [n] vec3.
        areas: area that each point stands for, zero where it faces away from the light, [n].
        truth: share of the light that each point should get, [n].
        lit, shadowed: whether a point is well lit or well shadowed, clear of the shadow's edge, [n].
    """

    casters: Casters
    light: Light
    bounds: np.ndarray
    points: wp.array
    normals: wp.array
    areas: np.ndarray
    truth: np.ndarray
    lit: np.ndarray
    shadowed: np.ndarray


def bunny() -> Mesh:
    """Returns the Stanford bunny of Warp's examples, about 1.6 units tall, standing on y = 0."""
    return Scene.open(Path(warp.examples.get_asset_directory()) / "bunny.usd").surfaces[0].mesh


def sample_mesh(mesh: Mesh, count: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Returns points spread evenly over a mesh, their face normals, [n, 3] each, and the mesh's area."""
    rng = np.random.default_rng(0)
    corners = mesh.points_at(1.0).astype(np.float64)[mesh.triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    triangle = rng.choice(len(area), count, p=area / area.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    normals = corner_normals(mesh.points_at(1.0), mesh.triangles)[triangle, 0]
    return np.sum(weights[:, :, None] * corners[triangle], axis=1), normals, float(area.sum())


def shine(direction: tuple[float, float, float]) -> np.ndarray:
    """Returns a transform whose −Z axis points along a direction."""
    z = -normalized(np.array([direction], np.float64))[0]
    x = normalized(np.cross([np.eye(3)[np.argmin(np.abs(z))]], z))[0]
    matrix = np.eye(4)
    matrix[:3, :3] = x, np.cross(z, x), z
    return matrix


@cache
def sphere_scene(device: str) -> ShadowScene:
    """A ball under a point light: its shadow on the plane is a disk."""
    height, radius, below = 3.0, 0.5, 2.0
    light = PointLight(path="/Light", transform=at(0, height, 0), shadow_filter="hard")
    places = _floor(2.0)
    edge = sphere_shadow_radius(height, below, radius)
    truth = (np.hypot(places[:, 0], places[:, 2]) > edge).astype(float)
    meshes = [(Mesh.sphere(radius, segments=256), at(0, height - below, 0)), (FLOOR, np.eye(4))]
    return _scene(device, meshes, light, places, np.tile([0.0, 1.0, 0.0], (len(places), 1)), 16.0, truth)


@cache
def edge_scene(device: str) -> ShadowScene:
    """A half plane midway between a spherical light and the floor: a penumbra of known profile."""
    light = PointLight(path="/Light", transform=at(0, 3, 0), radius=0.2)
    places = _floor(0.4)
    truth = edge_penumbra(places, np.array([0.0, 3.0, 0.0]), light.radius, 1.5)
    half = Mesh.grid((-50, 1.5, 50), (50, 0, 0), (0, 0, -100))
    return _scene(device, [(half, np.eye(4))], light, places, np.tile([0.0, 1.0, 0.0], (len(places), 1)), 0.64, truth)


@cache
def bunny_scene(device: str, kind: str) -> ShadowScene:
    """The bunny on a plane under a light: `point` or `distant`, against exact rays, or `soft`, against area rays."""
    light: Light = PointLight(path="/Light", transform=at(1.5, 3.0, 1.2), radius=0.15 if kind == "soft" else 0.05)
    if kind == "distant":
        light = DistantLight(path="/Light", transform=shine((-0.5, -1.0, -0.4)))
    mesh = bunny()
    places, normals, area = sample_mesh(mesh, _ON_BUNNY)
    floor = _floor(4.0)
    places, normals = (
        np.concatenate([places, floor]),
        np.concatenate([normals, np.tile([0.0, 1.0, 0.0], (FLOOR_POINTS**2, 1))]),
    )
    areas = np.concatenate([np.full(_ON_BUNNY, area / _ON_BUNNY), np.full(FLOOR_POINTS**2, 64.0 / FLOOR_POINTS**2)])
    truth = "area" if kind == "soft" else "exact"
    return _scene(device, [(mesh, np.eye(4)), (FLOOR, np.eye(4))], light, places, normals, areas, truth)


def _floor(half: float) -> np.ndarray:
    """Returns points of a square around the origin in y = 0, one at random in each of its cells, [n, 3]."""
    places = np.indices((FLOOR_POINTS, FLOOR_POINTS)) + np.random.default_rng(0).random((2, FLOOR_POINTS, FLOOR_POINTS))
    x, z = half * (2.0 * places.reshape(2, -1) / FLOOR_POINTS - 1.0)
    return np.stack([x, np.zeros_like(x), z], axis=1)


def _scene(
    device: str,
    meshes: list[tuple[Mesh, np.ndarray]],
    light: Light,
    places: np.ndarray,
    normals: np.ndarray,
    area: float | np.ndarray,
    truth: np.ndarray | str,
) -> ShadowScene:
    """A scene; `truth` holds shares or names the filter that finds them, `area` is that of all points or of each."""
    launcher = Launcher(device)
    surfaces = tuple(Surface(path=f"/Mesh{n}", mesh=mesh, transform=where) for n, (mesh, where) in enumerate(meshes))
    casters = Casters(launcher, surfaces, np.zeros(3))
    casters.update(1.0)
    bounds = np.stack([np.minimum(places.min(axis=0), _ON_FLOOR[0]), np.maximum(places.max(axis=0), _ON_FLOOR[1])])
    points, facing = (launcher.array(a.astype(np.float32), "study", dtype=wp.vec3) for a in (places, normals))

    def trace(filter_name: str, **fields: float) -> np.ndarray:
        out = launcher.zeros(len(places), "study")
        rays = replace(light, shadow_filter=filter_name, **fields)
        shadow = RayTracedShadow(launcher, rays, casters, bounds, area_rays=_TRUE_RAYS)
        shadow.update(1.0)
        shadow.visibility(points, facing, out)
        return out.numpy().astype(float)

    if isinstance(light, DistantLight):
        toward = np.broadcast_to(-light.direction_at(1.0), normals.shape)
        # As wide, seen from the middle of the set, as that ball around a point light three units away.
        wide = trace("area", angle=float(np.degrees(2.0 * np.arcsin(_CLEAR_OF_EDGES / 3.0))))
    else:
        toward, wide = light.position_at(1.0) - places, trace("area", radius=_CLEAR_OF_EDGES)
    faces = np.sum(toward * normals, axis=1) > 0.0
    areas = np.where(faces, area / len(places) if np.isscalar(area) else area, 0.0)
    truth = trace(truth) if isinstance(truth, str) else truth
    return ShadowScene(
        casters, light, bounds, points, facing, areas, truth, faces & (wide == 1.0), faces & (wide == 0.0)
    )
