"""Where a light's shadows may fall: tiles of directions in which there may be a caster. The rest is lit, untested."""

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher
from warp_smoke.shadow.coverage import TILE

wp.set_module_options({"enable_backward": False})

_TILE = wp.constant(TILE)


@wp.struct
class CasterMask:
    """Tiles of one map, or of six faces of a cube, around a light or perpendicular to a distant one.

    Attributes:
        tiles: 1 where a caster may lie, [faces, rows, columns].
        size: texels along a side, `TILE` in a tile.
        frames: axes s, t and viewing direction of each face, one per row, [faces].
        origin: the light, or the middle of a distant light's map, in set space.
        half_width: of a face, at distance 1 from the light or, for a distant light, in stage units.
        perspective: 1, or 0 for a distant light.
    """

    tiles: wp.array3d[int]
    size: int
    frames: wp.array[wp.mat33]
    origin: wp.vec3
    half_width: float
    perspective: int


@wp.func
def face_towards(r: wp.vec3):
    """The cube face that a direction passes through."""
    x = wp.abs(r[0])
    y = wp.abs(r[1])
    z = wp.abs(r[2])
    face = wp.where(r[2] < 0.0, 5, 4)
    if x >= y and x >= z:
        face = wp.where(r[0] < 0.0, 1, 0)
    elif y >= z:
        face = wp.where(r[1] < 0.0, 3, 2)
    return face


@wp.func
def may_be_shadowed(m: CasterMask, point: wp.vec3):
    """Whether there may be a caster around the direction from the light to a point; false outside the map."""
    r = point - m.origin
    face = wp.int32(0)
    if m.tiles.shape[0] == 6:
        face = face_towards(r)
    v = m.frames[face] * r
    depth = wp.where(m.perspective == 1, v[2], 1.0)
    found = wp.int32(0)
    if depth > 0.0:
        limit = float(m.size)
        scale = 0.5 * limit / (m.half_width * wp.max(depth, 1.0e-30))
        s = 0.5 * limit + scale * v[0]
        t = 0.5 * limit + scale * v[1]
        if s >= 0.0 and t >= 0.0 and s <= limit and t <= limit:
            found = m.tiles[face, wp.min(int(t), m.size - 1) // _TILE, wp.min(int(s), m.size - 1) // _TILE]
    return found != 0


class CasterTiles:
    """The memory of a caster mask.

    Attributes:
        mask: as it was last placed, for kernels that use `may_be_shadowed`.
    """

    def __init__(self, launcher: Launcher, faces: int, size: int):
        """Allocates tiles for this number of faces of size² texels."""
        count = -(-size // TILE)
        self._size = size
        self._tiles = launcher.zeros((faces, count, count), "shadow_mask", dtype=int)
        self._frames = launcher.zeros(faces, "shadow_mask", dtype=wp.mat33)

    def place(
        self, tiles: np.ndarray, frames: np.ndarray, origin: np.ndarray, half_width: float, perspective: bool
    ) -> None:
        """Sets the mask; see `CasterMask` for the arguments."""
        self._tiles.assign(tiles.astype(np.int32))
        self._frames.assign(frames.astype(np.float32))
        mask = self.mask = CasterMask()
        mask.tiles, mask.size, mask.frames = self._tiles, self._size, self._frames
        mask.origin, mask.half_width, mask.perspective = wp.vec3(*origin.tolist()), half_width, int(perspective)
