"""The set: meshes that cast shadows, and what is baked for them."""

from dataclasses import dataclass, field

from warp_smoke.geometry import Mesh
from warp_smoke.material import Material
from warp_smoke.record import FieldError, Record, Samples, one_of, switch, whole
from warp_smoke.scene.prim import Prim

BAKES = ("lit", "irradiance", "visibility", "smokeShadow", "normal")


@dataclass(frozen=True, eq=False, kw_only=True)
class Receiver(Record):
    """What is baked for a surface (USD: `SmokeReceiverAPI`)."""

    path: str
    bake: tuple[str, ...] = ("lit",)
    texture_size: int = 1024
    receive_smoke: bool = True
    receive_shadow: bool = True

    def __post_init__(self):
        self._store("bake", tuple(dict.fromkeys(self.bake)))
        for token in self.bake:
            one_of(self.path, "bake", token, BAKES)
        self._store("texture_size", whole(self.path, "texture_size", self.texture_size, 1, 16384))


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface(Prim):
    """A mesh of the set: it casts shadows, and is baked where it has a receiver.

    Attributes:
        mesh: its shape, in local space.
        material: None = the default grey.
        visible: may change; an invisible surface casts no shadow and is not baked.
        receiver: what to bake, or None.
        instancer: path of the `PointInstancer` that the surface is an instance of: it has no prim of its own, and so
            no receiver; not part of equality.
        holds_bakes: whether its prim can hold bakes, as a Mesh can and a Sphere cannot; not part of equality.
    """

    mesh: Mesh
    material: Material | None = None
    visible: bool | Samples = True
    receiver: Receiver | None = None
    instancer: str | None = field(default=None, compare=False)
    holds_bakes: bool = field(default=True, compare=False)

    def __post_init__(self):
        super().__post_init__()
        self._check(switch, "visible")
        if self.receiver is not None and self.instancer is not None:
            raise FieldError(self.path, "receiver", self.receiver.bake, "none, for an instance of a PointInstancer")
