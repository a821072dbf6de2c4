"""Estimates of device memory, before anything is allocated."""

from warp_smoke.plan.passes import DomainPlan, ReceiverPlan


def domain_bytes(plan: DomainPlan) -> int:
    """Device memory of a domain's solver [bytes]."""
    fields = 20 if "advect_density" in plan.passes else 2
    return plan.lattice.cells * 4 * fields


def receiver_bytes(plan: ReceiverPlan) -> int:
    """Device memory of a receiver's bake [bytes]."""
    return plan.surface.receiver.texture_size**2 * (40 + 20 * len(plan.lights))
