"""Estimates of the host's memory beside the device's: results that wait to be written, and checkpoints."""

from warp_smoke.plan.passes import DepthPlan, DomainPlan, ReceiverPlan

# Floats of a cell: a checkpoint has velocity, pressure, density and temperature; of frames in hand there is one that
# is made and one or two that are written (measured on the example stages).
_CHECKPOINT = 6.0
_FRAMES = 2.5
_GRIDS = {"density": 1, "temperature": 1, "velocity": 3, "light": 3}
# Bytes of a texel for each bake, in frames in hand and in the making, and for a shadow map; and while a picture is
# computed.
_BAKE = 16
_DEPTH = 8
_CROSS = 12  # faces that the picture of a cube has room for
_PROCEDURAL = 96


def host_estimate(
    domains: tuple[DomainPlan, ...], receivers: tuple[ReceiverPlan, ...], depths: tuple[DepthPlan, ...]
) -> dict[str, int]:
    """Host memory by prim path of domain, receiver and light [bytes]."""
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
