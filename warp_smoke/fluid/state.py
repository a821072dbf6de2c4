"""The state of the simulation: the fields of one domain."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import warp as wp

from warp_smoke.fluid.grid import face_shape
from warp_smoke.launch import Launcher


@dataclass
class SmokeState:
    """Fields on a staggered grid; those that no pass needs are None.

    Advection swaps the arrays, so get them again after each step.

    Attributes:
        velocity: u [nx+1, ny, nz], v [nx, ny+1, nz], w [nx, ny, nz+1] on faces, along the lattice's axes [m/s].
        density: at cell centres, [nx, ny, nz].
        temperature: at cell centres, [nx, ny, nz].
        pressure: dt p / h at cell centres, [nx, ny, nz] [m/s]: first guess of the next projection.
        energy_lost: kinetic energy that advection has removed since the last projection, ½ Σ u² over faces [m²/s²];
            vorticity confinement may restore this much.
    """

    velocity: tuple[wp.array, wp.array, wp.array] | None = None
    density: wp.array | None = None
    temperature: wp.array | None = None
    pressure: wp.array | None = None
    energy_lost: float = 0.0

    def save(self) -> dict[str, np.ndarray]:
        """Copies the state to the host, by name."""
        fields = {f"velocity {axis}": each for axis, each in zip("xyz", self.velocity or (), strict=False)}
        fields |= {"density": self.density, "temperature": self.temperature, "pressure": self.pressure}
        saved = {name: field.numpy().copy() for name, field in fields.items() if field is not None}
        return saved | {"energy_lost": np.array(self.energy_lost)}

    def load(self, saved: Mapping[str, np.ndarray]) -> None:
        """Restores what `save` returned."""
        if self.velocity is not None:
            for axis, component in zip("xyz", self.velocity, strict=True):
                component.assign(saved[f"velocity {axis}"])
        for name in ("density", "temperature", "pressure"):
            if (field := getattr(self, name)) is not None:
                field.assign(saved[name])
        self.energy_lost = float(saved["energy_lost"])


def make_state(
    launcher: Launcher, shape: tuple[int, int, int], passes: frozenset[str], ambient_temperature: float
) -> SmokeState:
    """Makes still air at ambient temperature, with the fields that the passes work on.

    Args:
        launcher: where it runs.
        shape: cells along each axis (nx, ny, nz).
        passes: names of the passes.
        ambient_temperature: temperature of the air.
    """
    state = SmokeState()
    if "emit_density" in passes:
        state.density = launcher.zeros(shape, "density")
    if "emit_temperature" in passes:
        state.temperature = launcher.zeros(shape, "temperature")
        state.temperature.fill_(ambient_temperature)
    if "project_pressure" in passes:
        state.velocity = tuple(launcher.zeros(face_shape(shape, axis), "velocity") for axis in range(3))
        state.pressure = launcher.zeros(shape, "pressure")
    return state
