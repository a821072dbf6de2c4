"""A stage as it is drawn, read from its files: the set, its bakes, and the smoke of each frame."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom, UsdShade, UsdVol

from warp_smoke.geometry import transform_points
from warp_smoke.preview.camera import level_axes
from warp_smoke.preview.grids import existing_file, lay_over, read_grid, vdb_field
from warp_smoke.preview.lights import beam_on, lights_of
from warp_smoke.preview.relight import Relighting, Switches
from warp_smoke.preview.slices import QUANTITIES, Slice, cut_slice
from warp_smoke.preview.smoke import SmokeVoxels, color_smoke, find_smoke, show_light
from warp_smoke.scene import Light, SmokeDomain
from warp_smoke.shading.textures import Picture
from warp_smoke.usd.find import find_stage
from warp_smoke.usd.own_look import open_in_own_look
from warp_smoke.usd.quiet import usd_kept_quiet
from warp_smoke.usd.read import usd_message
from warp_smoke.usd.volume import DOMAIN_RELATIONSHIP, GRID_NAMES

AS_BAKED = Switches()


@dataclass(frozen=True)
class Frame:
    """What changes from frame to frame in files other than the stage's own.

    Attributes:
        number: the frame.
        smoke: of each volume; None where there is none.
        pictures: baked light by the path of its surface, sRGB of 8 or 16 bits, [h, w, 3 or 4], top row first.
        colors: baked light by the path of its surface, linear RGB at each point, [n, 3].
        slices: a slice through each volume, in place of smoke where a quantity is shown.
        quantity: the quantity shown, one of `QUANTITIES`, or None.
        off: paths of the lights that do not shine.
    """

    number: int
    smoke: tuple[SmokeVoxels | None, ...]
    pictures: Mapping[str, np.ndarray]
    colors: Mapping[str, np.ndarray]
    slices: tuple[Slice | None, ...] = ()
    quantity: str | None = None
    off: frozenset[str] = frozenset()


class PreviewStage:
    """A stage to be previewed: one that a run wrote, or any other.

    Attributes:
        scene: what is on it.
        lights: the scene's, or neutral ones where it has none.
        ambient: light from everywhere, linear RGB [3].
        volumes: number of volumes.
        has_results: whether there is a volume or a baked surface.

    Raises:
        ValueError: the file is not a stage, or something on it is not allowed.
    """

    def __init__(self, path: str | Path, camera: str | None = None):
        file = self._file = find_stage(path)
        self._camera = camera
        # Bakes are read from the stage itself, materials from the look that the user gave it.
        _, self.scene = open_in_own_look(file, camera)
        with usd_kept_quiet():
            stage = self._stage = Usd.Stage.Open(str(file))
        self._times = _file_times(stage)
        self.lights, self.ambient = lights_of(self.scene)
        self._domains = {domain.path: domain for domain in self.scene.domains}
        prims = stage.Traverse(Usd.TraverseInstanceProxies())
        self._volumes = [
            UsdVol.Volume(prim) for prim in prims if prim.IsA(UsdVol.Volume) and vdb_field(prim, "density")
        ]
        self._pictures: dict[str, Usd.Attribute] = {}
        self._colors: dict[str, Usd.Attribute] = {}
        self._last_pictures: dict[str, tuple[str, np.ndarray]] = {}
        self._relit: tuple[Switches, Relighting] | None = None
        for surface in self.scene.surfaces:
            prim = stage.GetPrimAtPath(surface.path)
            light = _baked_light(prim) if prim else None
            if light and light.GetTypeName() == Sdf.ValueTypeNames.Asset:
                self._pictures[surface.path] = light
            elif light:
                self._colors[surface.path] = light

    @property
    def volumes(self) -> int:
        """Number of volumes."""
        return len(self._volumes)

    @property
    def has_results(self) -> bool:
        """Whether there is smoke or baked light on the stage."""
        return bool(self._volumes or self._pictures or self._colors)

    def changed_on_disk(self) -> bool:
        """Returns whether a file of the stage's layers has changed since it was read."""
        return _file_times(self._stage) != self._times

    def reopened(self) -> "PreviewStage":
        """Returns the stage as its files are now; this object must not be used afterwards.

        Raises:
            ValueError: the file is not a stage any more, or something on it is not allowed.
        """
        try:
            self._stage.Reload()
        except Tf.ErrorException as error:
            raise ValueError(f"{self._file}: not a USD stage: {usd_message(error.args[0])}") from None
        return PreviewStage(self._file, self._camera)

    def load(
        self, number: int, thickness: float = 1.0, quantity: str | None = None, switches: Switches = AS_BAKED
    ) -> Frame:
        """Reads the files of a frame.

        Args:
            number: the frame.
            thickness: factor on the smoke's extinction.
            quantity: one of `QUANTITIES`, to be shown on slices through the volumes instead of their smoke.
            switches: which light and shadows are on; unless all are, baked light is recomputed.

        Raises:
            ValueError, OSError: a file is missing or damaged, or no volume has the quantity.
        """
        pictures = {path: self._load_picture(path, existing_file(to, number)) for path, to in self._pictures.items()}
        colors = {path: np.array(light.Get(number)) for path, light in self._colors.items()}
        scattered = {}
        if switches != AS_BAKED and (pictures or colors):
            scattered = self._relight(number, pictures, colors, switches)
        off = switches.off
        if quantity is None:
            smoke = tuple(self._load_smoke(volume, number, thickness, off, scattered) for volume in self._volumes)
            return Frame(number, smoke, pictures, colors, off=off)
        self._check_quantity(quantity)
        slices = tuple(self._load_slice(volume, number, quantity) for volume in self._volumes)
        return Frame(number, (None,) * len(slices), pictures, colors, slices, quantity, off)

    def _load_picture(self, path: str, file: str) -> np.ndarray:
        """Reads a picture, [h, w, 3 or 4]; the same array while the file is the same: VTK is not sent it again."""
        if self._last_pictures.get(path, (None,))[0] != file:
            picture = Picture.read(file, "sRGB")
            colors = np.broadcast_to(picture.codes, (*picture.codes.shape[:2], 3))
            self._last_pictures[path] = file, colors if picture.alpha is None else np.dstack([colors, picture.alpha])
        return self._last_pictures[path][1]

    def _relight(self, number: int, pictures: dict, colors: dict, switches: Switches) -> dict[str, np.ndarray]:
        """Replaces the bakes by ones under other light; returns the light that smoke scatters, by domain path."""
        densities = {}
        for volume in self._volumes:
            domain, (values, to_world) = self._domain_of(volume.GetPrim()), read_grid(volume, "density", number)
            densities[domain.path] = values / np.float32(domain.density_scale), to_world
        if self._relit is None or self._relit[0] != switches:
            own = {each.path: each.receiver.texture_size for each in self.scene.surfaces if each.receiver}
            sizes = {path: own.get(path, 1) for path in colors}
            sizes |= {path: max(each.shape[:2]) for path, each in pictures.items()}
            self._relit = switches, Relighting(self.scene, sizes, densities, switches)
        relighting = self._relit[1]
        scattered = relighting.update(number, densities)
        # A surface that no light is left for shows its material, which is black but for its emission.
        pictures.clear()
        colors.clear()
        for path, made in relighting.pictures.items():
            (pictures if made.dtype in (np.uint8, np.uint16) else colors)[path] = made
        return scattered

    def _load_smoke(
        self,
        volume: UsdVol.Volume,
        number: int,
        thickness: float,
        off: frozenset[str],
        scattered: Mapping[str, np.ndarray],
    ) -> SmokeVoxels | None:
        domain = self._domain_of(volume.GetPrim())
        extinction = thickness * domain.extinction * self.scene.meters_per_unit / domain.density_scale
        if extinction == 0 or volume.ComputeVisibility(number) == UsdGeom.Tokens.invisible:
            return None
        density, to_world = read_grid(volume, "density", number)
        light = scattered.get(domain.path)
        if not off and vdb_field(volume.GetPrim(), "light"):
            light = lay_over(density.shape, to_world, *read_grid(volume, "light", number))
        lights = [each for each in self.lights if each.path not in off]
        return light_smoke(density, to_world, extinction, lights, self.ambient, number, light)

    def _check_quantity(self, quantity: str) -> None:
        """Refuses a quantity that no volume holds, and says how to add it."""
        fields = {field for volume in self._volumes for field in volume.GetFieldPaths()}
        if self._volumes and QUANTITIES[quantity].field not in fields:
            grid_of = {name: grid for grid, name in GRID_NAMES.items()}
            grid, held = grid_of[QUANTITIES[quantity].field], sorted(grid_of.get(field, field) for field in fields)
            cure = f"add {grid} to smoke:grids and run again"
            raise ValueError(f"the volumes have no {grid}; they have: {', '.join(held)}; {cure}")

    def _load_slice(self, volume: UsdVol.Volume, number: int, quantity: str) -> Slice | None:
        """Returns a slice that faces the front through the middle of a volume's domain; None if it lacks the field."""
        if not vdb_field(volume.GetPrim(), QUANTITIES[quantity].field):
            return None
        values, to_world = read_grid(volume, QUANTITIES[quantity].field, number)
        if quantity == "speed":
            values = self.scene.meters_per_unit * np.linalg.norm(values, axis=3)
        domain = self._domains.get(self._domain_of(volume.GetPrim()).path)
        middle = None
        if domain is not None:
            middle = transform_points(domain.transform_at(number), np.add(domain.lower, domain.upper) / 2)
        _, front = level_axes(self.scene.up)
        return cut_slice(values, to_world, front, middle)

    def _domain_of(self, volume: Usd.Prim) -> SmokeDomain:
        """Returns the domain whose smoke a volume holds; a default one for volumes from other software."""
        paths = map(str, volume.GetRelationship(DOMAIN_RELATIONSHIP).GetTargets())
        return next(filter(None, map(self._domains.get, paths)), SmokeDomain(path=str(volume.GetPath())))


def _file_times(stage: Usd.Stage) -> dict[str, int]:
    """Returns when each file of a stage's layers was last written [ns]; 0 for one that is gone."""
    files = [Path(layer.realPath) for layer in stage.GetUsedLayers() if layer.realPath]
    return {str(file): file.stat().st_mtime_ns if file.exists() else 0 for file in files}


def light_smoke(
    density: np.ndarray,
    to_world: np.ndarray,
    extinction: float,
    lights: Iterable[Light],
    ambient: np.ndarray,
    time: float,
    scattered: np.ndarray | None = None,
) -> SmokeVoxels | None:
    """Returns the smoke of one volume as it is drawn at a time code; None if there is none.

    Args:
        density: [nx, ny, nz] float32.
        to_world: index (i, j, k) of a voxel to the world position of its centre, 4 × 4 row-vector matrix.
        extinction: at density 1 [1/stage unit].
        lights: those that shine on it.
        ambient: light from everywhere, linear RGB [3].
        time: time code.
        scattered: their light that the smoke scatters, linear RGB, [nx, ny, nz, 3], where known.
    """
    found = find_smoke(density, to_world, scattered)
    if found is None:
        return None
    density, to_world, scattered = found
    if scattered is not None:
        return show_light(density, to_world, extinction, scattered)
    ends = transform_points(to_world, [np.zeros(3), density.shape])
    center, radius = ends.mean(axis=0), float(np.linalg.norm(ends[1] - ends[0])) / 2
    return color_smoke(density, to_world, extinction, [beam_on(one, center, radius, time) for one in lights], ambient)


def _baked_light(prim: Usd.Prim) -> Usd.Attribute | None:
    """Returns the source of the bound material's emission: a texture's file or a primvar; None if it is not baked.

    A material that emits from such a source and reflects nothing shows baked light: it needs no other light.
    """
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.preview)
    surface = material.ComputeSurfaceSource()[0] if material else None
    emission, diffuse = (surface.GetInput(name) if surface else None for name in ("emissiveColor", "diffuseColor"))
    if not emission or not diffuse or diffuse.HasConnectedSource() or any(diffuse.Get() or [1.0]):
        return None
    for source in UsdShade.Utils.GetValueProducingAttributes(emission):
        shader = UsdShade.Shader(source.GetPrim())
        if shader.GetShaderId() == "UsdUVTexture":
            return shader.GetInput("file").GetAttr()
        if shader.GetShaderId() == "UsdPrimvarReader_float3":
            return UsdGeom.PrimvarsAPI(prim).GetPrimvar(shader.GetInput("varname").Get()).GetAttr()
    return None
