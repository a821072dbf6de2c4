"""The scene: everything that a stage describes."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from warp_smoke.record import FieldError, Record, at_least, one_of, positive, whole
from warp_smoke.scene.arrays import ArrayCollider, ArrayEmitter
from warp_smoke.scene.camera import Camera
from warp_smoke.scene.light import Light
from warp_smoke.scene.smoke import Collider, Emitter, SmokeDomain
from warp_smoke.scene.surface import Surface

AXES = ("X", "Y", "Z")

# Least time codes per second: over a frame of a million seconds, even the largest rates add up to numbers whose
# squares do not overflow.
_SLOWEST = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene(Record):
    """Everything that a stage describes.

    Attributes:
        domains, emitters, colliders, surfaces, lights: its contents; paths are unique within each kind.
        camera: the view for pictures and highlights, or None.
        start, end: first and last frame (time codes), both simulated.
        time_codes_per_second: frames per second, at least 1e-6.
        meters_per_unit: length of a stage unit [m].
        up_axis: X, Y or Z.
        ambient: light from all directions alike, linear RGB (USD: `DomeLight`).
        source: the stage's file, or None for a scene made in Python.
        warnings: what on the stage is not supported and was ignored or simplified; ignored by equality.
    """

    domains: tuple[SmokeDomain, ...] = ()
    emitters: tuple[Emitter | ArrayEmitter, ...] = ()
    colliders: tuple[Collider | ArrayCollider, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    lights: tuple[Light, ...] = ()
    camera: Camera | None = None
    ambient: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start: int = 1
    end: int = 48
    time_codes_per_second: float = 24.0
    meters_per_unit: float = 1.0
    up_axis: str = "Y"
    source: Path | None = field(default=None, compare=False)
    warnings: tuple[str, ...] = field(default=(), compare=False)

    def __post_init__(self):
        for name in ("domains", "emitters", "colliders", "surfaces", "lights"):
            records = tuple(getattr(self, name))
            self._store(name, records)
            paths = set()
            for record in records:
                if record.path in paths:
                    raise FieldError(record.path, "path", record.path, f"unique among the scene's {name}")
                paths.add(record.path)
        domains = [domain.path for domain in self.domains]
        for record in (*self.emitters, *self.colliders):
            if isinstance(record, ArrayEmitter | ArrayCollider) and record.domain not in (None, *domains):
                raise FieldError(record.path, "domain", record.domain, f"None or one of {', '.join(domains) or 'none'}")
        self._store("ambient", at_least("scene", "ambient", self.ambient, shape=(3,)))
        self._store("start", whole("scene", "start", self.start, -(10**9), 10**9))
        self._store("end", whole("scene", "end", self.end, self.start, 10**9))
        rate = positive("scene", "time_codes_per_second", self.time_codes_per_second)
        self._store("time_codes_per_second", at_least("scene", "time_codes_per_second", rate, _SLOWEST))
        self._store("meters_per_unit", positive("scene", "meters_per_unit", self.meters_per_unit))
        one_of("scene", "up_axis", self.up_axis, AXES)

    @property
    def up(self) -> np.ndarray:
        """The unit up vector, [3]."""
        return np.eye(3)[AXES.index(self.up_axis)]

    @property
    def frames(self) -> range:
        """The frames that are simulated."""
        return range(self.start, self.end + 1)

    @property
    def middle_frame(self) -> int:
        """The frame that is shown by default: the middle one, or the later of the two in the middle."""
        return self.frames[len(self.frames) // 2]

    def shadowing(self, light: Light) -> tuple[Surface, ...]:
        """Returns the surfaces that may block a light, according to its shadow linking and their materials."""
        return tuple(s for s in self.surfaces if s.casts_shadow and light.may_be_shadowed_by(s.path))

    @staticmethod
    def open(path: str | Path, camera: str | None = None) -> "Scene":
        """Reads a USD stage, seen from its own camera or the one at a prim path; see `warp_smoke.usd.read`."""
        from warp_smoke.usd.read import read_scene

        return read_scene(path, camera)

    def save(self, path: str | Path) -> None:
        """Writes the scene to a USD file; see `warp_smoke.usd.author`."""
        from warp_smoke.usd.author import author_scene

        author_scene(self, path)
