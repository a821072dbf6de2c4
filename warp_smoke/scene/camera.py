"""The camera that the preview and the picture look through."""

from dataclasses import dataclass

from warp_smoke.record import VAST, finite, positive
from warp_smoke.scene.prim import Prim


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera(Prim):
    """A camera looking along its −Z axis (USD: `UsdGeomCamera`).

    Attributes:
        focal_length, horizontal_aperture, vertical_aperture: in one unit, whichever it is.
        horizontal_offset, vertical_offset: of the aperture from the axis, to the right and up, in the same unit.
        near, far: distances along the axis between which something is seen [stage units].
    """

    focal_length: float = 50.0
    horizontal_aperture: float = 20.955
    vertical_aperture: float = 15.2908
    horizontal_offset: float = 0.0
    vertical_offset: float = 0.0
    near: float = 1.0
    far: float = 1e6

    def __post_init__(self):
        super().__post_init__()
        self._check(positive, "focal_length", "horizontal_aperture", "vertical_aperture")
        self._check(positive, "far", largest=VAST)
        self._check(finite, "horizontal_offset", "vertical_offset", "near")
