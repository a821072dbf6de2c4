"""A scene with other settings: coarser or finer, with other schemes and shadows, or without one of its effects."""

from dataclasses import replace

from warp_smoke.plan import Plan
from warp_smoke.scene import Emitter, Scene

# What a domain is like without the effect of a pass: the effect's name, and the fields that switch it off.
_WITHOUT = {
    "blow_wind": ("wind", {"wind": (0.0, 0.0, 0.0)}),
    "add_buoyancy": ("buoyancy", {"buoyancy_density": 0.0, "buoyancy_temperature": 0.0}),
    "stir_air": ("turbulence", {"turbulence": 0.0}),
    "confine_vorticity": ("vorticity confinement", {"vorticity": 0.0}),
    "diffuse_velocity": ("viscosity", {"viscosity": 0.0}),
    "fit_active_box": ("active box", {"active_box": False}),
    "diffuse_density": ("diffusion of smoke", {"density_diffusion": 0.0}),
    "dissipate_density": ("dissipation", {"density_dissipation": 0.0}),
    "cool_temperature": ("cooling", {"temperature_cooling": 0.0}),
}


def with_smoke(scene: Scene, scheme: str | None, resolution: int) -> Scene:
    """Returns the scene with an advection scheme (None = the stage's), and resolutions scaled to the first domain's."""
    share = resolution / scene.domains[0].resolution
    domains = []
    for domain in scene.domains:
        cells = max(1, round(domain.resolution * share))
        domains.append(replace(domain, resolution=cells, advection=scheme or domain.advection))
    return replace(scene, domains=domains)


def with_tolerance(scene: Scene, tolerance: float) -> Scene:
    """Returns the scene with this tolerance for all pressure solvers."""
    return replace(scene, domains=[replace(domain, pressure_tolerance=tolerance) for domain in scene.domains])


def with_surface_shadows(scene: Scene, shadow_filter: str, share: float = 1.0) -> Scene:
    """Returns the scene with this filter for all surface shadows, and map sizes scaled by a share."""
    lights = []
    for light in scene.lights:
        texels = max(1, round(light.shadow_map_size * share))
        lights.append(replace(light, shadow_filter=shadow_filter, shadow_map_size=texels))
    return replace(scene, lights=lights)


def with_smoke_shadows(scene: Scene, method: str) -> Scene:
    """Returns the scene with this method for all smoke shadows."""
    return replace(scene, lights=[replace(light, smoke_shadow=method) for light in scene.lights])


def effects_off(scene: Scene, plan: Plan) -> dict[str, Scene]:
    """Returns the scene without each of its plan's effects in turn, by the effect's name."""
    passes, without = {each.name for each in plan.passes}, {}
    for name, (effect, fields) in _WITHOUT.items():
        if name in passes:
            without[effect] = replace(scene, domains=[replace(domain, **fields) for domain in scene.domains])
    if "stir_air" in passes:
        calm = [replace(each, turbulence=0.0) if isinstance(each, Emitter) else each for each in scene.emitters]
        without["turbulence"] = replace(without["turbulence"], emitters=calm)
    if "vary_emission" in passes:
        even = {"noise": 0.0, "source": "volume"}
        emitters = [replace(each, **even) if isinstance(each, Emitter) else each for each in scene.emitters]
        without["uneven emission"] = replace(scene, emitters=emitters)
    if "voxelize_colliders" in passes:
        without["colliders"] = replace(scene, colliders=())
    if "light_volume" in passes:
        grids = [tuple(grid for grid in domain.grids if grid != "light") for domain in scene.domains]
        domains = [replace(domain, grids=kept) for domain, kept in zip(scene.domains, grids, strict=True)]
        without["light in the smoke"] = replace(scene, domains=domains)
    if "surface_visibility" in passes:
        without["shadows of surfaces"] = with_receivers(scene, receive_shadow=False)
    if "smoke_transmittance" in passes:
        without["shadows of smoke"] = with_receivers(scene, receive_smoke=False)
    if "bake" in passes:
        without["baked light"] = replace(scene, surfaces=[replace(each, receiver=None) for each in scene.surfaces])
    return without


def with_receivers(scene: Scene, **fields) -> Scene:
    """Returns the scene with these fields changed in every receiver."""
    surfaces = [replace(s, receiver=replace(s.receiver, **fields)) if s.receiver else s for s in scene.surfaces]
    return replace(scene, surfaces=surfaces)
