"""Planning of the lights, shadows and bakes that the receivers need."""

import numpy as np

from warp_smoke.plan.passes import DomainPlan, Ledger, LightPlan, ReceiverPlan, SmokeShadowPlan, When
from warp_smoke.plan.reach import box_corners, in_box, in_range, is_moving, may_shadow, over, swept_corners
from warp_smoke.plan.surface_shadow import SurfaceShadows, casters_change, casters_on
from warp_smoke.record import Samples
from warp_smoke.scene import Light, Scene, Surface
from warp_smoke.shadow.light_buffer import TOUCH, buffer_serves, light_times
from warp_smoke.shadow.projective import plane_serves

# Slices of the domain in each layer of a light buffer that is looked up inside the smoke.
DEFAULT_LAYER = 2


def plan_receivers(
    ledger: Ledger, scene: Scene, domains: tuple[DomainPlan, ...], shadows: SurfaceShadows
) -> tuple[ReceiverPlan, ...]:
    """Plans every bake of a surface's points, and the lights and shadows that it needs."""
    candidates = [surface for surface in scene.surfaces if surface.receiver is not None]
    if not candidates:
        ledger.omit("bake", (), "no mesh has SmokeReceiverAPI, so no light, shadow or texture is computed")
        return ()
    lights = lights_that_shine(ledger, scene)
    receivers = []
    for surface in candidates:
        bakes = surface.receiver.surface_bakes
        if why := why_unseen(scene, surface):
            ledger.omit("bake", (surface.path,), why)
        elif not surface.receiver.bake:
            ledger.omit("bake", (surface.path,), "smoke:bake names no texture")
        elif bakes and not lights and not any(scene.ambient) and "normal" not in bakes:
            ledger.omit("bake", (surface.path,), "no light shines on it")
        elif bakes:
            receivers.append(_Receiver(ledger, scene, surface, domains, shadows).plan(lights))
    return tuple(receivers)


def why_unseen(scene: Scene, surface: Surface) -> str:
    """Returns why nothing can be baked for a surface, whichever bakes it asks for; empty if something can."""
    if not np.any(over(surface.visible, scene.frames)):
        return "it is invisible at every frame"
    return "" if len(surface.mesh.triangles) else "it has no triangles"


def lights_that_shine(ledger: Ledger, scene: Scene) -> list[Light]:
    """Returns the lights that are ever on, and records the others in the ledger."""
    return [light for light in scene.lights if _shines(ledger, scene, light)]


def _shines(ledger: Ledger, scene: Scene, light: Light) -> bool:
    if not np.any(over(light.enabled, scene.frames)):
        ledger.omit("light", (light.path,), "it is off at every frame")
    elif not light.shines:
        ledger.omit("light", (light.path,), "its intensity or colour is 0 at every frame")
    else:
        return True
    return False


class _Receiver:
    """Plans one receiver."""

    def __init__(
        self,
        ledger: Ledger,
        scene: Scene,
        surface: Surface,
        domains: tuple[DomainPlan, ...],
        shadows: SurfaceShadows,
    ):
        self.ledger, self.scene, self.surface, self.domains, self.shadows = ledger, scene, surface, domains, shadows
        self.corners = swept_corners(surface, scene.frames)

    def plan(self, lights: list[Light]) -> ReceiverPlan:
        """Returns the bakes of the receiver and what each light contributes to them."""
        path = self.surface.path
        reaching = []
        for light in lights:
            if not light.lights(path):
                self.ledger.omit("shade_light", (path, light.path), "its lightLink leaves the surface out")
            elif in_range(light, self.corners, self.scene.frames):
                reaching.append(self._light(light))
            else:
                self.ledger.omit("shade_light", (path, light.path), f"{path} lies beyond its falloffEnd")
        moves = is_moving(self.surface) or any(each.when == When.FRAME for each in reaching)
        smoky = any(each.smoke for each in reaching)
        kept = {}
        for bake in self.surface.receiver.surface_bakes:
            if bake == "visibility" and not any(each.surface_shadow for each in reaching):
                self.ledger.omit("bake", (path, bake), "nothing casts a shadow on it")
            elif bake == "smokeShadow" and not smoky:
                self.ledger.omit("bake", (path, bake), "no smoke can shadow it")
            else:
                kept[bake] = When.FRAME if self._changes(bake, moves, smoky) else When.ONCE
                self.ledger.keep("bake", (path, bake), kept[bake], f"{bake} texture", "smoke:bake asks for it")
        return ReceiverPlan(self.surface, kept, tuple(reaching))

    def _changes(self, bake: str, moves: bool, smoky: bool) -> bool:
        """Returns whether a bake changes over time, given whether anything moves and whether smoke shadows it."""
        if bake != "normal":
            return moves or (smoky and bake != "visibility")
        eyes = [self.scene.camera] if self.scene.camera and self._relief else []
        return is_moving(self.surface, *eyes)

    @property
    def _relief(self) -> bool:
        return any(material.has_relief for material in self.surface.materials)

    def _light(self, light: Light) -> LightPlan:
        pair = (self.surface.path, light.path)
        bakes = set(self.surface.receiver.bake)
        casters = self._casters(light) if bakes & {"lit", "irradiance", "visibility"} else []
        varies = any(isinstance(value, Samples) for value in (light.intensity, light.enabled))
        # A highlight follows the camera.
        still = [light, self.surface, *([self.scene.camera] if self.scene.camera else [])]
        when = When.FRAME if varies or casters_change(casters) or is_moving(*still) else When.ONCE
        method = self.shadows.plan(light, casters, self.surface.path, self.corners, when) if casters else None
        smoke = self._smoke(light) if bakes & {"lit", "irradiance", "smokeShadow"} else ()
        if smoke:
            why = f"smoke in {', '.join(each.domain.domain.path for each in smoke)} may stand between the light and it"
            self.ledger.keep("smoke_transmittance", pair, When.FRAME, "share of light through smoke", why)
        self.ledger.keep("shade_light", pair, when, "radiance", "the light shines on it")
        return LightPlan(light, method, smoke, when)

    def _casters(self, light: Light) -> list[Surface]:
        if not light.shadow_enable:
            why = f"{light.path} has shadows switched off"
        elif not self.surface.receiver.receive_shadow:
            why = "smoke:receiveShadow is false"
        else:
            casters = casters_on(self.scene, light, self.surface, self.corners)
            if casters:
                return casters
            why = "nothing stands between the light and it"
        self.ledger.omit("surface_visibility", (self.surface.path, light.path), why)
        return []

    def _smoke(self, light: Light) -> tuple[SmokeShadowPlan, ...]:
        pair = (self.surface.path, light.path)
        if not self.domains:
            self.ledger.omit("smoke_transmittance", pair, "there is no smoke")
            return ()
        if not light.shadow_enable:
            self.ledger.omit("smoke_transmittance", pair, f"{light.path} has shadows switched off")
            return ()
        if not self.surface.receiver.receive_smoke:
            self.ledger.omit("smoke_transmittance", pair, "smoke:receiveSmoke is false")
            return ()
        found = []
        for each in self.domains:
            if not each.domain.dims_light:
                why = "extinction is 0, so its smoke casts no shadow"
                self.ledger.omit("project_smoke", (each.domain.path, *pair), why)
            elif not light.may_be_shadowed_by(each.domain.path):
                why = f"the shadowLink of {light.path} leaves the smoke out"
                self.ledger.omit("project_smoke", (each.domain.path, *pair), why)
            elif not may_shadow(light, box_corners(each.lattice), self.corners, self.scene.frames):
                why = "its smoke never stands between the light and the surface"
                self.ledger.omit("project_smoke", (each.domain.path, *pair), why)
            else:
                inside = in_box(each.lattice, self.corners, TOUCH)
                layer = light.smoke_shadow_layer or (DEFAULT_LAYER if inside else None)
                found.append(SmokeShadowPlan(each, self._smoke_method(light, each), layer))
        return tuple(found)

    def _smoke_method(self, light: Light, each: DomainPlan) -> str:
        pair = (light.path, each.domain.path)
        method = light.smoke_shadow
        serves = plane_serves if method == "dpd" else buffer_serves
        times = (*self.scene.frames, *light_times(light))  # the buffer has the largest size that any of them needs
        if method != "ray_traced" and not serves(light, each.lattice, times):
            why = "the light is inside the domain or close to it, where no buffer can hold its shadow: rays are traced"
            self.ledger.omit("project_smoke", pair, why)
            return "ray_traced"
        if method == "ray_traced":
            self.ledger.omit("project_smoke", pair, "the light asks for ray_traced, which needs no buffer")
        else:
            why = f"smoke in {each.domain.path} casts a shadow"
            self.ledger.keep("project_smoke", pair, When.FRAME, "light buffer", why, method)
        return method
