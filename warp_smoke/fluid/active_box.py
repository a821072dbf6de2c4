"""The active box: the part of a domain in which smoke and air are advected.

Scalars are ambient outside the smoke, so nothing is lost where they are not advected. Air that is far from the smoke
and slow relative to the fastest flow is irrotational, u = ∇φ; there advection changes velocity by the gradient ∇½|u|²,
which the pressure projection removes again, so it may be skipped. Forces and pressure act in the entire domain:
pressure reaches far, and closing it off at a box around the smoke would change the flow inside.
"""

from collections.abc import Sequence
from math import ceil, inf

import numpy as np

from warp_smoke.fluid.grid import Box, hull
from warp_smoke.record import each_value
from warp_smoke.scene import ArrayEmitter, Emitter

# Air faster than this share of the fastest is always advected.
FAST = 0.2
# Margin of the box around smoke and fast air: a least number of cells, and a share of their smallest extent.
_LEAST_MARGIN, _MARGIN = 4, 0.75
# Cells that interpolation reaches beyond the end of a trace.
_STENCIL = 2
_ALIGNMENT = 8


def typical_amounts(emitters: Sequence[Emitter | ArrayEmitter], ambient: float) -> tuple[float, float]:
    """Returns the largest density and departure from ambient temperature of emitters; inf if arrays may emit any."""
    if any(isinstance(each, ArrayEmitter) for each in emitters):
        return inf, inf
    density = max(float(np.max(each_value(each.density))) for each in emitters)
    return density, max(float(np.abs(each_value(each.temperature) - ambient).max()) for each in emitters)


def fit_boxes(
    smoke: Box | None,
    fast: Box | None,
    courant: float,
    shape: tuple[int, int, int],
    periodic: tuple[bool, bool, bool] = (False, False, False),
) -> tuple[Box, Box]:
    """Returns the cells in which velocity is advected, and those in which scalars are.

    Args:
        smoke: cells that hold smoke or heat, or None.
        fast: cells with fast air, or None.
        courant: most cells that anything moves in the step.
        shape: cells of the domain along each axis (nx, ny, nz).
        periodic: which axes are periodic; a box that would cross the ends of such an axis covers all of it.
    """
    empty = Box((0, 0, 0), (0, 0, 0))
    core = hull((smoke, fast))
    if core is None:
        return empty, empty
    reach = ceil(min(courant, max(shape)))
    extent = min(high - low for low, high in zip(*core, strict=True))
    air = _grow(core, reach + max(_LEAST_MARGIN, ceil(_MARGIN * extent)), shape, periodic)
    return air, empty if smoke is None else _grow(smoke, reach + _STENCIL, shape, periodic)


def _grow(box: Box, cells: int, shape: tuple[int, int, int], periodic: tuple[bool, bool, bool]) -> Box:
    """Grows a box by a number of cells on each side, and then to multiples of the alignment."""
    lower, upper = [], []
    for low, high, n, again in zip(*box, shape, periodic, strict=True):
        wraps = again and (low < cells or high + cells > n)
        lower.append(0 if wraps else max((low - cells) // _ALIGNMENT * _ALIGNMENT, 0))
        upper.append(n if wraps else min(-(-(high + cells) // _ALIGNMENT) * _ALIGNMENT, n))
    return Box(tuple(lower), tuple(upper))
