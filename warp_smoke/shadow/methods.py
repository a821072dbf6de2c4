"""The shadow methods by name; all methods in a table share one signature."""

from warp_smoke.shadow.cube import CubeShadow
from warp_smoke.shadow.directional import DirectionalShadow
from warp_smoke.shadow.dpd import DpdSmokeShadow
from warp_smoke.shadow.ray_traced import RayTracedShadow
from warp_smoke.shadow.smoke import SmokeShadow
from warp_smoke.shadow.smoke_ray_traced import RayTracedSmokeShadow
from warp_smoke.shadow.splats import SPLATS
from warp_smoke.shadow.spot import SpotShadow

# (launcher, light, casters, receiver_bounds, camera), then .update(time) and .visibility(points, normals,
# visibility_out, facets).
SURFACE_SHADOWS = {
    "cube": CubeShadow,
    "spot": SpotShadow,
    "directional": DirectionalShadow,
    "exact": RayTracedShadow,
    "area": RayTracedShadow,
}

# (launcher, lattice, light, origin, extinction, color), then .update(density, time) and .transmittance(points, inout).
SMOKE_SHADOWS = {
    "march": SmokeShadow,
    **dict.fromkeys(SPLATS, SmokeShadow),
    "dpd": DpdSmokeShadow,
    "ray_traced": RayTracedSmokeShadow,
}
