"""How voxels are spread over a light buffer: one-dimensional weights for each slice of the lattice; no Warp here.

In shear coordinates (`light_buffer`) a splat is the product of weights along s and along t. Each texel gathers from a
few cells, so the sum over a buffer needs no scatter and no atomics. With x the texel's centre and c a cell's centre on
a slice, and a the texel's width there, all in cells, the weight at u = (x − c)/a texels is:

- nearest: 1 where |u| ≤ ½, for the texel that contains the centre;
- bilinear: max(0, 1 − |u|);
- gaussian: Westover's (1990) footprint of a Gaussian voxel, of standard deviation ½ cell, integrated over the texel;
- footprint: the share of the cell that the texel covers. Rays cross slices obliquely: two Gauss points in depth.

Divided by a, each conserves mass: for parallel rays Σ buf A is the sum of the voxels.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from warp_smoke.shadow.light_buffer import GAUSSIAN_REACH, GAUSSIAN_WIDTH, Shear

# Added to the reach of splats, in cells, so that round-off leaves no cell out.
_SLACK = 1e-6


class Taps(NamedTuple):
    """Weights of cells on texels along one axis.

    Attributes:
        first: the first cell that each texel gathers from, [samples, texels] int32.
        weight: weights of that cell and those after it, [samples, texels, taps] float32.
    """

    first: np.ndarray
    weight: np.ndarray


class Splat(NamedTuple):
    """One way to spread a voxel.

    Attributes:
        depths: of the samples in each slice, 0 to 1.
        reach: largest distance of a cell's centre from a texel that it adds to, in cells, as a function of a.
        weigh: weight before the division by a, as a function of the texel's two ends, relative to the cell's centre
            in texels, and of a. Neighbours share bit-identical ends, so that no cell falls between them.
    """

    depths: tuple[float, ...]
    reach: Callable[[np.ndarray], np.ndarray]
    weigh: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def _nearest(begin: np.ndarray, end: np.ndarray, a: np.ndarray) -> np.ndarray:
    return ((begin <= 0.0) & (end > 0.0)).astype(float)


def _bilinear(begin: np.ndarray, end: np.ndarray, a: np.ndarray) -> np.ndarray:
    return np.maximum(0.0, 1.0 - 0.5 * np.abs(begin + end))


def _gaussian(begin: np.ndarray, end: np.ndarray, a: np.ndarray) -> np.ndarray:
    from scipy.special import ndtr  # takes 0.1 s to import, and is needed only here

    width, reach = GAUSSIAN_WIDTH / a, GAUSSIAN_REACH / a

    def below(edge: np.ndarray) -> np.ndarray:
        return np.where(edge >= reach, 1.0, np.where(edge <= -reach, 0.0, ndtr(edge / width)))

    return below(end) - below(begin)


def _footprint(begin: np.ndarray, end: np.ndarray, a: np.ndarray) -> np.ndarray:
    half = 0.5 / a
    return np.maximum(0.0, np.minimum(end, half) - np.maximum(begin, -half)) * a


_GAUSS_POINTS = (0.5 - 0.5 / np.sqrt(3.0), 0.5 + 0.5 / np.sqrt(3.0))

SPLATS = {
    "nearest": Splat((0.5,), lambda a: 0.5 * a, _nearest),
    "bilinear": Splat((0.5,), lambda a: a, _bilinear),
    "gaussian": Splat((0.5,), lambda a: 0.5 * a + GAUSSIAN_REACH, _gaussian),
    "footprint": Splat(_GAUSS_POINTS, lambda a: 0.5 * a + 0.5, _footprint),
}


def splat_taps(splat: Splat, shear: Shear, shape: tuple[int, int]) -> tuple[Taps, Taps]:
    """Computes the weights along s and along t.

    Args:
        splat: how voxels are spread.
        shear: the buffer.
        shape: cells along s and t.
    """
    places = shear.slice_places(splat.depths)
    share = 1.0 / len(splat.depths)
    counts = [tap_count(splat, shear, cells) for cells in shape]
    along_s = _taps(splat, places[:, 0], places[:, 1], shear.texels[0], shape[0], counts[0], share)
    return along_s, _taps(splat, places[:, 0], places[:, 2], shear.texels[1], shape[1], counts[1], 1.0)


def tap_count(splat: Splat, shear: Shear, cells: int) -> int:
    """Returns the number of cells that each texel gathers from along an axis with `cells` cells."""
    reach = splat.reach(shear.slice_places(splat.depths)[:, 0]) + _SLACK
    return min(math.floor(2.0 * reach.max()) + 1, cells)


def _taps(splat: Splat, a: np.ndarray, b: np.ndarray, texels: int, cells: int, count: int, share: float) -> Taps:
    """Computes weights of cells with centres at i + ½ on texels with centres at a n + b."""
    a = a[:, None]
    place = a * np.arange(texels) + b[:, None]
    reach = splat.reach(a) + _SLACK
    first = np.clip(np.ceil(place - reach - 0.5).astype(int), 0, cells - count)
    edges = a * (np.arange(texels + 1) - 0.5) + b[:, None]
    centres = first[..., None] + np.arange(count) + 0.5
    begin, end = ((edge[..., None] - centres) / a[..., None] for edge in (edges[:, :-1], edges[:, 1:]))
    weight = splat.weigh(begin, end, a[..., None]) * (share / a[..., None])
    return Taps(first.astype(np.int32), weight.astype(np.float32))
