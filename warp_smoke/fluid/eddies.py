"""Where the nodes of turbulence's noise lie in a lattice."""

from typing import NamedTuple

from warp_smoke.lattice import Lattice

# Smaller eddies [cells] are made this large: the lattice would not resolve them.
_LEAST_SCALE = 2.0


class Eddies(NamedTuple):
    """Nodes of noise, an eddy apart.

    Attributes:
        scale: size of the eddies [cells].
        spacing: of the nodes along each axis [cells]: around a periodic axis a little more or less than the scale, so
            that a whole number fits.
        rings: that number for each axis; 0 along axes that are not periodic.
        nodes: along each axis.
    """

    scale: float
    spacing: tuple[float, ...]
    rings: tuple[int, ...]
    nodes: tuple[int, ...]


def place_eddies(lattice: Lattice, scale: float | None) -> Eddies:
    """Places the nodes.

    Args:
        lattice: cells of the domain.
        scale: size of the eddies [m], at least two cells; None = an eighth of the domain's longest side.
    """
    scale = max(scale / lattice.h if scale else max(lattice.shape) / 8.0, _LEAST_SCALE)
    ends = list(zip(lattice.shape, lattice.sides[0::2], strict=True))
    rings = tuple(max(1, round(n / scale)) if side == "periodic" else 0 for n, side in ends)
    spacing = tuple(n / m if m else scale for n, m in zip(lattice.shape, rings, strict=True))
    nodes = tuple(int((n + 0.5) / step) + 2 for n, step in zip(lattice.shape, spacing, strict=True))
    return Eddies(scale, spacing, rings, nodes)
