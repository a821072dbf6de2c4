"""Texture coordinates for baked pictures: within [0, 1], whatever the mesh's own coordinates are."""

from dataclasses import dataclass

import numpy as np

# Name of the primvar that holds them on a finished stage if they differ from the mesh's own.
BAKE_UVS = "st_bake"


@dataclass(frozen=True)
class UvFit:
    """A map of coordinates into the unit square: (uv − lower)/size, along u and v separately.

    Attributes:
        lower: lowest coordinates.
        size: extent of the coordinates; 1 along an axis without extent.
    """

    lower: tuple[float, float]
    size: tuple[float, float]

    def __call__(self, uvs: np.ndarray) -> np.ndarray:
        """Maps coordinates [..., 2] into [0, 1], as float32."""
        return ((np.asarray(uvs, np.float64) - self.lower) / self.size).astype(np.float32)


def fit_unit_square(uvs: np.ndarray, slack: float) -> UvFit | None:
    """Fits coordinates that leave [0, 1]² by more than `slack`; returns None if they do not, or are not finite.

    Tiles (UDIM) and repeated textures are one flat layout: the layout is scaled as one, so neighbours stay neighbours.

    Args:
        uvs: [..., 2].
        slack: excess that counts as rounding.
    """
    flat = np.asarray(uvs, np.float64).reshape(-1, 2)
    if not len(flat) or not np.all(np.isfinite(flat)):
        return None
    lower, upper = flat.min(axis=0), flat.max(axis=0)
    if np.all(lower >= -slack) and np.all(upper <= 1.0 + slack):
        return None
    size = np.where(upper > lower, upper - lower, 1.0)
    return UvFit(tuple(lower.tolist()), tuple(size.tolist()))
