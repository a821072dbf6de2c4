"""Test for a filter that is entirely in shadow: a bound on the depths in the tiles of a depth map under it.

After the depth pyramid of Greene, Kass and Miller ("Hierarchical Z-Buffer Visibility", 1993), with one level.
"""

import warp as wp

from warp_smoke.shadow.coverage import TILE

wp.set_module_options({"enable_backward": False})

_TILE = wp.constant(TILE)
# Largest reach that is tested, in texels: beyond about this, a filter has fewer taps than there are tiles under it.
_WIDEST = wp.constant(2.0 * TILE)


@wp.func
def deepest_within(deepest: wp.array3d[float], size: int, face: int, s: float, t: float, reach: float):
    """Upper bound on the depths within `reach` of (s, t); 1 if that leaves a map of size² texels, or is too wide."""
    last = float(size) - 0.01
    found = wp.float32(1.0)
    if reach <= _WIDEST and wp.min(s, t) >= reach and wp.max(s, t) + reach <= last:
        found = wp.float32(0.0)
        end = int(t + reach) // _TILE + 1
        row = int(t - reach) // _TILE
        while row < end and found < 1.0:
            for column in range(int(s - reach) // _TILE, int(s + reach) // _TILE + 1):
                found = wp.max(found, deepest[face, row, column])
            row += 1
    return found
