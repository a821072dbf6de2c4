"""The active box: the part of a domain in which smoke and air are carried along.

Scalars are ambient outside of the smoke, so nothing is lost where they are not carried. Air that is far from the smoke
and slow next to the fastest flows without swirls, u = ∇φ; there advection changes velocity by the gradient ∇½|u|²,
which the pressure takes out again, so it may be left out. Forces and pressure act in the whole domain: pressure reaches
far, and closing it off at a box around the smoke would change the flow inside.
"""

from collections.abc import Sequence
from math import ceil, inf

import numpy as np

from warp_smoke.fluid.grid import Box, hull
from warp_smoke.record import each_value
from warp_smoke.scene import ArrayEmitter, Emitter

# Air that is faster than this share of the fastest always moves along.
FAST = 0.2
# Cells that the box reaches beyond smoke and fast air: at least, and as a share of their smallest extent.
_LEAST_MARGIN, _MARGIN = 4, 0.75
# Cells that samples reach beyond the end of their trace.
_STENCIL = 2
_ALIGNMENT = 8


def typical_amounts(emitters: Sequence[Emitter | ArrayEmitter], ambient: float) -> tuple[float, float]:
    """The largest density that emitters give, and departure from ambient temperature; inf if arrays may give any."""
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
    """The cells in which velocity is carried, and those in which scalars are.

    Args:
        smoke: cells that hold smoke or heat, or None.
        fast: cells with fast air, or None.
        courant: cells that anything moves in the step, at most.
        shape: cells of the domain along each axis (nx, ny, nz).
        periodic: axes along which a box that leaves the domain comes in again; there it is the whole axis.
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
    """The box with so many cells added on each side, and then up to whole multiples of the alignment."""
    lower, upper = [], []
    for low, high, n, again in zip(*box, shape, periodic, strict=True):
        wraps = again and (low < cells or high + cells > n)
        lower.append(0 if wraps else max((low - cells) // _ALIGNMENT * _ALIGNMENT, 0))
        upper.append(n if wraps else min(-(-(high + cells) // _ALIGNMENT) * _ALIGNMENT, n))
    return Box(tuple(lower), tuple(upper))
