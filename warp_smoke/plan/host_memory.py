"""Estimates of host memory, apart from the device's: results waiting to be written, and checkpoints."""

from warp_smoke.plan.passes import DepthPlan, DomainPlan, ReceiverPlan

# Floats per cell: a checkpoint holds velocity, pressure, density and temperature; of the frames in memory, one is being
# simulated and one or two are being written (measured on the example stages).
_CHECKPOINT = 6.0
_FRAMES = 2.5
_GRIDS = {"density": 1, "temperature": 1, "velocity": 3, "light": 3}
# Bytes per texel: of each bake, finished and in progress; of a shadow map; and of a procedural picture being computed.
_BAKE = 16
_DEPTH = 8
_CROSS = 12  # faces that the picture of a cube map has room for (4 × 3)
_PROCEDURAL = 96


def host_estimate(
    domains: tuple[DomainPlan, ...], receivers: tuple[ReceiverPlan, ...], depths: tuple[DepthPlan, ...]
) -> dict[str, int]:
    """Returns host memory by prim path of domain, receiver and light [bytes]."""
    found = {}
    for each in domains:
        floats = _CHECKPOINT + _FRAMES * sum(_GRIDS[grid] for grid in each.grids)
        found[each.domain.path] = int(4 * each.lattice.cells * floats)
    for each in receivers:
        material = each.surface.material
        computed = material.procedural.size**2 if material and material.procedural else 0
        texels = each.surface.receiver.texture_size**2
        found[each.surface.path] = _BAKE * len(each.bakes) * texels + _PROCEDURAL * computed
    for each in (light for depth in depths for light in depth.lights):
        faces = _CROSS if each.surface_shadow == "cube" else 1
        found[each.light.path] = _DEPTH * faces * each.light.shadow_map_size**2
    return found
