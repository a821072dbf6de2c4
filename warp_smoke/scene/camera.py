"""The camera through which the preview and rendered pictures see the scene."""

from dataclasses import dataclass

from warp_smoke.record import VAST, Samples, finite, positive, value_at
from warp_smoke.scene.prim import Prim


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera(Prim):
    """A camera looking along its −Z axis (USD: `UsdGeomCamera`).

    Attributes:
        focal_length, horizontal_aperture, vertical_aperture: all in the same unit, whatever it is; may change.
        horizontal_offset, vertical_offset: offset of the aperture from the axis, to the right and up, in that unit;
            may change.
        near, far: clipping distances along the axis [stage units].
    """

    focal_length: float | Samples = 50.0
    horizontal_aperture: float | Samples = 20.955
    vertical_aperture: float | Samples = 15.2908
    horizontal_offset: float | Samples = 0.0
    vertical_offset: float | Samples = 0.0
    near: float = 1.0
    far: float = 1e6

    def __post_init__(self):
        super().__post_init__()
        self._check(positive, "focal_length", "horizontal_aperture", "vertical_aperture")
        self._check(positive, "far", largest=VAST)
        self._check(finite, "horizontal_offset", "vertical_offset", "near")

    def lens_at(self, time: float) -> tuple[float, float, float, float]:
        """Returns the horizontal and vertical aperture and their offsets, in focal lengths."""
        apertures = (self.horizontal_aperture, self.vertical_aperture, self.horizontal_offset, self.vertical_offset)
        focal_length = float(value_at(self.focal_length, time))
        return tuple(float(value_at(each, time)) / focal_length for each in apertures)
