"""What the tests of hard cases share: whole frames of a small scene, the same scene put differently, and differences.

Tests pass figures to pytest's `record_property`; `scripts/stability.py` writes the largest of each into
docs/stability.md.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scenes import at, floor, shining

import warp_smoke as ws
from warp_smoke.fluid import solver, transport
from warp_smoke.simulation import Simulation

CLOSED = ("closed",) * 6
BALL = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 12), transform=at(0.1, 1.2, 0.0))


def small_plume(texture_size: int = 16, **domain) -> ws.Scene:
    """Smoke over a baked floor, a cube beside it, a point and a distant light; 10³ cells, 3 frames."""
    fields = {"resolution": 10, "buoyancy_temperature": 4.0, "grids": ("density", "temperature", "velocity")} | domain
    maps = {"shadow_map_size": 64}
    return ws.Scene(
        domains=[ws.SmokeDomain(path="/World/Smoke", transform=at(0, 1, 0), **fields)],
        emitters=[ws.Emitter(path="/World/Source", mesh=ws.Mesh.sphere(0.25, 12), transform=at(0.1, 0.4, -0.1))],
        surfaces=[floor(texture_size=texture_size), CUBE],
        lights=[
            ws.PointLight(path="/World/Lamp", transform=at(1.5, 3.5, 1.0), intensity=60.0, radius=0.1, **maps),
            ws.DistantLight(path="/World/Sun", transform=shining((-0.4, -1.0, 0.2)), intensity=2.0, **maps),
        ],
        end=3,
    )


CUBE = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.4), transform=at(0.9, 1.4, 0.3))


def with_domain(scene: ws.Scene, **changes) -> ws.Scene:
    """The scene with changes to its only domain."""
    return replace(scene, domains=[replace(scene.domains[0], **changes)])


def simulate(scene: ws.Scene, **options) -> tuple[Simulation, list[ws.Frame]]:
    """All frames of a scene."""
    simulation = Simulation(scene, **options)
    return simulation, [simulation.step() for _ in scene.frames]


def take_few_steps(patch: pytest.MonkeyPatch) -> None:
    """Frames of at most four steps, in four parts each, so that the fastest air takes no longer than the rest."""
    for module in (solver, transport):
        patch.setattr(module, "MAX_PARTS", 4)


def refusal(call: Callable[[], object], *kinds: type[Exception]) -> str | None:
    """The one line of a ValueError (or another kind) that a call raises; None if it raises none."""
    try:
        call()
    except (ValueError, *kinds) as error:
        line = str(error)
    else:
        return None
    assert "\n" not in line
    return line


def smoke_of(frame: ws.Frame) -> ws.Smoke:
    """The only domain's fields."""
    (smoke,) = frame.smoke.values()
    return smoke


def check_finite(frames: list[ws.Frame]) -> None:
    """Everything in the frames is finite, and no smoke is negative."""
    for frame in frames:
        for path, smoke in frame.smoke.items():
            for name in ("density", "temperature", "velocity", "light"):
                values = getattr(smoke, name)
                assert values is None or np.all(np.isfinite(values)), f"{path}: {name}"
            assert smoke.density is None or smoke.density.min(initial=0.0) >= 0.0, path
        for key, picture in frame.pictures.items():
            assert np.all(np.isfinite(picture)), key


def field_difference(one: list[ws.Frame], two: list[ws.Frame], name: str = "density") -> float:
    """Largest difference of a field, as a share of its largest value."""
    pairs = [(getattr(smoke_of(a), name), getattr(smoke_of(b), name)) for a, b in zip(one, two, strict=True)]
    return max(float(np.abs(a - b).max() / np.abs(a).max()) for a, b in pairs if np.any(a))


def picture_difference(one: list[ws.Frame], two: list[ws.Frame]) -> int:
    """Largest difference between the codes of two runs' pictures."""
    largest = 0
    for a, b in zip(one, two, strict=True):
        assert a.pictures.keys() == b.pictures.keys()
        for key, picture in a.pictures.items():
            largest = max(largest, int(np.abs(picture.astype(int) - b.pictures[key].astype(int)).max()))
    return largest


def placed_by(scene: ws.Scene, matrix: np.ndarray) -> ws.Scene:
    """The scene with everything put through one more transform."""

    def put(prim):
        return replace(prim, transform=prim.transform @ matrix)

    kinds = ("domains", "emitters", "colliders", "surfaces", "lights")
    changes = {kind: [put(prim) for prim in getattr(scene, kind)] for kind in kinds}
    return replace(scene, camera=scene.camera and put(scene.camera), **changes)
