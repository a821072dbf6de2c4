"""Smoke in a picture: its density at one time, cropped to the occupied box, and the light that it scatters."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from warp_smoke.lattice import Lattice, occupied_box
from warp_smoke.launch import Launcher
from warp_smoke.picture.light import PictureLight
from warp_smoke.picture.smoke_volume import SmokeVolume
from warp_smoke.scene import Light
from warp_smoke.shading.smoke_march import ScatteringSmoke
from warp_smoke.shading.volume import VolumeLight
from warp_smoke.shadow.light_buffer import set_to_cells

_STEP = 0.5  # between samples of a march [cells]


def scattering_smoke(
    launcher: Launcher,
    volume: SmokeVolume,
    lights: Sequence[PictureLight],
    ambient: tuple[float, float, float],
    origin: np.ndarray,
    time: float,
) -> ScatteringSmoke:
    """Returns the box around a domain's smoke with the light that it scatters.

    Args:
        launcher: where to compute.
        volume: the smoke; at least one cell is not empty.
        lights: all of the picture's.
        ambient: light from everywhere, linear RGB.
        origin: world position of set space's origin, [3] float64.
        time: time code.
    """
    density, lattice = _cropped(volume.density, volume.lattice)
    domain = volume.domain
    reaching = {each.light.path: each for each in lights if each.light.lights(domain.path)}
    channels = [(each.light, each.channels) for each in reaching.values()]
    shadowed = [path for path, each in reaching.items() if each.has_shadow]
    scattered = VolumeLight(launcher, lattice, channels, origin, domain.albedo, ambient, shadowed)

    def look_through(light: Light, points: wp.array, shares_inout: wp.array) -> None:
        reaching[light.path].look_through(points, shares_inout)

    def look_past(light: Light, *look: wp.array) -> None:
        reaching[light.path].look_past(*look)

    smoke = ScatteringSmoke()
    smoke.density = launcher.array(density, "smoke_light")
    light = scattered.update(density, time, look_through, look_past).reshape(-1, 3)
    smoke.light = launcher.array(light, "smoke_light", dtype=wp.vec3)
    smoke.from_set = wp.mat44(set_to_cells(lattice, origin).T.astype(np.float32))
    smoke.extinction = wp.vec3(*(domain.extinction * lattice.h * np.asarray(domain.extinction_color)))
    smoke.step = _STEP
    return smoke


def _cropped(density: np.ndarray, lattice: Lattice) -> tuple[np.ndarray, Lattice]:
    """Crops to the box of cells with smoke and one more on each side, where there is one."""
    box = tuple(slice(max(each.start - 1, 0), each.stop + 1) for each in occupied_box(density != 0.0))
    to_world = np.array(lattice.to_world)
    to_world[3, :3] += lattice.voxel_size * np.array([each.start for each in box]) @ lattice.axes
    cropped = np.ascontiguousarray(density[box])
    return cropped, replace(lattice, shape=cropped.shape, to_world=to_world)
