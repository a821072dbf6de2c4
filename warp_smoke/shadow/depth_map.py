"""Depth maps and their ray casting, tile by tile: six faces of a cube, or one for a cone or a distant light.

LearnOpenGL, *Point Shadows* and *Shadow Mapping*, describes the rasterised originals.
A texel stores the distance to the nearest surface along the ray through its centre, divided by the far distance; 1
where there is none. Row 0 is at the top (least t), column 0 at the left (least s).
"""

import numpy as np
import warp as wp

from warp_smoke.launch import Launcher, Rows
from warp_smoke.shadow import coverage
from warp_smoke.shadow.casters import Casters, nearest_hit
from warp_smoke.shadow.coverage import TRIANGLES_IN_TILE
from warp_smoke.shadow.seen_triangles import Planes, SeenTriangles, covers, greatest_nearness, is_listed

wp.set_module_options({"enable_backward": False})

_TILE = wp.constant(coverage.TILE)
_MOST = wp.constant(TRIANGLES_IN_TILE)


@wp.struct
class MapRays:
    """The rays of a depth map.

    Attributes:
        frames: axes s, t and viewing direction of each face, one per row, [faces].
        perspective: 1, or 0 for a distant light, whose rays are parallel.
        origin: the light in set space; zero for a distant one.
        depth: of the plane that s and t lie in: 1, or the depth in set space at which a distant light's rays begin.
        s, t: of the upper left corner.
        texel: side of a texel.
        start: distance at which hits begin.
        far: distance at which rays end, and the unit of depth.
        cull: if above 0, faces turned to the light do not count.
    """

    frames: wp.array[wp.mat33]
    perspective: int
    origin: wp.vec3
    depth: float
    s: float
    t: float
    texel: float
    start: float
    far: float
    cull: float


@wp.struct
class TileList:
    """Tiles of a map to be traced.

    Attributes:
        tiles: their indices over faces, rows and columns.
        count: number of tiles.
    """

    tiles: wp.array[int]
    count: int


@wp.func
def tile_place(index: int, across: int):
    """Face, row and column of a tile."""
    return index // (across * across), (index // across) % across, index % across


@wp.func
def place_on(r: MapRays, face: int, row: float, column: float):
    """The place (see `seen_triangles`) of a point on a face, given in texels."""
    place = wp.vec3(r.s + r.texel * column, r.t + r.texel * row, 1.0)
    if r.perspective == 1:
        place = wp.transpose(r.frames[face]) * place
    return place


@wp.func
def hit_distance(mesh: wp.uint64, r: MapRays, face: int, place: wp.vec3):
    """Distance of the nearest hit of the ray through a place, found with the hierarchy, or −1."""
    first = place
    ray = place
    if r.perspective == 0:
        first = wp.transpose(r.frames[face]) * wp.vec3(place[0], place[1], r.depth)
        ray = wp.transpose(r.frames[face]) * wp.vec3(0.0, 0.0, 1.0)
    length = wp.length(ray)
    if r.perspective == 1:
        first = r.origin + (r.start / length) * ray
    hit = nearest_hit(mesh, first, ray, (r.far - r.start) / length, r.cull)
    return wp.where(hit < 0.0, -1.0, r.start + hit * length)


@wp.func
def listed_distance(seen: SeenTriangles, r: MapRays, tile: int, place: wp.vec3):
    """Distance of the nearest of a tile's listed triangles along the ray through a place, or −1."""
    distance = wp.float32(-1.0)
    if r.perspective == 1:
        length = wp.length(place)
        nearness = greatest_nearness(seen, tile, place, length / r.start)
        if nearness * r.far >= length:
            distance = length / nearness
    else:
        nearness = greatest_nearness(seen, tile, place, 1.0)
        if nearness > 0.0:
            distance = (1.0 - nearness) * r.far
    return distance


@wp.kernel
def _list_triangles(
    rows: Rows, r: MapRays, seen: SeenTriangles, where: TileList, across: int, listed_out: wp.array2d[int]
):
    """listed[n, 1:] = the triangles that rays of tile n may hit, listed[n, 0] = their number, −1 for too many."""
    n = rows.first + wp.tid()
    if n < where.count:
        face, row, column = tile_place(where.tiles[n], across)
        half = 0.5 * float(_TILE)
        middle = place_on(r, face, float(row * _TILE) + half, float(column * _TILE) + half)
        reach = wp.sqrt(2.0) * half * r.texel
        found = wp.int32(0)
        k = wp.int32(0)
        while k < seen.count and found <= _MOST:
            if covers(seen, k, middle, reach):
                found += 1
                listed_out[n, wp.min(found, _MOST)] = k
            k += 1
        listed_out[n, 0] = wp.where(found <= _MOST, found, -1)


@wp.kernel
def _trace_tiles(
    rows: Rows, mesh: wp.uint64, r: MapRays, seen: SeenTriangles, where: TileList, depth_out: wp.array3d[float]
):
    """depth[f,t,s] = distance of the nearest hit / far, for a row of a tile."""
    n = rows.first + wp.tid()
    within = n % _TILE
    n = n // _TILE
    if n < where.count:
        size = depth_out.shape[1]
        face, row, column = tile_place(where.tiles[n], (size + _TILE - 1) // _TILE)
        row = row * _TILE + within
        if row < size:
            for k in range(column * _TILE, wp.min((column + 1) * _TILE, size)):
                place = place_on(r, face, float(row) + 0.5, float(k) + 0.5)
                distance = wp.float32(-1.0)
                if is_listed(seen, n):
                    distance = listed_distance(seen, r, n, place)
                else:
                    distance = hit_distance(mesh, r, face, place)
                depth_out[face, row, k] = wp.where(distance < 0.0, 1.0, distance / r.far)


@wp.kernel
def _bound_tiles(rows: Rows, depth: wp.array3d[float], where: TileList, deepest_out: wp.array3d[float]):
    """deepest[f,t,s] = max depth in the tile."""
    n = rows.first + wp.tid()
    if n < where.count:
        face, row, column = tile_place(where.tiles[n], deepest_out.shape[1])
        size = depth.shape[1]
        deepest = wp.float32(0.0)
        for i in range(row * _TILE, wp.min((row + 1) * _TILE, size)):
            for j in range(column * _TILE, wp.min((column + 1) * _TILE, size)):
                deepest = wp.max(deepest, depth[face, i, j])
        deepest_out[face, row, column] = deepest


class DepthMap:
    """The memory of a depth map; texels that are not traced stay 1.

    Attributes:
        depth: [faces, size, size] by face, row and column.
        deepest: largest depth in each tile, [faces, rows, columns].
        rays: number of rays in the last trace.
    """

    def __init__(self, launcher: Launcher, faces: int, size: int, triangles: int):
        """Allocates a map for scenes of up to this number of triangles."""
        across = -(-size // coverage.TILE)
        self._launcher = launcher
        self.depth = launcher.zeros((faces, size, size), "shadow_map")
        self.deepest = launcher.zeros((faces, across, across), "shadow_map")
        self._tiles = launcher.zeros(faces * across**2, "shadow_map", dtype=int)
        lists = coverage.tile_lists(faces, size, triangles)
        self._listed = launcher.zeros(lists, "shadow_map", dtype=int)
        self._planes = launcher.zeros(triangles if self.lists_triangles else 0, "shadow_map", dtype=Planes)
        self._covered = np.zeros(self.deepest.shape, bool)
        self._clear()

    @property
    def lists_triangles(self) -> bool:
        """Whether tiles with few triangles are traced without the hierarchy."""
        return len(self._listed) > 0

    def trace(self, casters: Casters, rays: MapRays, covered: np.ndarray, planes: np.ndarray, rounding: float) -> None:
        """Traces the covered tiles.

        Args:
            casters: what the rays may hit.
            rays: the map's rays.
            covered: the tiles to trace, [faces, rows, columns] bool.
            planes: of the casters' triangles, [n, 4, 3]; none unless the map `lists_triangles`.
            rounding: of places; see `SeenTriangles`.
        """
        if np.any(self._covered & ~covered):
            self._clear()
        self._covered = covered
        tiles = np.flatnonzero(covered).astype(np.int32)
        self.rays = len(tiles) * coverage.TILE**2
        if not len(tiles):
            return
        self._tiles[: len(tiles)].assign(tiles)
        where = TileList()
        where.tiles, where.count = self._tiles, len(tiles)
        seen = SeenTriangles()
        if len(planes):
            self._planes[: len(planes)].assign(planes)
        seen.planes, seen.count = self._planes, len(planes)
        seen.rounding, seen.listed = rounding, self._listed
        size, launch = coverage.launch_size(len(tiles)), self._launcher.launch_each
        if self.lists_triangles:
            launch(_list_triangles, size, rays, seen, where, self.deepest.shape[1], self._listed)
        launch(_trace_tiles, size * coverage.TILE, casters.mesh.id, rays, seen, where, self.depth)
        launch(_bound_tiles, size, self.depth, where, self.deepest)

    def _clear(self) -> None:
        self.depth.fill_(1.0)
        self.deepest.fill_(1.0)
