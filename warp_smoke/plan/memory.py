"""Estimates of device memory, before anything is allocated."""

from contextlib import suppress
from dataclasses import replace
from math import prod

import numpy as np
from PIL import Image

from warp_smoke.fluid.eddies import place_eddies
from warp_smoke.material import TEXTURES, Material
from warp_smoke.picture_file import open_picture_file, tile_files
from warp_smoke.plan.passes import DepthPlan, DomainPlan, LightPlan, ReceiverPlan, SmokeShadowPlan, VolumePlan
from warp_smoke.plan.reach import is_moving
from warp_smoke.scene import ArrayCollider, ArrayEmitter, Collider, DistantLight, Emitter, Light, Scene
from warp_smoke.shadow.coverage import MASK_SIZE, TILE, tile_lists
from warp_smoke.shadow.light_buffer import LINE, fit_buffer, light_times
from warp_smoke.shadow.projective import SCATTER_PARTS
from warp_smoke.shadow.splats import SPLATS, tap_count

# Floats per cell; each velocity component counts as one.
_STATE = {"emit_density": 1, "emit_temperature": 1, "voxelize_colliders": 4, "confine_vorticity": 4, "stir_air": 3}
_FLOW = 5  # velocity, the initial guess for pressure, and divergence
_SOLVER = {
    "spectral": 1.1,
    "multigrid": 12.5,
    "spectral_conjugate_gradient": 8.4,
    "conjugate_gradient": 7.2,
    "red_black": 5.2,
    "jacobi": 6.3,
}
_OPEN_FACES = 4  # needed by iterative solvers without colliders too
_DIFFUSION = {"spectral": 0, "jacobi": 3}
# Bytes per triangle of a shadow caster: three points and indices, and in Warp's bounding volume hierarchy two nodes of
# 32 bytes, bounds and indices.
_TRIANGLE = 48 + 108
_LIGHT_BLOCK = 16384  # cells that `shading.volume` lights at once
_GHOSTS = 7  # cells at each end of a periodic axis, at the default Courant number
_MOVING = 4  # velocity of solid faces, and which cells were fluid before
_FRICTION = 3  # friction of faces
_PULL = 6  # pull of moving walls, along two axes on each face
_ADVECTION = {"semi_lagrangian": 7.0, "semi_lagrangian_cubic": 7.0, "maccormack": 16.0, "bfecc": 20.0}


def memory_estimate(
    scene: Scene,
    domains: tuple[DomainPlan, ...],
    receivers: tuple[ReceiverPlan, ...],
    volumes: tuple[VolumePlan, ...] = (),
    depths: tuple[DepthPlan, ...] = (),
) -> dict[str, int]:
    """Returns device memory by prim path: of a domain's solver, a receiver's bake, a light's maps and buffers [bytes].

    Triangles that block several lights are counted for the first of them.
    """
    estimate = {each.domain.path: _domain_bytes(each) for each in domains}
    for volume in volumes:
        estimate[volume.domain.domain.path] += _light_grid_bytes(volume)
    maps: dict[str, dict[str, int]] = {}
    for receiver in receivers:
        estimate[receiver.surface.path] = _receiver_bytes(receiver)
    linked = set()
    for lit in (*receivers, *volumes, *depths):
        for each in lit.lights:
            known = maps.setdefault(each.light.path, {})
            if each.surface_shadow and each.light.shadowed_by not in linked:
                linked.add(each.light.shadowed_by)
                known["casters"] = _TRIANGLE * _triangles(scene, each.light)
            for name, size in _light_bytes(scene, each).items():
                known[name] = max(size, known.get(name, 0))
    return estimate | {path: sum(each.values()) for path, each in maps.items() if each}


def _domain_bytes(plan: DomainPlan) -> int:
    floats = sum(count for name, count in _STATE.items() if name in plan.passes)
    if "project_pressure" in plan.passes:
        floats += _FLOW + _SOLVER[plan.pressure_solver] + _ADVECTION[plan.advection]
        if plan.pressure_solver != "spectral" and not plan.colliders:
            floats += _OPEN_FACES
        floats += _MOVING * any(is_moving(each) for each in plan.colliders)
        floats += 20 / plan.lattice.shape[1]  # sums along j, in double precision
        floats += _ghost_floats(plan)
    floats += sum(_array_floats(each) for each in (*plan.emitters, *plan.colliders))
    floats += _eddy_floats(plan) if "stir_air" in plan.passes else 0.0
    if {"diffuse_velocity", "diffuse_density", "diffuse_temperature"} & set(plan.passes):
        floats += _DIFFUSION[plan.diffusion_solver]
        if plan.diffusion_solver == "jacobi" and not plan.colliders:
            floats += _OPEN_FACES
        floats += _friction_floats(plan)
    return int(4 * plan.lattice.cells * floats)


def _friction_floats(plan: DomainPlan) -> float:
    """Returns the floats per cell of colliders' friction and pull, the field they act on, and copies with ghosts."""
    rough = [each for each in plan.colliders if each.friction]
    pulls = any(is_moving(each) for each in rough)
    floats = _FRICTION * bool(rough) + _PULL * pulls
    if plan.diffusion_solver == "jacobi" and "periodic" in plan.lattice.sides:
        ring = [2 * (side == "periodic") for side in plan.lattice.sides[0::2]]
        grown = prod(n + ghosts for n, ghosts in zip(plan.lattice.shape, ring, strict=True)) / plan.lattice.cells
        floats += (floats + _OPEN_FACES) * grown
    return floats + pulls


def _ghost_floats(plan: DomainPlan) -> float:
    """Returns the floats per cell of field copies with ghosts beyond periodic sides, on top of a closed box's."""
    shape, rings = plan.lattice.shape, [side == "periodic" for side in plan.lattice.sides[0::2]]
    if not any(rings):
        return 0.0
    grown = prod(n + 2 * _GHOSTS * ring for n, ring in zip(shape, rings, strict=True)) / plan.lattice.cells
    floats = (grown - 1.0) * _ADVECTION[plan.advection] + 4.0 * grown
    floats += 5.0 * grown if plan.colliders else 0.0
    if "confine_vorticity" in plan.passes:
        floats += 7.0 * prod(n + 4 * ring for n, ring in zip(shape, rings, strict=True)) / plan.lattice.cells
    return floats


def _eddy_floats(plan: DomainPlan) -> float:
    """Returns the floats per cell of turbulence's nodes: 3 × (2 gradients, a speed), a gradient, and two ramps."""
    nodes, (nx, ny, _) = place_eddies(plan.lattice, plan.domain.turbulence_scale).nodes, plan.lattice.shape
    return (24 * prod(nodes) + 2 * (nx + 1) * (ny + 1) * nodes[2]) / plan.lattice.cells


def _array_floats(record: Emitter | ArrayEmitter | Collider | ArrayCollider) -> int:
    """Returns the floats per cell of an emitter or collider from arrays; 0 for meshes, which take little."""
    if isinstance(record, ArrayEmitter):
        return sum(3 if name == "velocity" else 1 for name in record.fields)
    return int(isinstance(record, ArrayCollider))


def _receiver_bytes(plan: ReceiverPlan) -> int:
    """Returns the bytes of a receiver's bakes, for a texture that the surface fills completely."""
    materials, bakes = plan.surface.materials, set(plan.bakes)
    shares, lit, irradiance = 4 * bool({"visibility", "smokeShadow"} & bakes), "lit" in bakes, "irradiance" in bakes
    texel = 104 + shares  # points, normals, triangles, weights, detail and the encoded picture
    texel += 8 * any(each.has_pictures for each in materials) + 16 * any(each.needs_tangents for each in materials)
    texel += 12 * any(each.is_marched for each in materials) + 4 * any(each.is_see_through for each in materials)
    texel += 12 * (lit or irradiance) + 12 * irradiance + 24 * plan.surface.mesh.is_smooth
    texel += 6 * (irradiance or (lit and plan.surface.receiver.texture_bits == 16))
    for each in plan.lights:
        # The smoke's transmittance also of the frame before, and again where smoke can shadow.
        texel += 12 * (lit + irradiance) + 4 * bool(each.surface_shadow) + 12 * _channels(each) + shares
    texel += 21 * any(
        each.smoke for each in plan.lights
    )  # places, indices and coordinates of the points that smoke can shadow
    return plan.surface.receiver.texture_size**2 * texel + _picture_bytes(materials)


def _picture_bytes(materials: tuple[Material, ...]) -> int:
    """Returns the bytes of materials' pictures as linear RGBA; skips unreadable files, which the bake reports."""
    texels = sum(each.procedural.size**2 for each in materials if each.procedural)
    textures = [getattr(each, field) for each in materials for field in TEXTURES]
    for file in {texture.file for texture in textures if texture}:
        with suppress(OSError, SyntaxError, ValueError, Image.DecompressionBombError):
            texels += _texels(tile_files(file))
    return 16 * texels


def _texels(tiles: dict[tuple[int, int], str]) -> int:
    """Of a picture of tiles by column and row, all as large as the largest."""
    sizes = []
    for file in tiles.values():
        with open_picture_file(file) as opened, Image.open(opened) as image:
            sizes.append(image.size)
    columns, rows = (max(numbers) + 1 for numbers in zip(*tiles, strict=True))
    return columns * rows * prod(max(numbers) for numbers in zip(*sizes, strict=True))


def _light_grid_bytes(plan: VolumePlan) -> int:
    """Returns the scratch bytes for a block of cells: places, light, and transmittance of smoke and past surfaces."""
    channels = sum({3 if _channels(each) == 3 else 1 for each in plan.lights})
    shadowed = any(each.surface_shadow for each in plan.lights)
    return _LIGHT_BLOCK * (4 + 12 + 12 + 4 + 4 * channels + 16 * shadowed)


def _triangles(scene: Scene, light: Light) -> int:
    """Returns the number of triangles that may block the light."""
    return sum(len(each.mesh.triangles) for each in scene.shadowing(light))


def _light_bytes(scene: Scene, plan: LightPlan) -> dict[str, int]:
    """Returns the bytes of the light's depth map (for rays, of its mask of casters alone) and of its light buffers."""
    found = {}
    if plan.surface_shadow:
        faces = 1 if isinstance(plan.light, DistantLight) or plan.surface_shadow == "spot" else 6
        if plan.surface_shadow in ("exact", "area"):
            found["map"] = 4 * faces * (MASK_SIZE // TILE) ** 2
        else:
            size = plan.light.shadow_map_size
            # The list of tiles, the mask and the bound on each tile's depth.
            found["map"] = 4 * faces * (size**2 + 3 * (-(-size // TILE)) ** 2)
            found["map"] += 4 * prod(tile_lists(faces, size, _triangles(scene, plan.light)))
    for each in plan.smoke:
        if each.method != "ray_traced":
            found[f"{each.domain.domain.path} {each.method}"] = _buffer_bytes(plan, each)
    return found


def _channels(plan: LightPlan) -> int:
    """Returns how many transmittance values smoke has for one light at each point: 0, 1 or 3."""
    return 0 if not plan.smoke else 3 if any(each.domain.domain.colors_light for each in plan.smoke) else 1


def _buffer_bytes(plan: LightPlan, each: SmokeShadowPlan) -> int:
    """Returns the bytes of a light buffer, its diffusion, and the smoke transposed to have rows along its slices."""
    light, lattice = plan.light, each.domain.lattice
    spread = {"paper": 1, "exact": 1, "sweeps": 2}[light.smoke_diffuser] if light.smoke_diffusion else 0
    if each.method == "dpd":
        texels = (light.smoke_shadow_size or max(lattice.shape)) ** 2
        return 4 * texels * (SCATTER_PARTS + 1 + spread)
    light = replace(light, smoke_shadow=each.method)
    fits = [shear for time in light_times(light) if (shear := fit_buffer(light, lattice, time))]
    if not fits:
        return 0
    texels = np.prod(np.max([shear.texels for shear in fits], axis=0), dtype=int)
    splat, floats = SPLATS.get(each.method), 0
    for shear in {shear.axis: shear for shear in fits}.values():
        layers = -(-shear.slices // (each.layer or shear.slices))
        sides = [n for axis, n in enumerate(lattice.shape) if axis != shear.axis]
        floats += shear.slices * (sides[0] + 3) + layers * texels * (1 + spread)
        if shear.axis == 2:
            floats += lattice.cells + lattice.cells // LINE
        if splat:
            taps = [1 + tap_count(splat, shear, cells) for cells in sides]
            floats += shear.slices * len(splat.depths) * int(np.dot(shear.texels, taps))
    return int(4 * floats)
