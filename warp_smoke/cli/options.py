"""Options shared by several commands, and groups of related options, which cyclopts flattens."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import warp_smoke

Output = Annotated[Path | None, Parameter(name=["--output", "-o"])]
Json = Annotated[bool, Parameter(name="--json")]


@Parameter(name="*")
@dataclass(frozen=True)
class SceneOptions:
    """The changes that a command makes to a stage's scene.

    Attributes:
        frames: First and last frame as A:B, or one frame as A; the stage's unless given.
        resolution: Cells along the longest side of every domain, instead of the stage's.
        bake_all: Bake every visible mesh, not only those with SmokeReceiverAPI.
        camera: Prim path of the camera that highlights are seen from; the stage's own unless given.
    """

    frames: str | None = None
    resolution: int | None = None
    bake_all: bool = False
    camera: str | None = None

    def open(self, stage: Path) -> "warp_smoke.Scene":
        """Returns the scene of a stage with these changes applied."""
        from warp_smoke.usd.probe import check_readable  # loads USD, which --help does not need

        check_readable(stage)
        scene = warp_smoke.Scene.open(stage, self.camera)
        if self.frames is not None:
            first, colon, last = self.frames.partition(":")
            try:
                scene = replace(scene, start=int(first), end=int(last if colon else first))
            except ValueError:
                allowed = "A:B, whole numbers with A ≤ B"
                raise ValueError(f"--frames is {self.frames}; allowed: {allowed}") from None
        if self.resolution is not None:
            finer = {"resolution": self.resolution}
            scene = replace(scene, domains=[replace(d, **finer, given=d.given | {*finer}) for d in scene.domains])
        if self.bake_all:
            scene = replace(scene, surfaces=[_baked(surface) for surface in scene.surfaces])
        return scene


@Parameter(name="*")
@dataclass(frozen=True)
class DeviceOptions:
    """Where a command runs.

    Attributes:
        device: cpu, cuda or cuda:N.
        threads: Number of CPU threads; all unless given.
    """

    device: str = "cpu"
    threads: int | None = None


def picture_size(text: str) -> tuple[int, int]:
    """Parses a picture's size, WIDTHxHEIGHT, into its width and height."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 0 < int(width) <= 8192 and 0 < int(height) <= 8192):
        raise ValueError(f"--size is {text}; allowed: WIDTHxHEIGHT, 1 to 8192 pixels each")
    return int(width), int(height)


def _baked(surface: "warp_smoke.Surface") -> "warp_smoke.Surface":
    """Returns the surface as a receiver if it can be one, else unchanged."""
    if surface.receiver or not surface.holds_bakes:
        return surface
    return replace(surface, receiver=warp_smoke.Receiver(path=surface.path))
