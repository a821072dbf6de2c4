"""The nodes of the turbulence noise in a lattice."""

from typing import NamedTuple

from warp_smoke.lattice import Lattice

# Smaller eddies are enlarged to this size [cells], as the lattice would not resolve them.
_LEAST_SCALE = 2.0


class Eddies(NamedTuple):
    """Noise nodes, one eddy apart.

    Attributes:
        scale: size of the eddies [cells].
        spacing: spacing of the nodes along each axis [cells]: along a periodic axis a little more or less than the
            scale, so that a whole number fits.
        rings: that whole number for each periodic axis; 0 for other axes.
        nodes: number of nodes along each axis.
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
