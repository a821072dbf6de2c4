"""Shadows of any light by rays: one per point (`exact`), or many to the full area of a round light (`area`).

They are the reference that depth maps are measured against.
"""

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Camera, DistantLight, Light
from warp_smoke.shadow import coverage
from warp_smoke.shadow.bias import round_off
from warp_smoke.shadow.caster_mask import CasterMask, CasterTiles, may_be_shadowed
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.filters import spiral, square_to

wp.set_module_options({"enable_backward": False})

AREA_RAYS = 64
# Largest sine of the angular radius of a light seen from a point: near and inside the light, rays go to less than half
# of it.
_WIDEST_SINE = wp.constant(0.99)
# Distance of a distant light from points that may be anywhere [stage units]; its square fits in a float.
_FAR_AWAY = 1e15


@wp.kernel
def _trace_points(
    rows: Rows,
    mesh: wp.uint64,
    mask: CasterMask,
    light: wp.vec4,
    offset: float,
    near: float,
    far: float,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """visibility[n] = no hit between points[n] + offset · normals[n] and the light; 0 on the side away from it."""
    n = rows.first + wp.tid()
    start = points[n] + offset * normals[n]
    ray = wp.vec3(light[0], light[1], light[2]) - light[3] * start
    d = wp.length(ray)
    visible = wp.float32(0.0)
    if wp.dot(ray, normals[n]) > 0.0:
        visible = wp.float32(1.0)
        if d <= far and may_be_shadowed(mask, start) and wp.mesh_query_ray_anyhit(mesh, start, ray / d, d - near):
            visible = wp.float32(0.0)
    visibility_out[n] = visible


@wp.kernel
def _trace_disks(
    rows: Rows,
    mesh: wp.uint64,
    mask: CasterMask,
    light: wp.vec4,
    radius: float,
    disk: wp.array[wp.vec3],
    offset: float,
    near: float,
    far: float,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    visibility_out: wp.array[float],
):
    """visibility[n] = share of rays from points[n] + offset · normals[n] that reach the light's disk.

    A sphere of radius R at distance d is seen as a disk of radius R / √(1 − (R/d)²) there.
    """
    n = rows.first + wp.tid()
    start = points[n] + offset * normals[n]
    ray = wp.vec3(light[0], light[1], light[2]) - light[3] * start
    d = wp.length(ray)
    axis = ray / wp.max(d, 1.0e-30)
    right = square_to(axis)
    up = wp.cross(axis, right)
    sine = wp.min(radius / wp.max(d, 1.0e-30), _WIDEST_SINE)
    width = d * sine / wp.sqrt(1.0 - sine * sine)
    meets = d <= far and may_be_shadowed(mask, start)
    reached = wp.float32(0.0)
    for k in range(disk.shape[0]):
        to = ray + width * (disk[k][0] * right + disk[k][1] * up)
        length = wp.length(to)
        blocked = wp.dot(to, normals[n]) <= 0.0
        if meets and not blocked:
            blocked = wp.mesh_query_ray_anyhit(mesh, start, to / length, length - near)
        reached += wp.where(blocked, 0.0, 1.0)
    visibility_out[n] = reached / float(disk.shape[0])


class RayTracedShadow:
    """Which points a light reaches, by rays: one to its middle, or `AREA_RAYS` with the filter `area`.

    Rays start slightly off the surface, so that it does not shadow itself, and end the same distance before the light,
    so that a light on a surface is not shadowed by it. Points that face away from the light are in their own shadow.
    Rays are traced only from points that a caster may block.
    """

    def __init__(
        self,
        launcher: Launcher,
        light: Light,
        casters: Casters,
        receiver_bounds: np.ndarray | None,
        camera: Camera | None = None,
        area_rays: int = AREA_RAYS,
    ):
        """Prepares the rays.

        Args:
            launcher: launches the kernel.
            light: any light.
            casters: what casts shadows.
            receiver_bounds: lower and upper corner, in set space, of all points ever looked up: a box [2, 3], or one
                per receiver [n, 2, 3]. None = anywhere; then every point is traced, since finding out which points
                need no ray would take longer than a ray for each pixel of a picture.
            camera: unused by rays; the other methods take one.
            area_rays: rays per point, with the filter `area`.
        """
        self._launcher, self._light, self._casters = launcher, light, casters
        self._receivers = None
        if receiver_bounds is None:
            self._tiles = CasterTiles(launcher, 1, coverage.TILE)
            self._tiles.place(np.ones((1, 1, 1)), np.eye(3)[None], np.zeros(3), np.inf, False)
        else:
            self._receivers = np.asarray(receiver_bounds, np.float64).reshape(-1, 2, 3)
            self._tiles = CasterTiles(launcher, 1 if isinstance(light, DistantLight) else 6, coverage.MASK_SIZE)
        self._placed = None
        if light.shadow_filter == "area":
            self._disk = launcher.array(spiral(area_rays).astype(np.float32), "shadow_filter", dtype=wp.vec3)

    def update(self, time: float) -> None:
        """Places the light for a time code."""
        state = self._casters.version, self._light.transform_at(time).tobytes()
        if state == self._placed:
            return
        self._placed = state
        extent = self._casters.extent if self._receivers is None else float(np.abs(self._receivers).max())
        # Only the receivers' own triangles have to be cleared; others may be far larger, like a sky around the set.
        self._offset = round_off(extent)
        if isinstance(self._light, DistantLight):
            past_all = 4.0 * max(self._casters.extent, extent)
            self._place_distant(time, _FAR_AWAY if self._receivers is None else past_all)
        else:
            self._place_point(time)

    def _place_distant(self, time: float, distance: float) -> None:
        direction = self._light.direction_at(time)
        to_light = -distance * direction
        self._homogeneous = wp.vec4(*to_light.tolist(), 0.0)
        self._near, self._far = 0.0, float(np.inf)
        # With the angular size of the light, seen from the set.
        sine = min(np.sin(np.radians(min(0.5 * self._light.angle, 80.0))), _WIDEST_SINE)
        self._radius = float(distance * sine)
        if self._receivers is not None:
            self._mask_distant(direction, sine)

    def _mask_distant(self, direction: np.ndarray, sine: float) -> None:
        frame = coverage.frame_along(direction)
        found = self._boxes(np.append(-direction, 0.0))
        corners = coverage.box_corners(np.concatenate([found, self._receivers])).reshape(-1, 3) @ frame.T
        if self._light.shadow_filter == "area":
            found = _grown(found, np.ptp(corners[:, 2]) * sine / np.sqrt(1.0 - sine**2))
        corners = coverage.box_corners(found).reshape(-1, 3) @ frame.T if len(found) else np.zeros((1, 3))
        lower, upper = corners.min(axis=0), corners.max(axis=0)
        width = max(1.001 * float((upper - lower)[:2].max()), self._offset)
        corner = 0.5 * (lower + upper)[:2] - 0.5 * width
        tiles = coverage.covered_tiles(coverage.flat_rectangles(found, frame, corner, width), coverage.MASK_SIZE)
        self._tiles.place(tiles, frame[None], 0.5 * (lower + upper) @ frame, 0.5 * width, False)

    def _place_point(self, time: float) -> None:
        light = self._light
        position = light.position_at(time) - self._casters.origin
        self._homogeneous = wp.vec4(*position.tolist(), 1.0)
        self._near = max(light.shadow_near or 0.0, self._offset)
        self._far = float(np.inf) if light.shadow_far is None else light.shadow_far
        self._radius = float(light.radius)
        if self._receivers is not None:
            self._mask_point(position)

    def _mask_point(self, position: np.ndarray) -> None:
        found = self._boxes(np.append(position, 1.0))
        if self._light.shadow_filter == "area":
            nearest = float(coverage.nearest_distance(self._receivers, position).min())
            sine = min(self._radius / max(nearest, 1e-30), _WIDEST_SINE)
            found = _grown(found, self._radius / np.sqrt(1.0 - sine**2))
        tiles = coverage.covered_tiles(coverage.cube_rectangles(found, position), coverage.MASK_SIZE)
        self._tiles.place(tiles, coverage.CUBE_FRAMES, position, 1.0, True)

    def _boxes(self, light: np.ndarray) -> np.ndarray:
        """Returns boxes of what may lie between the receivers and the light, [n, 2, 3]."""
        return _grown(self._casters.boxes_behind_which(self._receivers, light, self._offset), self._offset)

    def visibility(
        self, points: wp.array, normals: wp.array, visibility_out: wp.array, facets: wp.array | None = None
    ) -> None:
        """Writes the share of light from 0 to 1 that reaches each point.

        Args:
            points: in set space, [n] vec3.
            normals: unit surface normals, [n] vec3.
            visibility_out: [n].
            facets: unused by rays; depth maps take their bias from them.
        """
        rays = (self._offset, self._near, self._far, points, normals, visibility_out)
        where, count = (self._casters.mesh.id, self._tiles.mask, self._homogeneous), len(points)
        if self._light.shadow_filter == "area":
            self._launcher.launch_each(_trace_disks, count, *where, self._radius, self._disk, *rays)
        else:
            self._launcher.launch_each(_trace_points, count, *where, *rays)


def _grown(boxes: np.ndarray, reach: float) -> np.ndarray:
    """Grows boxes [n, 2, 3] by `reach` on all sides."""
    return boxes + reach * np.array([[-1.0], [1.0]])
