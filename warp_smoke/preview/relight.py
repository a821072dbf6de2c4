"""Baked light recomputed with some of the lights off or without shadows.

A shadow cannot be removed from a baked texture. So the package's bake runs again for the frame that is shown, on the
CPU, with the stage's materials, the texture's size, and the smoke of the volume files; no fluid is simulated.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from warp_smoke.kernels import kernel_modules
from warp_smoke.lattice import Lattice, place_lattice
from warp_smoke.launch import Launcher, load_kernels
from warp_smoke.lighting import Lighting
from warp_smoke.plan import make_plan
from warp_smoke.preview.grids import centers_to_world, lay_over
from warp_smoke.scene import Receiver, Scene, SmokeDomain, Surface
from warp_smoke.timing import Timings

# Density of each domain at its voxels, and the matrix from voxel index to world position of the centre.
Densities = Mapping[str, tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Switches:
    """Which light and shadows are on.

    Attributes:
        off: paths of the lights that do not shine.
        shadows: whether surfaces and smoke shadow surfaces; smoke is always shadowed.
    """

    off: frozenset[str] = frozenset()
    shadows: bool = True


class Relighting:
    """Bakes of a stage under other light.

    Attributes:
        pictures: the latest bakes by surface path, sRGB [h, w, 3 or 4], or linear RGB at points [n, 3]; the same arrays
            while nothing changes.
    """

    def __init__(self, scene: Scene, sizes: Mapping[str, int], densities: Densities, switches: Switches):
        """Plans the bakes and loads their kernels.

        Args:
            scene: what is on the stage, with its original materials.
            sizes: texels along a side, by the path of each baked surface.
            densities: of any frame.
            switches: which light and shadows are on.
        """
        lit = replace(
            scene,
            surfaces=[_receiving(each, sizes.get(each.path), switches.shadows) for each in scene.surfaces],
            lights=[each for each in scene.lights if each.path not in switches.off],
            domains=[_refined(scene, each, densities) for each in scene.domains],
        )
        plan = replace(make_plan(lit), passes=(), domains=())  # no fluid
        lights = [light for each in (*plan.receivers, *plan.volumes) for light in each.lights]
        smoke = {each.domain.domain.path for light in lights for each in light.smoke}
        smoke |= {each.domain.domain.path for each in plan.volumes}
        missing = sorted(smoke - densities.keys())
        if missing:
            raise ValueError(f"{missing[0]}: no volume has its density, so its shadow cannot be recomputed")
        launcher = self._launcher = Launcher("cpu")
        load_kernels(kernel_modules(plan), "cpu")
        self._lattices = {each.path: place_lattice(lit, each) for each in lit.domains if each.path in smoke}
        self._lighting = Lighting(launcher, plan, Timings(launcher))
        self.pictures: dict[str, np.ndarray] = {}

    def update(self, number: int, densities: Densities) -> dict[str, np.ndarray]:
        """Updates the pictures to a frame.

        Returns:
            The light that each domain's smoke scatters at its voxels, linear RGB [nx, ny, nz, 3], for domains with a
            grid `light` on the stage.

        Raises:
            ValueError: a volume's voxels are not where its domain's cells are.
        """
        smoke = {
            path: self._launcher.array(_in_cells(path, lattice, *densities[path]), "smoke")
            for path, lattice in self._lattices.items()
        }
        made = self._lighting.update(number, smoke)
        self.pictures |= {path: picture for (path, _), picture in made.items()}
        scattered = {}
        for path, light in self._lighting.light_volumes(number, smoke).items():
            values, to_world = densities[path]
            scattered[path] = lay_over(values.shape, to_world, light, centers_to_world(self._lattices[path]))
        return scattered


def _receiving(surface: Surface, size: int | None, shadows: bool) -> Surface:
    """Returns a surface with its light baked at this size, with or without shadows, or not at all."""
    if size is None:
        return replace(surface, receiver=None)
    receiver = replace(surface.receiver or Receiver(path=surface.path), bake=("lit",), texture_size=size)
    if not shadows:
        receiver = replace(receiver, receive_shadow=False, receive_smoke=False)
    return replace(surface, receiver=receiver)


def _refined(scene: Scene, domain: SmokeDomain, densities: Densities) -> SmokeDomain:
    """Returns a domain with the resolution that it was simulated at, which a run may have chosen."""
    if domain.path not in densities:
        return domain
    _, to_world = densities[domain.path]
    length = domain.resolution * place_lattice(scene, domain).voxel_size
    return replace(domain, resolution=round(length / np.linalg.norm(to_world[0, :3])))


def _in_cells(path: str, lattice: Lattice, density: np.ndarray, to_world: np.ndarray) -> np.ndarray:
    """Returns a volume's density in all of its domain's cells, [nx, ny, nz] float32."""
    laid = lay_over(lattice.shape, centers_to_world(lattice), density, to_world)
    if laid is None:
        raise ValueError(f"{path}: its volume's voxels do not match its cells, so its shadow cannot be recomputed")
    return laid
