"""Shadows and bakes of a plan: which shadow falls on which receiver, and what is recomputed at each frame."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.plan import LightPlan, Plan, ReceiverPlan, When
from warp_smoke.plan.passes import VolumePlan, buffer_layers
from warp_smoke.plan.reach import box_corners, swept_corners
from warp_smoke.scene import Light
from warp_smoke.shading.bake import ReceiverBake
from warp_smoke.shading.volume import VolumeLight
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.methods import SMOKE_SHADOWS, SURFACE_SHADOWS
from warp_smoke.timing import Timings

# The largest linear value that rounds to black in an 8-bit sRGB picture: half a code on its linear segment.
_BLACK = 0.5 / 255 / 12.92
# A density above that of any smoke, whose sums over a box are still finite.
_FULL = 1e6


class Lighting:
    """Updates shadows and pictures for each frame, each as often as the plan says.

    Attributes:
        origin: world position of set space's origin, near the middle of everything lit, [3] float64.
        warnings: what could not be baked as asked and, after the first update, what is too dark to be seen.
    """

    def __init__(self, launcher: Launcher, plan: Plan, timings: Timings):
        self._launcher, self._plan, self._timings = launcher, plan, timings
        self.warnings: list[str] = []
        self._baked = False
        self._maps, self._bakes, self._volumes = {}, {}, {}
        # One hierarchy of triangles for all lights that the same surfaces shadow.
        self._casters: dict[tuple[str, ...] | None, Casters] = {}
        lit = self._lit = (*plan.receivers, *plan.volumes, *plan.depths)
        if not lit:
            return
        corners = [swept_corners(each.surface, plan.scene.frames) for each in plan.receivers]
        corners += [box_corners(each.domain.lattice) for each in plan.volumes]
        corners += [swept_corners(each.surface, plan.scene.frames) for each in plan.depths]
        everything = np.concatenate(corners)
        self.origin = 0.5 * (everything.min(axis=0) + everything.max(axis=0))

        shadowed: dict[str, list[np.ndarray]] = {}
        for each, points in zip(lit, corners, strict=True):
            bounds = np.stack([points.min(axis=0), points.max(axis=0)]) - self.origin
            for light in each.lights:
                if light.surface_shadow:
                    shadowed.setdefault(light.light.path, []).append(bounds)
        for each in (light for receiver in lit for light in receiver.lights):
            path = each.light.path
            if each.surface_shadow and path not in self._maps:
                make, camera = SURFACE_SHADOWS[each.surface_shadow], plan.scene.camera
                bounds = np.array(shadowed[path])
                self._maps[path] = make(launcher, each.light, self._casters_of(each.light), bounds, camera)
        self._smoke = self._smoke_shadows([light for each in lit for light in each.lights])

        self._bakes = {each.surface.path: self._bake(each) for each in plan.receivers}
        self._volumes = {each.domain.domain.path: self._volume(each) for each in plan.volumes}
        self.warnings += [warning for bake in self._bakes.values() for warning in bake.warnings]

    def _casters_of(self, light: Light) -> Casters:
        if light.shadowed_by not in self._casters:
            surfaces = self._plan.scene.shadowing(light)
            self._casters[light.shadowed_by] = Casters(self._launcher, surfaces, self.origin)
        return self._casters[light.shadowed_by]

    def _smoke_shadows(self, lights: list[LightPlan]) -> dict[tuple[str, str, str], object]:
        """Makes one smoke shadow for each light, domain and method; receivers share it."""
        layers, made = buffer_layers(lights), {}
        for each in lights:
            for domain, method, _ in each.smoke:
                key = (each.light.path, domain.domain.path, method)
                if key not in made:
                    light = replace(each.light, smoke_shadow=method, smoke_shadow_layer=layers[key])
                    args = (domain.lattice, light, self.origin, domain.domain.extinction)
                    made[key] = SMOKE_SHADOWS[method](self._launcher, *args, domain.domain.extinction_color)
        return made

    def _volume(self, each: VolumePlan) -> VolumeLight:
        lights = [(light.light, 3 if _is_colored(light) else 1) for light in each.lights]
        albedo, ambient = each.domain.domain.albedo, self._plan.scene.ambient
        shadowed = [light.light.path for light in each.lights if light.surface_shadow]
        return VolumeLight(self._launcher, each.domain.lattice, lights, self.origin, albedo, ambient, shadowed)

    def light_volumes(self, time: float, densities: Mapping[str, wp.array]) -> dict[str, np.ndarray]:
        """Computes the light that smoke scatters, [nx, ny, nz, 3] by domain path, with the shadows last updated."""
        found = {}
        for each in self._plan.volumes:
            path, smoke = each.domain.domain.path, {light.light.path: light for light in each.lights}

            def look_through(light: Light, points: wp.array, shares: wp.array, smoke: dict = smoke) -> None:
                self._look_through_smoke(smoke[light.path], points, shares)

            def look_past(light: Light, *look: wp.array) -> None:
                self._maps[light.path].visibility(*look)

            with self._timings.measure("light_volume"):
                found[path] = self._volumes[path].update(densities[path].numpy(), time, look_through, look_past)
        return found

    def _bake(self, each: ReceiverPlan) -> ReceiverBake:
        return ReceiverBake(
            self._launcher,
            each.surface,
            [light.light for light in each.lights],
            self.origin,
            bakes=each.bakes,
            ambient=self._plan.scene.ambient,
            camera=self._plan.scene.camera,
            shadowed=[light.light.path for light in each.lights if light.surface_shadow],
            smoke_shadowed=[light.light.path for light in each.lights if light.smoke],
            color_shadowed=[light.light.path for light in each.lights if _is_colored(light)],
        )

    def update(self, time: float, densities: Mapping[str, wp.array]) -> dict[tuple[str, str], np.ndarray]:
        """Updates everything to a time code.

        Args:
            time: time code.
            densities: [nx, ny, nz] of each domain, by path.

        Returns:
            Pixels of the pictures that changed, by receiver path and bake; float32 values at points for receivers
            whose texture coordinates cannot hold a picture. Shadow maps to be written are under their light's path
            and `depth`.
        """
        if not self._lit:
            return {}
        if self._casters:
            with self._timings.measure("place_casters"):
                for casters in self._casters.values():
                    casters.update(time)
            with self._timings.measure("trace_shadow_map"):
                for shadow in self._maps.values():
                    shadow.update(time)
        if not self._baked:
            self._limit_smoke(time, densities)
        with self._timings.measure("project_smoke"):
            for (_, domain, _), shadow in self._smoke.items():
                shadow.update(densities[domain], time)
        pictures = self._draw_depth_maps()
        for each in self._plan.receivers:
            pictures |= self._update_receiver(each, time)
        self._baked = True
        return pictures

    def follow(self, frames: range, densities: Mapping[str, wp.array]) -> None:
        """Restores the state after an update at each of these frames, without making pictures again.

        Args:
            frames: the frames that have been made.
            densities: [nx, ny, nz] of each domain, by path; what depends on them is recomputed at the next frame.
        """
        self.update(frames[0], densities)
        for casters in self._casters.values():
            casters.follow(frames)

    def _limit_smoke(self, time: float, densities: Mapping[str, wp.array]) -> None:
        """Finds the texels that smoke can ever shadow, where only smoke changes: those that full boxes shadow."""
        still = [each for each in self._plan.receivers if _only_smoke_changes(each)]
        if not still:
            return
        with self._timings.measure("find_smoke_reach"):
            for (_, domain, _), shadow in self._smoke.items():
                full = self._launcher.array(np.full(densities[domain].shape, _FULL, np.float32), "smoke_reach")
                shadow.update(full, time)
            for each in still:
                bake = self._bakes[each.surface.path]
                bake.update(time)
                reached = np.zeros(bake.map.count, bool)
                for light in each.lights:
                    if light.smoke:
                        shares = bake.transmittance[light.light.path]
                        self._look_through_smoke(light, bake.smoke_points, shares)
                        reached |= np.any(shares.numpy()[:, : len(reached)] < 1.0, axis=0)
                bake.limit_smoke(np.flatnonzero(reached))

    def _update_receiver(self, each: ReceiverPlan, time: float) -> dict[tuple[str, str], np.ndarray]:
        due = [bake for bake, when in each.bakes.items() if when == When.FRAME or not self._baked]
        if not due:
            return {}
        bake = self._bakes[each.surface.path]
        with self._timings.measure("shade_light"):
            bake.update(time)
        for light in each.lights:
            if light.surface_shadow and (light.when == When.FRAME or not self._baked):
                with self._timings.measure("surface_visibility"):
                    points, out = bake.map, bake.visibility[light.light.path]
                    look = (points.shadow_points, points.normals, out, points.facets)
                    self._maps[light.light.path].visibility(*look)
            if light.smoke:
                with self._timings.measure("smoke_transmittance"):
                    shares = bake.transmittance[light.light.path]
                    shares.fill_(1.0)
                    self._look_through_smoke(light, bake.smoke_points, shares)
        with self._timings.measure("bake"):
            pictures = bake.pictures(due)
        if not self._baked and "lit" in pictures and _is_black(pictures["lit"]):
            self.warnings += _too_dim(each, *bake.brightest_light())
        return {(each.surface.path, name): pixels for name, pixels in pictures.items()}

    def _look_through_smoke(self, each: LightPlan, points: wp.array, shares: wp.array) -> None:
        for smoke in each.smoke:
            shadow = self._smoke[each.light.path, smoke.domain.domain.path, smoke.method]
            shadow.transmittance(points, shares)

    def _draw_depth_maps(self) -> dict[tuple[str, str], np.ndarray]:
        """Draws those shadow maps to be written that may have changed."""
        due = [path for path, when in self._plan.depth_maps.items() if when == When.FRAME or not self._baked]
        if not due:
            return {}
        with self._timings.measure("write_depth_map"):
            return {(path, "depth"): self._maps[path].depth_picture() for path in due}

    def depth_pictures(self) -> dict[str, np.ndarray]:
        """Returns the depth maps by light path, uint8: a cross of six faces for a point light."""
        return {path: shadow.depth_picture() for path, shadow in self._maps.items() if hasattr(shadow, "depth_picture")}


def _only_smoke_changes(each: ReceiverPlan) -> bool:
    """Returns whether smoke may shadow a receiver for which nothing else changes: lights, casters or camera."""
    return any(light.smoke for light in each.lights) and all(light.when == When.ONCE for light in each.lights)


def _is_colored(light: LightPlan) -> bool:
    """Returns whether smoke dims some of the light's colours more than others."""
    return any(each.domain.domain.colors_light for each in light.smoke)


def _is_black(pixels: np.ndarray) -> bool:
    """Returns whether a lit picture, or lit values at points, are black everywhere."""
    return bool(pixels[..., :3].max(initial=0) <= (_BLACK if pixels.dtype == np.float32 else 0))


def _too_dim(each: ReceiverPlan, light: Light | None, value: float) -> tuple[str, ...]:
    """Warns of a black receiver if its lights are too dim, and not just hidden from it or off.

    Args:
        each: the receiver.
        light: its brightest light.
        value: the most that the receiver would reflect of this light without any shadow, linear.
    """
    if not 0.0 < value <= _BLACK:
        return ()
    meant = "is more exposure meant?" if light.normalize else "is inputs:normalize meant, or more exposure?"
    dim = f"its lit bake is black: the brightest light, {light.path}, gives {value:.1e} of white"
    return (f"{each.surface.path}: {dim}; {meant}",)
