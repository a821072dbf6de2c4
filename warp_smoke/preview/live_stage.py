"""A scene as it is drawn while it is simulated."""

from collections.abc import Mapping

import numpy as np

from warp_smoke.lattice import place_lattice
from warp_smoke.preview.grids import centers_to_world
from warp_smoke.preview.lights import lights_of
from warp_smoke.preview.stage import Frame, light_smoke
from warp_smoke.scene import Scene
from warp_smoke.simulation import Frame as SimulatedFrame


class LiveStage:
    """A scene as it is drawn while it is simulated, with the attributes of `PreviewStage` that drawing needs."""

    def __init__(self, scene: Scene):
        self.scene = scene
        self.lights, self.ambient = lights_of(scene)
        self.volumes = len(scene.domains)
        self.has_results = False
        self._lattices = {domain.path: place_lattice(scene, domain) for domain in scene.domains}
        self._pictures: dict[str, np.ndarray] = {}
        self._colors: dict[str, np.ndarray] = {}

    def full_frame(self) -> Frame:
        """Returns a frame full of smoke, as slow to draw as any."""
        full = {path: np.ones(lattice.shape, np.float32) for path, lattice in self._lattices.items()}
        return self._frame(self.scene.start, full, {})

    def empty_frame(self) -> Frame:
        """Returns a frame without smoke, shown until the first one is simulated."""
        return self._frame(self.scene.start, {}, {})

    def frame(self, made: SimulatedFrame) -> Frame:
        """Returns a simulated frame in the form in which it is drawn."""
        for (path, bake), values in made.pictures.items():
            if bake == "lit":
                (self._pictures if values.dtype in (np.uint8, np.uint16) else self._colors)[path] = values
        densities = {path: fields.density for path, fields in made.smoke.items()}
        return self._frame(made.number, densities, {path: fields.light for path, fields in made.smoke.items()})

    def _frame(
        self,
        number: int,
        densities: Mapping[str, np.ndarray | None],
        scattered: Mapping[str, np.ndarray | None],
    ) -> Frame:
        smoke = []
        for domain in self.scene.domains:
            density, extinction = densities.get(domain.path), domain.extinction * self.scene.meters_per_unit
            if density is None or not extinction:
                smoke.append(None)
                continue
            to_world = centers_to_world(self._lattices[domain.path])
            light = scattered.get(domain.path)
            smoke.append(light_smoke(density, to_world, extinction, self.lights, self.ambient, number, light))
        return Frame(number, tuple(smoke), dict(self._pictures), dict(self._colors))
