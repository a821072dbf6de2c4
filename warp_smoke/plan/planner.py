"""The plan of a scene: walks back from the outputs, volume files and baked textures, to what they need."""

from warp_smoke.plan.fluid import plan_domain
from warp_smoke.plan.memory import memory_estimate
from warp_smoke.plan.passes import Ledger, Plan
from warp_smoke.plan.shading import plan_receivers
from warp_smoke.scene import Scene


def make_plan(scene: Scene) -> Plan:
    """Works out which passes a scene's outputs need.

    Raises:
        FieldError: a domain asks for a scheme that cannot serve it.
    """
    ledger = Ledger()
    if not scene.domains:
        ledger.omit("simulate", (), "the stage has no smoke domain")
    domains = tuple(plan for domain in scene.domains if (plan := plan_domain(ledger, scene, domain)))
    receivers = plan_receivers(ledger, scene, domains)
    estimate = memory_estimate(domains, receivers)
    return Plan(scene, ledger.in_order(), tuple(ledger.left_out.values()), domains, receivers, estimate)
