"""Smoke at one time, as a picture takes it."""

from dataclasses import dataclass

import numpy as np

from warp_smoke.lattice import Lattice
from warp_smoke.scene import SmokeDomain


@dataclass(frozen=True, eq=False)
class SmokeVolume:
    """Smoke at one time.

    Attributes:
        domain: gives its extinction and albedo.
        lattice: where its cells lie.
        density: [nx, ny, nz] float32 at cell centres.
    """

    domain: SmokeDomain
    lattice: Lattice
    density: np.ndarray
