"""The plan of a scene: its passes, the memory that they need, and its warnings."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

from warp_smoke.plan.doubts import (
    dark_receivers,
    filled_domains,
    idle_emitters,
    open_meshes,
    small_emitters,
)
from warp_smoke.plan.host_memory import host_estimate
from warp_smoke.plan.passes import DepthPlan, DomainPlan, LeftOut, Pass, ReceiverPlan, VolumePlan, When
from warp_smoke.quality import Chosen
from warp_smoke.scene import Scene


@dataclass(frozen=True)
class Plan:
    """What is run for a scene.

    Attributes:
        passes: in the order in which they run.
        left_out: what is not run.
        domains, receivers, volumes, depths: the same passes in the form that the executor reads.
        bytes: estimate of device memory by prim path [bytes].
        chosen: settings chosen by a quality preset, an error bound or a time budget; None = all are the scene's.
    """

    scene: Scene
    passes: tuple[Pass, ...]
    left_out: tuple[LeftOut, ...]
    domains: tuple[DomainPlan, ...]
    receivers: tuple[ReceiverPlan, ...]
    volumes: tuple[VolumePlan, ...]
    depths: tuple[DepthPlan, ...]
    bytes: dict[str, int]
    chosen: Chosen | None = None

    @property
    def depth_maps(self) -> dict[str, When]:
        """The lights whose shadow maps are written as pictures, by path, and how often."""
        return {light.light.path: light.when for each in self.depths for light in each.lights}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user asked for but does not get (smoke, bakes, maps), idle or tiny emitters, and doubtful meshes."""
        marked = {each.path for each in self.scene.domains} | {each.path for each in self.scene.surfaces}
        missing = (
            f"{out.subjects[0]}: {out.why}"
            for out in self.left_out
            if out.name in ("simulate", "bake") and len(out.subjects) == 1 and out.subjects[0] in marked
        )
        start = self.scene.start
        doubts = (
            idle_emitters(self.scene, self.domains),
            small_emitters(self.domains, start),
            filled_domains(self.domains, start),
            open_meshes(self.domains),
            dark_receivers(self.receivers, start),
        )
        return (*missing, *self._missing_maps(), *chain(*doubts))

    def _missing_maps(self) -> Iterator[str]:
        """Yields warnings for receivers that bake `depth` but get no map, and for lights that have no map for them."""
        for out in self.left_out:
            if out.name == "write_depth_map":
                path, *receivers = out.subjects
                yield f"{path}: no depth map{' for ' * bool(receivers)}{', '.join(receivers)}: {out.why}"

    @property
    def memory(self) -> str:
        """The estimates as one line of text."""
        device, host = (sum(each.values()) / 2**20 for each in (self.bytes, self.host_bytes))
        return f"Memory, estimated: {device:.0f} MiB on the device, {host:.0f} MiB for results waiting to be written"

    @property
    def host_bytes(self) -> dict[str, int]:
        """Estimate of host memory, apart from the device's, by prim path [bytes]."""
        return host_estimate(self.domains, self.receivers, self.depths)

    def check_memory(self, available: int, device: str = "cpu") -> None:
        """Refuses a plan that needs more memory than is free.

        Args:
            available: free memory of the device [bytes].
            device: on the CPU, the results waiting to be written count too.

        Raises:
            MemoryError: it does; the message names both sizes and a resolution that would fit, if there is one.
        """
        parts = dict(self.bytes)
        if device == "cpu":
            parts = {path: parts.get(path, 0) + self.host_bytes.get(path, 0) for path in parts | self.host_bytes}
        needed = sum(parts.values())
        if needed <= available:
            return
        largest = max(each.domain.resolution for each in self.domains) if self.domains else None
        fluid = sum(parts[each.domain.path] for each in self.domains)
        left = available - (needed - fluid)
        line = f"the plan needs {needed / 2**20:.0f} MiB of memory and {available / 2**20:.0f} MiB are free"
        if largest and left > 0:
            line += f"; --resolution {max(1, int(0.98 * largest * (left / fluid) ** (1 / 3)))} would fit"
        raise MemoryError(line)

    def __str__(self) -> str:
        runs = [f"  {each}" for each in self.passes] or ["  nothing"]
        rests = [f"  {each}" for each in self.left_out]
        chosen = [str(self.chosen)] if self.chosen else []
        return "\n".join([*chosen, "Runs, in this order:", *runs, "Left out:", *rests, self.memory])
