"""The error for a field that is not finite, which is detected in measures that each step takes anyway."""

from collections.abc import Sequence
from math import ceil, isfinite
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warp_smoke.fluid.measures import Measures
from warp_smoke.fluid.state import SmokeState
from warp_smoke.timing import Timings

if TYPE_CHECKING:
    from warp_smoke.plan import DomainPlan

# Passes that write velocity before the pressure, and passes that write scalars, in their order.
_FORCES = ("emit_velocity", "confine_vorticity", "add_buoyancy", "stir_air", "on_substep", "diffuse_velocity")
_LAST = {
    "density": ("emit_density", "advect_density", "diffuse_density", "dissipate_density"),
    "temperature": ("emit_temperature", "advect_temperature", "diffuse_temperature", "cool_temperature"),
}
# A time code that exceeds a frame by no more than this still belongs to that frame.
_ROUND_OFF = 1e-5


class NotFiniteError(FloatingPointError):
    """Raised when a field holds NaN or infinity, or numbers too large to be squared.

    Attributes:
        path: path of the domain.
        field: density, temperature or velocity.
        frame: the frame being made.
        after: the last pass that wrote the field.
        index: index of the first such sample, (i, j, k), for velocity preceded by the component's number.
    """

    def __init__(self, path: str, field: str, arrays: Sequence[wp.array], frame: int, after: str):
        """Finds the first sample that is not finite, or else the largest.

        Args:
            path: path of the domain.
            field: name of the field.
            arrays: the field, or its components along x, y, z.
            frame: the frame being made.
            after: the last pass that wrote the field.
        """
        values = [each.numpy() for each in arrays]
        bad = [~np.isfinite(each) for each in values]
        number = next((n for n, each in enumerate(bad) if each.any()), None)
        if number is None:
            number = int(np.argmax([np.abs(each).max() for each in values]))
            bad[number] = np.abs(values[number]) == np.abs(values[number]).max()
        cell = tuple(np.argwhere(bad[number])[0].tolist())
        place = f"on face {'uvw'[number]}{list(cell)}" if len(values) == 3 else f"in cell {list(cell)}"
        value = values[number][cell]
        super().__init__(f"{path}: {field} is {value:g} {place} at frame {frame}, after {after}")
        self.path, self.field, self.frame, self.after = path, field, frame, after
        self.index = (number, *cell) if len(values) == 3 else cell


class Guard:
    """Measures the fields of one domain, and raises an error if one is not finite.

    Attributes:
        measures: measures of the lattice; None if no air moves.
        time: time code at the end of the current step.
        interferes: whether a script has acted on the velocity among the forces.
        density, temperature: their largest departure from ambient at the last check.
    """

    def __init__(
        self,
        plan: "DomainPlan",
        timings: Timings,
        state: SmokeState,
        measures: Measures | None,
        divergence: wp.array | None,
    ):
        """Prepares to check a domain's fields.

        Args:
            plan: the domain and what runs in it.
            timings: records the time that measuring takes.
            state: state of the smoke.
            measures: measures of the lattice; None if no air moves.
            divergence: divergence of the velocity before each projection; None if no air moves.
        """
        self._divergence = divergence
        self._domain, self._passes, self._timings, self._state = plan.domain, frozenset(plan.passes), timings, state
        self.measures, self.time, self.interferes = measures, 0.0, False
        self.density = self.temperature = 0.0

    def motion(self, after: str) -> tuple[float, float]:
        """Measures the largest speed [m/s] and the kinetic energy [m²/s²].

        Args:
            after: the last pass that wrote the velocity.

        Raises:
            NotFiniteError: the velocity is not finite.
        """
        with self._timings.measure("measure_motion"):
            speed, energy = self.measures.motion(self._state.velocity)
        if not isfinite(energy):
            fields = self._state.velocity
            # The pressure spreads values that are not finite; the divergence shows where they were before.
            if after == "project_pressure" and not np.isfinite(self._divergence.numpy()).all():
                fields, after = [self._divergence], self._last_force()
            raise NotFiniteError(self._domain.path, "velocity", fields, self._frame, after)
        return speed, energy

    def _last_force(self) -> str:
        """Returns the last pass that wrote the velocity before the projection."""
        acting = [each for each in _FORCES if each in self._passes or (each == "on_substep" and self.interferes)]
        return acting[-1] if acting else "advect_velocity"

    def check_scalars(self, after: str | None = None) -> None:
        """Measures the largest departures of density and temperature from ambient.

        Args:
            after: what wrote them; unless given, the last pass that writes them.

        Raises:
            NotFiniteError: one of them is not finite.
        """
        self.density = self._departure("density", 0.0, after)
        self.temperature = self._departure("temperature", self._domain.ambient_temperature, after)

    def _departure(self, name: str, ambient: float, after: str | None) -> float:
        scalar = getattr(self._state, name)
        if scalar is None:
            return 0.0
        with self._timings.measure("measure_motion"):
            departure = self.measures.departure(scalar, ambient) if self.measures else np.abs(scalar.numpy()).max()
        if not isfinite(departure):
            last = [each for each in _LAST[name] if each in self._passes][-1]
            raise NotFiniteError(self._domain.path, name, [scalar], self._frame, after or last)
        return float(departure)

    @property
    def _frame(self) -> int:
        """The frame being made."""
        return ceil(self.time - _ROUND_OFF)
