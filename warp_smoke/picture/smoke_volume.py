"""Smoke at one time, as input to a picture."""

from dataclasses import dataclass

import numpy as np

from warp_smoke.lattice import Lattice
from warp_smoke.scene import SmokeDomain


@dataclass(frozen=True, eq=False)
class SmokeVolume:
    """Smoke at one time.

    Attributes:
        domain: the domain, which has its extinction and albedo.
        lattice: where its cells lie.
        density: [nx, ny, nz] float32 at cell centres.
    """

    domain: SmokeDomain
    lattice: Lattice
    density: np.ndarray
