"""Planning: works back from the outputs, volume files and baked textures, to what they need."""

from pathlib import Path

from warp_smoke.plan.depth_maps import plan_depth_maps
from warp_smoke.plan.fluid import plan_domain
from warp_smoke.plan.memory import memory_estimate
from warp_smoke.plan.passes import Ledger
from warp_smoke.plan.plan import Plan
from warp_smoke.plan.shading import plan_receivers
from warp_smoke.plan.surface_shadow import SurfaceShadows
from warp_smoke.plan.volumes import plan_volumes
from warp_smoke.quality import choose_quality
from warp_smoke.scene import Scene


def make_plan(scene: Scene | str | Path, stirred_by: str = "", *, quality: str | None = None) -> Plan:
    """Works out which passes the outputs of a scene need.

    Args:
        scene: the scene, or the file of a stage.
        stirred_by: what moves the air besides the scene, such as a script's force; empty if nothing does.
        quality: a preset for what the scene leaves open: draft, preview or final.

    Raises:
        FieldError: a domain asks for a scheme that cannot serve it, or there is no such preset.
    """
    if not isinstance(scene, Scene):
        scene = Scene.open(scene)
    scene, chosen = (scene, None) if quality is None else choose_quality(scene, quality)
    ledger = Ledger()
    if not scene.domains:
        ledger.omit("simulate", (), "the stage has no smoke domain")
    domains = tuple(plan for domain in scene.domains if (plan := plan_domain(ledger, scene, domain, stirred_by)))
    shadows = SurfaceShadows(ledger, scene)
    receivers = plan_receivers(ledger, scene, domains, shadows)
    volumes = plan_volumes(ledger, scene, domains, shadows)
    depths = plan_depth_maps(ledger, scene, shadows)
    shadows.note_maps()
    estimate = memory_estimate(scene, domains, receivers, volumes, depths)
    left_out = tuple(ledger.left_out.values())
    return Plan(scene, ledger.in_order(), left_out, domains, receivers, volumes, depths, estimate, chosen)
