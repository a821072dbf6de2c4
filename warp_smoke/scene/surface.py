"""The surfaces of the set: meshes that cast shadows, and what is baked for them."""

from dataclasses import dataclass, field, replace

import numpy as np

from warp_smoke.geometry import Mesh
from warp_smoke.material import Material
from warp_smoke.record import FieldError, Record, Samples, flag, read_only, switch, tokens, whole
from warp_smoke.scene.prim import Prim
from warp_smoke.uv_fit import UvFit, fit_unit_square

# Bakes at the points of a surface; `depth` belongs to the lights that shine on it.
SURFACE_BAKES = ("lit", "irradiance", "visibility", "smokeShadow", "normal")
BAKES = (*SURFACE_BAKES, "depth")


@dataclass(frozen=True, eq=False, kw_only=True)
class Receiver(Record):
    """What is baked for a surface (USD: `SmokeReceiverAPI`).

    Attributes:
        path: prim path of the surface.
        bake: pictures to bake, out of `BAKES`: those of the surface's points (`SURFACE_BAKES`), or `depth`, the shadow
            maps of the lights that illuminate it, which needs no texture coordinates.
        texture_size: texels along a side.
        texture_bits: bits in each channel of the pictures, 8 or 16.
        receive_smoke, receive_shadow: whether shadows of smoke and shadows of surfaces fall on it.
        given: names of the fields that the stage sets, which no quality preset changes; ignored by equality.
    """

    path: str
    bake: tuple[str, ...] = ("lit",)
    texture_size: int = 1024
    texture_bits: int = 8
    receive_smoke: bool = True
    receive_shadow: bool = True
    given: frozenset[str] = field(default=frozenset(), compare=False)

    def __post_init__(self):
        self._store("bake", tuple(dict.fromkeys(tokens(self.path, "bake", self.bake, BAKES))))
        for name in ("receive_smoke", "receive_shadow"):
            self._store(name, flag(self.path, name, getattr(self, name)))
        self._store("texture_bits", whole(self.path, "texture_bits", self.texture_bits, 8, 16))
        if self.texture_bits not in (8, 16):
            raise FieldError(self.path, "texture_bits", self.texture_bits, "8, 16")
        self._store("texture_size", whole(self.path, "texture_size", self.texture_size, 1, 16384))

    @property
    def surface_bakes(self) -> tuple[str, ...]:
        """The bakes at the surface's points, without `depth`."""
        return tuple(bake for bake in self.bake if bake in SURFACE_BAKES)


@dataclass(frozen=True, eq=False, kw_only=True)
class MaterialSubset(Record):
    """A set of triangles with a material of its own (USD: a `GeomSubset` of the family `materialBind`).

    Attributes:
        path: prim path.
        triangles: indices into the mesh's triangles, [k] int32.
        material: None = the default grey.
    """

    path: str
    triangles: np.ndarray
    material: Material | None = None

    def __post_init__(self):
        self._store("triangles", read_only(self.triangles, np.int32))
        if self.triangles.ndim != 1:
            raise FieldError(self.path, "triangles", f"of shape {self.triangles.shape}", "[k]")


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface(Prim):
    """A mesh of the set, which casts shadows and is baked if it has a receiver.

    Attributes:
        mesh: its shape, in local space.
        material: that of the triangles in no subset; None = the default grey.
        subsets: triangles with other materials; where subsets overlap, the first one counts.
        visible: may change; an invisible surface casts no shadow and is not baked.
        receiver: what to bake, or None.
        instancer: path of the `PointInstancer` that the surface is an instance of: it has no prim of its own, and so
            no receiver; ignored by equality.
        holds_bakes: whether its prim can hold bakes, as a Mesh can and a Sphere cannot; ignored by equality.
    """

    mesh: Mesh
    material: Material | None = None
    subsets: tuple[MaterialSubset, ...] = ()
    visible: bool | Samples = True
    receiver: Receiver | None = None
    instancer: str | None = field(default=None, compare=False)
    holds_bakes: bool = field(default=True, compare=False)

    def __post_init__(self):
        super().__post_init__()
        self._check_reach(self.mesh.points)
        self._check(switch, "visible")
        self._store("subsets", tuple(self.subsets))
        last = len(self.mesh.triangles) - 1
        for each in self.subsets:
            if len(each.triangles) and not 0 <= each.triangles.min() <= each.triangles.max() <= last:
                found = f"{each.triangles.min()}…{each.triangles.max()}"
                raise FieldError(each.path, "triangles", found, f"0…{last}, those of {self.path}")
        if self.receiver is not None and self.instancer is not None:
            raise FieldError(self.path, "receiver", self.receiver.bake, "none, for an instance of a PointInstancer")

    @property
    def bake_fit(self) -> UvFit | None:
        """The mapping of its texture coordinates into [0, 1] for baked pictures; None if they are used unchanged."""
        if self.receiver is None or self.mesh.uvs is None:
            return None
        return fit_unit_square(self.mesh.uvs, 0.5 / self.receiver.texture_size)

    @property
    def bake_uvs(self) -> np.ndarray | None:
        """Texture coordinates of baked pictures at each corner, [m, 3, 2] float32; None if the mesh has none."""
        fit = self.bake_fit
        return self.mesh.uvs if fit is None else fit(self.mesh.uvs)

    @property
    def materials(self) -> tuple[Material, ...]:
        """Its own material, then those of its subsets, with the default in place of None."""
        return tuple(material or Material() for material in (self.material, *(each.material for each in self.subsets)))

    @property
    def casts_shadow(self) -> bool:
        """Whether any of its materials casts a shadow."""
        return any(material.casts_shadow for material in self.materials)

    @property
    def pieces(self) -> tuple["Surface", ...]:
        """One surface for each material in use, with its triangles and without subsets or receiver."""
        index, plain = self.material_of_triangle, {"subsets": (), "receiver": None}
        return tuple(
            replace(self, mesh=self.mesh.part(np.flatnonzero(index == n)), material=self.materials[n], **plain)
            for n in np.unique(index)
        )

    @property
    def material_of_triangle(self) -> np.ndarray:
        """The index into `materials` for each triangle, [m] int32."""
        index = np.zeros(len(self.mesh.triangles), np.int32)
        for number in range(len(self.subsets), 0, -1):
            index[self.subsets[number - 1].triangles] = number
        return index
