"""A freshly simulated frame of a plume, and its shadow on a floor by fine rays: what smoke shadows are measured on."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import warp as wp

from warp_smoke.geometry import Mesh
from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher
from warp_smoke.scene import Emitter, PointLight, Scene, SmokeDomain
from warp_smoke.shadow.smoke_ray_traced import RayTracedSmokeShadow

RESOLUTION, FRAMES = 48, 30
EXTINCTION = 9.0
ORIGIN = np.zeros(3)
# Step of the reference rays [cells].
_FINE_STEP = 0.05
_FLOOR_POINTS = 128


class PlumeFrame(NamedTuple):
    """Smoke over a floor under a lamp.

    Attributes:
        lattice: its cells.
        density: [nx, ny, nz].
        lamp: the light.
        floor: points in y = 0, [n, 3].
        truth: share of the lamp's light that reaches each floor point, by fine rays, [n].
    """

    lattice: Lattice
    density: np.ndarray
    lamp: PointLight
    floor: np.ndarray
    truth: np.ndarray


def at(x: float, y: float, z: float) -> np.ndarray:
    """Returns a transform that moves the origin to (x, y, z)."""
    matrix = np.eye(4)
    matrix[3, :3] = x, y, z
    return matrix


@cache
def plume_frame(device: str) -> PlumeFrame:
    """Simulates a plume of `RESOLUTION` cells along a side; returns its last frame, the same for any thread count."""
    from warp_smoke.simulation import Simulation

    domain = SmokeDomain(
        path="/Smoke",
        transform=at(0, 1, 0),
        resolution=RESOLUTION,
        buoyancy_temperature=3.0,
        vorticity=1.0,
        grids=("density",),
    )
    source = Emitter(path="/Source", mesh=Mesh.sphere(0.25), transform=at(0.05, 0.45, 0))
    simulation = Simulation(Scene(domains=[domain], emitters=[source], end=FRAMES), device=device)
    for _ in range(FRAMES):
        simulation.step()
    lattice, density = simulation.plan.domains[0].lattice, simulation.density.numpy().copy()
    lamp = PointLight(path="/Lamp", transform=at(1.7, 2.2, 0.6), radius=0.05)
    along = np.linspace(-3.0, 3.0, _FLOOR_POINTS)
    floor = np.stack(np.meshgrid(along, [0.0], along), axis=-1).reshape(-1, 3)
    launcher = Launcher(device)
    fine = replace(lamp, smoke_shadow="ray_traced")
    rays = RayTracedSmokeShadow(launcher, lattice, fine, ORIGIN, EXTINCTION, step=_FINE_STEP)
    rays.update(launcher.array(density, "study"), 1.0)
    truth = launcher.array(np.ones((1, len(floor)), np.float32), "study")
    rays.transmittance(launcher.array(floor.astype(np.float32), "study", dtype=wp.vec3), truth)
    return PlumeFrame(lattice, density, lamp, floor, truth.numpy()[0].copy())
