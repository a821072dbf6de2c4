"""Estimates of device memory, before anything is allocated."""

from warp_smoke.plan.passes import DomainPlan, ReceiverPlan


def domain_bytes(plan: DomainPlan) -> int:
    """Device memory of a domain's solver [bytes]."""
    fields = 20 if "advect_density" in plan.passes else 2
    return plan.lattice.cells * 4 * fields


def receiver_bytes(plan: ReceiverPlan) -> int:
    """Device memory of a receiver's bake, for a texture that the surface fills [bytes]."""
    places = 68  # points, normals, uvs, triangle and weights of each texel, and the picture's codes
    shares = 8 if {"visibility", "smokeShadow"} & set(plan.bakes) else 0
    for light in plan.lights:
        places += 12 * ("lit" in plan.bakes) + 4 * bool(light.surface_shadow) + 4 * bool(light.smoke) + shares // 2
    return plan.surface.receiver.texture_size**2 * (places + shares // 2)
