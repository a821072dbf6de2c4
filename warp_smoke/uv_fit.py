"""Texture coordinates that a baked picture can have: within [0, 1], whatever the mesh's own are."""

from dataclasses import dataclass

import numpy as np

# Name of the primvar that holds them on a finished stage, where they are not the mesh's own.
BAKE_UVS = "st_bake"


@dataclass(frozen=True)
class UvFit:
    """How coordinates are brought into the unit square: (uv − lower)/size, along u and v each by its own.

    Attributes:
        lower: least coordinates.
        size: how far they reach from there; 1 where they do not.
    """

    lower: tuple[float, float]
    size: tuple[float, float]

    def __call__(self, uvs: np.ndarray) -> np.ndarray:
        """Coordinates [..., 2] as float32 within [0, 1]."""
        return ((np.asarray(uvs, np.float64) - self.lower) / self.size).astype(np.float32)


def fit_unit_square(uvs: np.ndarray, slack: float) -> UvFit | None:
    """The fit of coordinates that leave [0, 1]² by more than `slack`; None for all that do not, or are not finite.

    Tiles (UDIM) and repeated textures are one flat layout: brought into the square as a whole, what lies beside each
    other stays so.

    Args:
        uvs: [..., 2].
        slack: what is taken for rounding.
    """
    flat = np.asarray(uvs, np.float64).reshape(-1, 2)
    if not len(flat) or not np.all(np.isfinite(flat)):
        return None
    lower, upper = flat.min(axis=0), flat.max(axis=0)
    if np.all(lower >= -slack) and np.all(upper <= 1.0 + slack):
        return None
    size = np.where(upper > lower, upper - lower, 1.0)
    return UvFit(tuple(lower.tolist()), tuple(size.tolist()))
