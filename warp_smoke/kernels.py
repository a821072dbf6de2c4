"""The kernel modules that a plan needs, so that only those are compiled and loaded, all at once."""

from importlib import import_module

from warp_smoke.geometry import Points
from warp_smoke.plan import LightPlan, Plan
from warp_smoke.plan.reach import is_moving
from warp_smoke.scene import Collider, Emitter

# Shared by several pressure solvers; `solid_faces` also has the `open_faces` of a box without colliders.
_ITERATIVE = ("fluid.solid_faces", "fluid.pressure.components", "fluid.pressure.iterative")
_CONJUGATE_GRADIENTS = (*_ITERATIVE, "fluid.pressure.conjugate_gradient", "fluid.pressure.preconditioner")
_SPECTRAL_DIFFUSION = ("fluid.transforms", "fluid.diffusion.scalar", "fluid.diffusion.spectral")
_JACOBI_DIFFUSION = ("fluid.solid_faces", "fluid.diffusion.scalar", "fluid.diffusion.jacobi")
# Kernel modules by the pass that launches them, or by pass and method where they depend on the method.
_FLUID = {
    "voxelize_colliders": ("fluid.voxelize", "fluid.crossing", "fluid.solid_faces", "fluid.solid_boundary"),
    "vary_emission": ("fluid.emitter_share",),
    "emit_density": ("fluid.voxelize", "fluid.emitters"),
    "emit_density arrays": ("fluid.array_source",),
    "blow_wind": ("fluid.wind",),
    "add_buoyancy": ("fluid.forces",),
    "stir_air": ("fluid.turbulence",),
    "confine_vorticity": ("fluid.forces", "fluid.vorticity"),
    "project_pressure": ("fluid.operators", "fluid.measures"),
    "project_pressure spectral": ("fluid.pressure.spectral", "fluid.transforms"),
    "project_pressure multigrid": (
        *_CONJUGATE_GRADIENTS,
        "fluid.pressure.levels",
        "fluid.pressure.smoothing",
        "fluid.pressure.transfer",
        "fluid.pressure.v_cycle",
        "fluid.pressure.split_levels",
    ),
    "project_pressure spectral_conjugate_gradient": (
        *_CONJUGATE_GRADIENTS,
        "fluid.pressure.spectral",
        "fluid.transforms",
    ),
    "project_pressure conjugate_gradient": _CONJUGATE_GRADIENTS,
    "project_pressure red_black": (*_ITERATIVE, "fluid.pressure.relaxation"),
    "project_pressure jacobi": (*_ITERATIVE, "fluid.pressure.relaxation"),
    "advect_density": ("fluid.halo", "fluid.advection"),
    "advect_density semi_lagrangian": ("fluid.trace",),
    "advect_density semi_lagrangian_cubic": ("fluid.trace", "fluid.cubic"),
    "advect_density maccormack": ("fluid.two_way_trace", "fluid.maccormack"),
    "advect_density bfecc": ("fluid.two_way_trace", "fluid.maccormack", "fluid.bfecc"),
    "diffuse_velocity spectral": _SPECTRAL_DIFFUSION,
    "diffuse_velocity jacobi": _JACOBI_DIFFUSION,
    "diffuse_density spectral": _SPECTRAL_DIFFUSION,
    "diffuse_density jacobi": _JACOBI_DIFFUSION,
    "diffuse_temperature spectral": _SPECTRAL_DIFFUSION,
    "diffuse_temperature jacobi": _JACOBI_DIFFUSION,
    "dissipate_density": ("fluid.dissipation",),
    "cool_temperature": ("fluid.dissipation",),
}
_SURFACE_SHADOW = {
    "cube": ("shadow.depth_map", "shadow.point_map"),
    "spot": ("shadow.depth_map", "shadow.point_map"),
    "directional": ("shadow.depth_map", "shadow.directional_map"),
    "exact": ("shadow.ray_traced",),
    "area": ("shadow.ray_traced",),
}
_SMOKE_SHADOW = {"dpd": ("shadow.dpd",), "ray_traced": ("shadow.smoke_ray_traced",)}
# Every other smoke shadow uses a light buffer along the light's rays.
_LIGHT_BUFFER = ("shadow.slice_projection", "shadow.smoke")


def kernel_modules(plan: Plan) -> list[str]:
    """Imports the modules whose kernels the plan launches and returns their names."""
    found = set()
    for each in plan.passes:
        for key in (each.name, f"{each.name} {each.method}"):
            found.update(_FLUID.get(key, ()))
    for domain in plan.domains:
        if any(isinstance(each, Emitter) and isinstance(each.mesh, Points) for each in domain.emitters):
            found.add("fluid.point_voxels")
        if "voxelize_colliders" in domain.passes:
            if any(each.friction for each in domain.colliders):
                found.add("fluid.friction")
            if any(isinstance(each, Collider) and is_moving(each) for each in domain.colliders):
                found.add("fluid.wall_motion")
    for receiver in plan.receivers:
        found.update(f"shading.{name}" for name in ("compose", "radiance", "surface_points", "texel_picture", "texels"))
        for light in receiver.lights:
            if light.surface_shadow:
                found.update(_SURFACE_SHADOW[light.surface_shadow])
            found.update(_smoke_modules(light))
    for depth in plan.depths:
        found.update(name for light in depth.lights for name in _SURFACE_SHADOW[light.surface_shadow])
    for volume in plan.volumes:
        found.add("shading.volume")
        for light in volume.lights:
            if light.surface_shadow:
                found.update(_SURFACE_SHADOW[light.surface_shadow])
            found.update(_smoke_modules(light))
    names = [f"warp_smoke.{name}" for name in sorted(found)]
    for name in names:
        import_module(name)
    return names


def smoke_shadow_kernels(method: str) -> tuple[str, ...]:
    """Returns the names, within the package, of the modules that hold a smoke shadow's kernels."""
    return _SMOKE_SHADOW.get(method, _LIGHT_BUFFER)


def _smoke_modules(light: LightPlan) -> set[str]:
    found = {name for each in light.smoke for name in smoke_shadow_kernels(each.method)}
    if light.light.smoke_diffusion and any(each.method != "ray_traced" for each in light.smoke):
        found.add("shadow.diffusion")
    return found
