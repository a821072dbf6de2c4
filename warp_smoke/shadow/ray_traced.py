"""Shadows of any light by one ray for each point: the truth that depth maps are measured against."""

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import DistantLight, Light
from warp_smoke.shadow.bias import round_off
from warp_smoke.shadow.casters import Casters

wp.set_module_options({"enable_backward": False})


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
    visible = 0.0
    if wp.dot(ray, normals[n]) > 0.0:
        visible = 1.0
        if d <= far and wp.mesh_query_ray_anyhit(mesh, start, ray / d, d - near):
            visible = 0.0
    visibility_out[n] = visible


class RayTracedShadow:
    """Which points a light reaches, by rays.

    Rays start a little off the surface, so that it does not shadow itself, and end as far before the light, so that a
    light on a surface is not shadowed by it. Points that face away from the light are in their own shadow.
    """

    def __init__(self, launcher: Launcher, light: Light, casters: Casters, receiver_bounds: np.ndarray):
        """Prepares the rays.

        Args:
            launcher: launches the kernel.
            light: any light.
            casters: what casts shadows.
            receiver_bounds: lower and upper corner, in set space, of all that is ever looked up, [2, 3].
        """
        self._launcher, self._light, self._casters = launcher, light, casters
        self._receiver_extent = float(np.abs(receiver_bounds).max())

    def update(self, time: float) -> None:
        """Places the light as at a time code."""
        light, casters = self._light, self._casters
        # A receiver is to clear its own triangles; others may be far larger, like a sky around the set.
        self._offset = round_off(self._receiver_extent)
        if isinstance(light, DistantLight):
            past_all = -4.0 * max(casters.extent, self._receiver_extent) * light.direction_at(time)
            self._homogeneous = wp.vec4(*past_all.tolist(), 0.0)
            self._near, self._far = 0.0, float(np.inf)
        else:
            self._homogeneous = wp.vec4(*(light.position_at(time) - casters.origin).tolist(), 1.0)
            self._near = max(light.shadow_near or 0.0, self._offset)
            self._far = float(np.inf) if light.shadow_far is None else light.shadow_far

    def visibility(self, points: wp.array, normals: wp.array, visibility_out: wp.array) -> None:
        """Writes 1 where the light reaches a point and 0 where it does not.

        Args:
            points: in set space, [n] vec3.
            normals: unit surface normals, [n] vec3.
            visibility_out: [n].
        """
        self._launcher.launch_each(
            _trace_points,
            len(points),
            self._casters.mesh.id,
            self._homogeneous,
            self._offset,
            self._near,
            self._far,
            points,
            normals,
            visibility_out,
        )
