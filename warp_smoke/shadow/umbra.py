"""Where a whole filter is in shadow: how deep what lies in the tiles of a depth map under it is at most.

After the depth pyramid of Greene, Kass and Miller ("Hierarchical Z-Buffer Visibility", 1993), with one level.
"""

import warp as wp

from warp_smoke.shadow.coverage import TILE

wp.set_module_options({"enable_backward": False})

_TILE = wp.constant(TILE)
# Of a filter, in texels: from about there on its taps are fewer than the tiles under it.
_WIDEST = wp.constant(2.0 * TILE)


@wp.func
def deepest_within(deepest: wp.array3d[float], size: int, face: int, s: float, t: float, reach: float):
    """Bound on the depth of the texels within `reach` of (s, t); 1 if they lie beyond a map of size², or are many."""
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
