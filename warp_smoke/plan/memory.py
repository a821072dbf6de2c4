"""Estimates of device memory, before anything is allocated."""

from PIL import Image

from warp_smoke.material import TEXTURES, Material
from warp_smoke.plan.passes import DomainPlan, LightPlan, ReceiverPlan, SmokeShadowPlan, VolumePlan
from warp_smoke.record import Samples
from warp_smoke.scene import ArrayCollider, ArrayEmitter, Collider, Emitter
from warp_smoke.shadow.light_buffer import fit_shear, light_in_cells
from warp_smoke.shadow.projective import SCATTER_PARTS

# Floats for each cell; velocity components count as one each.
_STATE = {"emit_density": 1, "emit_temperature": 1, "voxelize_colliders": 4, "confine_vorticity": 4, "stir_air": 3}
_FLOW = 5  # velocity, pressure's first guess and divergence
_SOLVER = {
    "spectral": 1.1,
    "multigrid": 13.5,
    "spectral_conjugate_gradient": 8.4,
    "conjugate_gradient": 7.2,
    "red_black": 5.2,
    "jacobi": 6.3,
}
_OPEN_FACES = 4  # iterative solvers need them without colliders too
_DIFFUSION = {"spectral": 0, "jacobi": 2}
_ADVECTION = {"semi_lagrangian": 7.0, "semi_lagrangian_cubic": 7.0, "maccormack": 16.0, "bfecc": 20.0}


def memory_estimate(
    domains: tuple[DomainPlan, ...], receivers: tuple[ReceiverPlan, ...], volumes: tuple[VolumePlan, ...] = ()
) -> dict[str, int]:
    """Device memory by prim path: of a domain's solver, a receiver's bake and a light's maps and buffers [bytes]."""
    estimate = {each.domain.path: _domain_bytes(each) for each in domains}
    maps: dict[str, dict[str, int]] = {}
    for receiver in receivers:
        estimate[receiver.surface.path] = _receiver_bytes(receiver)
    for lit in (*receivers, *volumes):
        for each in lit.lights:
            known = maps.setdefault(each.light.path, {})
            for name, size in _light_bytes(each).items():
                known[name] = max(size, known.get(name, 0))
    return estimate | {path: sum(each.values()) for path, each in maps.items() if each}


def _domain_bytes(plan: DomainPlan) -> int:
    floats = sum(count for name, count in _STATE.items() if name in plan.passes)
    if "project_pressure" in plan.passes:
        floats += _FLOW + _SOLVER[plan.pressure_solver] + _ADVECTION[plan.advection]
        if plan.pressure_solver != "spectral" and not plan.colliders:
            floats += _OPEN_FACES
        floats += 20 / plan.lattice.shape[1]  # sums along j, in double precision
    floats += sum(_array_floats(each) for each in (*plan.emitters, *plan.colliders))
    if {"diffuse_velocity", "diffuse_density"} & set(plan.passes):
        floats += _DIFFUSION[plan.diffusion_solver]
        if plan.diffusion_solver == "jacobi" and not plan.colliders:
            floats += _OPEN_FACES
    return int(4 * plan.lattice.cells * floats)


def _array_floats(record: Emitter | ArrayEmitter | Collider | ArrayCollider) -> int:
    """Floats for each cell of an emitter or collider from arrays; meshes take little."""
    if isinstance(record, ArrayEmitter):
        return sum(3 if name == "velocity" else 1 for name in record.fields)
    return int(isinstance(record, ArrayCollider))


def _receiver_bytes(plan: ReceiverPlan) -> int:
    """For a texture that the surface fills."""
    materials, bakes = plan.surface.materials, set(plan.bakes)
    shares, lit, irradiance = 4 * bool({"visibility", "smokeShadow"} & bakes), "lit" in bakes, "irradiance" in bakes
    texel = 104 + shares  # points, normals, triangles, weights, detail and the picture's codes
    texel += 8 * any(each.has_pictures for each in materials) + 16 * any(each.needs_tangents for each in materials)
    texel += 12 * any(each.is_marched for each in materials) + 4 * any(each.is_see_through for each in materials)
    texel += 12 * (lit or irradiance) + 12 * irradiance
    texel += 6 * (irradiance or (lit and plan.surface.receiver.texture_bits == 16))
    for each in plan.lights:
        texel += 12 * (lit + irradiance) + 4 * bool(each.surface_shadow) + 4 * _channels(each) + shares
    return plan.surface.receiver.texture_size**2 * texel + _picture_bytes(materials)


def _picture_bytes(materials: tuple[Material, ...]) -> int:
    """Of materials' pictures as linear RGBA; what cannot be read is left to the bake's own error."""
    texels = sum(each.procedural.size**2 for each in materials if each.procedural)
    textures = [getattr(each, field) for each in materials for field in TEXTURES]
    for file in {texture.file for texture in textures if texture}:
        try:
            with Image.open(file) as image:
                texels += image.width * image.height
        except OSError:
            continue
    return 16 * texels


def _light_bytes(plan: LightPlan) -> dict[str, int]:
    """The light's depth map and its buffer for each domain."""
    size = plan.light.shadow_map_size
    faces = {"cube": 6, "spot": 1, "directional": 1}.get(plan.surface_shadow, 0)
    found = {"map": 4 * faces * size**2} if faces else {}
    for each in plan.smoke:
        if each.method != "ray_traced":
            found[each.domain.domain.path] = _buffer_bytes(plan, each)
    return found


def _channels(plan: LightPlan) -> int:
    """Shares that smoke lets through of one light, at each point."""
    return 0 if not plan.smoke else 3 if any(each.domain.domain.colors_light for each in plan.smoke) else 1


def _buffer_bytes(plan: LightPlan, each: SmokeShadowPlan) -> int:
    """Of the buffer, of what it is spread with, and of the smoke turned so that its rows follow the light's slices."""
    light, lattice = plan.light, each.domain.lattice
    spread = {"paper": 1, "exact": 1, "sweeps": 2}[light.smoke_diffuser] if light.smoke_diffusion else 0
    if each.method == "dpd":
        texels = (light.smoke_shadow_size or max(lattice.shape)) ** 2
        return 4 * texels * (SCATTER_PARTS + 1 + spread)
    transform = light.transform
    time = transform.times[0] if isinstance(transform, Samples) else 0.0
    shear = fit_shear(light_in_cells(light, lattice, time), lattice.shape, light.smoke_shadow_size)
    if shear is None:
        return 0
    layers = -(-shear.slices // (each.layer or shear.slices))
    rows = lattice.cells // lattice.shape[2]
    turned = lattice.cells if shear.axis == 2 else 0
    return 4 * (rows + turned + layers * shear.texels[0] * shear.texels[1] * (1 + spread))
