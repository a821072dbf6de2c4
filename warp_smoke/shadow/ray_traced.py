"""Shadows of any light by rays: one for each point (`exact`), or many to all of a round light (`area`).

They are the truth that depth maps are measured against.
"""

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Camera, DistantLight, Light
from warp_smoke.shadow.bias import round_off
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.filters import spiral

wp.set_module_options({"enable_backward": False})

AREA_RAYS = 64


@wp.kernel
def _trace_points(
    rows: Rows,
    mesh: wp.uint64,
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
        if d <= far and wp.mesh_query_ray_anyhit(mesh, start, ray / d, d - near):
            visible = wp.float32(0.0)
    visibility_out[n] = visible


@wp.kernel
def _trace_disks(
    rows: Rows,
    mesh: wp.uint64,
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
    side = wp.vec3(1.0, 0.0, 0.0)
    if wp.abs(axis[0]) > 0.7:
        side = wp.vec3(0.0, 1.0, 0.0)
    right = wp.normalize(wp.cross(side, axis))
    up = wp.cross(axis, right)
    sine = wp.min(radius / wp.max(d, 1.0e-30), 0.99)
    width = d * sine / wp.sqrt(1.0 - sine * sine)
    reached = wp.float32(0.0)
    for k in range(disk.shape[0]):
        to = ray + width * (disk[k][0] * right + disk[k][1] * up)
        length = wp.length(to)
        blocked = wp.dot(to, normals[n]) <= 0.0
        if not blocked and d <= far:
            blocked = wp.mesh_query_ray_anyhit(mesh, start, to / length, length - near)
        reached += wp.where(blocked, 0.0, 1.0)
    visibility_out[n] = reached / float(disk.shape[0])


class RayTracedShadow:
    """Which points a light reaches, by rays: one to its middle, or `AREA_RAYS` with the filter `area`.

    Rays start a little off the surface, so that it does not shadow itself, and end as far before the light, so that a
    light on a surface is not shadowed by it. Points that face away from the light are in their own shadow.
    """

    def __init__(
        self,
        launcher: Launcher,
        light: Light,
        casters: Casters,
        receiver_bounds: np.ndarray,
        camera: Camera | None = None,
        area_rays: int = AREA_RAYS,
    ):
        """Prepares the rays.

        Args:
            launcher: launches the kernel.
            light: any light.
            casters: what casts shadows.
            receiver_bounds: lower and upper corner, in set space, of all that is ever looked up: a box [2, 3], or one
                for each receiver [n, 2, 3].
            camera: makes no difference to rays; the other methods take one.
            area_rays: of each point, with the filter `area`.
        """
        self._launcher, self._light, self._casters = launcher, light, casters
        self._receiver_extent = float(np.abs(receiver_bounds).max())
        if light.shadow_filter == "area":
            self._disk = launcher.array(spiral(area_rays).astype(np.float32), "shadow_filter", dtype=wp.vec3)

    def update(self, time: float) -> None:
        """Places the light as at a time code."""
        light, casters = self._light, self._casters
        # A receiver is to clear its own triangles; others may be far larger, like a sky around the set.
        self._offset = round_off(self._receiver_extent)
        if isinstance(light, DistantLight):
            past_all = -4.0 * max(casters.extent, self._receiver_extent) * light.direction_at(time)
            self._homogeneous = wp.vec4(*past_all.tolist(), 0.0)
            self._near, self._far = 0.0, float(np.inf)
            # As wide in the sky as the light, seen from the set.
            self._radius = float(np.linalg.norm(past_all) * np.sin(np.radians(min(0.5 * light.angle, 80.0))))
        else:
            self._homogeneous = wp.vec4(*(light.position_at(time) - casters.origin).tolist(), 1.0)
            self._near = max(light.shadow_near or 0.0, self._offset)
            self._far = float(np.inf) if light.shadow_far is None else light.shadow_far
            self._radius = float(light.radius)

    def visibility(self, points: wp.array, normals: wp.array, visibility_out: wp.array) -> None:
        """Writes the share of light from 0 to 1 that reaches each point.

        Args:
            points: in set space, [n] vec3.
            normals: unit surface normals, [n] vec3.
            visibility_out: [n].
        """
        rays = (self._offset, self._near, self._far, points, normals, visibility_out)
        mesh, count = self._casters.mesh.id, len(points)
        if self._light.shadow_filter == "area":
            args = (mesh, self._homogeneous, self._radius, self._disk, *rays)
            self._launcher.launch_each(_trace_disks, count, *args)
        else:
            self._launcher.launch_each(_trace_points, count, mesh, self._homogeneous, *rays)
