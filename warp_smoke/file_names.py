"""File names of a run, relative to its folder: short, and unique within it."""

from collections.abc import Iterable

from warp_smoke.plan import Plan, ReceiverPlan, When
from warp_smoke.scene import Material, Scene


class FileNames:
    """Names of a plan's volumes and pictures."""

    def __init__(self, plan: Plan):
        self._stems = file_stems([each.domain.path for each in plan.domains])
        self._stems |= file_stems([each.surface.path for each in plan.receivers])
        self._lights = file_stems([light.path for light in plan.scene.lights])
        materials = file_stems([material.path for material in computed_materials(plan.scene)])
        self._procedurals = {path: f"textures/{stem}.procedural.png" for path, stem in materials.items()}

    def volume(self, path: str, number: int) -> str:
        """Returns the file of a domain's smoke at a frame."""
        return f"volumes/{self._stems[path]}.{number:04d}.vdb"

    def bake(self, each: ReceiverPlan, bake: str, number: int) -> tuple[str, str]:
        """Returns the hidden file that keeps a bake's per-point values until the stage is written, and its picture."""
        name = f"{self._stems[each.surface.path]}.{bake}" + f".{number:04d}" * (each.bakes[bake] == When.FRAME)
        return f"textures/.{name}.npy", f"textures/{name}.png"

    def light(self, path: str) -> str:
        """Returns the name of a light's shadow map."""
        return self._lights[path]

    def depth_map(self, path: str, when: When, number: int) -> str:
        """Returns the picture file of a light's shadow map."""
        return f"textures/{self._lights[path]}.depth" + f".{number:04d}" * (when == When.FRAME) + ".png"

    def procedurals(self) -> dict[str, str]:
        """Returns the files of procedural textures, by material path."""
        return self._procedurals


def file_stems(paths: Iterable[str]) -> dict[str, str]:
    """Returns a short file name for each prim path: its last part, or the full path where that is not unique."""
    paths = list(paths)
    last = [path.rpartition("/")[2] for path in paths]
    whole = [path.strip("/").replace("/", "_") for path in paths]
    return {p: short if last.count(short) == 1 else long for p, short, long in zip(paths, last, whole, strict=True)}


def computed_materials(scene: Scene) -> list[Material]:
    """Returns the materials on a scene's surfaces that have a procedural texture."""
    bound = {material.path: material for surface in scene.surfaces for material in surface.materials}
    return [material for material in bound.values() if material.procedural is not None]
