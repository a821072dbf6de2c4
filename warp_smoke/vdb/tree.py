"""Reads the tree of a grid (`layout`): nodes, masks, active tiles and leaf values."""

import zlib
from dataclasses import dataclass
from math import prod

import numpy as np

from warp_smoke.vdb.layout import ACTIVE_MASK, LEAF, LEAF_VOXELS, LOWER, LOWER_SPAN, UPPER, UPPER_SPAN, ZIP
from warp_smoke.vdb.source import Source


@dataclass(frozen=True)
class Encoding:
    """How a grid's values are stored: compression flags, whether as halves, shape () of scalars or (3,) of vectors."""

    flags: int
    half: bool
    shape: tuple[int, ...]

    @property
    def components(self) -> int:
        """Number of components of a value."""
        return prod(self.shape)

    @property
    def value_size(self) -> int:
        """Size of a value [bytes]."""
        return (2 if self.half else 4) * self.components

    def decode(self, data: bytes) -> np.ndarray:
        """Decodes values to float32, [m, ...]."""
        with np.errstate(invalid="ignore"):  # a NaN is found later
            return np.frombuffer(data, "<f2" if self.half else "<f4").astype(np.float32).reshape(-1, *self.shape)

    def full_value(self, source: Source) -> np.ndarray:
        """Reads a value stored at 32 bits, even in grids of halves."""
        return source.array("<f4", self.components).reshape(self.shape)


@dataclass(frozen=True)
class Tiles:
    """Active tiles of one size: lowest voxel of each [n, 3], voxels along an axis, values [n, ...]."""

    lowest: np.ndarray
    span: int
    values: np.ndarray


@dataclass(frozen=True)
class Tree:
    """A tree without the values of its leaves.

    Attributes:
        background: value of inactive voxels, [] or [3].
        leaves: positions of leaves in units of leaves, [n, 3].
        masks: active voxels of the leaves, bool [n, 512].
        tiles: active tiles.
    """

    background: np.ndarray
    leaves: np.ndarray
    masks: np.ndarray
    tiles: list[Tiles]


def read_topology(source: Source, encoding: Encoding) -> Tree:
    """Reads the root, its tiles and the nodes below it, and the leaves' masks."""
    (buffers,) = source.unpack("<i")
    if buffers != 1:
        raise source.error(f"damaged: {buffers} buffers; allowed: 1")
    background = encoding.full_value(source)
    tile_count, child_count = source.unpack("<II")
    origins, tiles = set(), []
    leaves, masks = [np.empty((0, 3), np.int64)], [np.empty((0, LEAF_VOXELS), bool)]
    for _ in range(tile_count):
        origin = _read_root_origin(source, origins)
        value = encoding.full_value(source)
        if source.take(1)[0]:
            tiles.append(Tiles(origin[None], UPPER_SPAN, value[None]))
    for _ in range(child_count):
        upper = _read_root_origin(source, origins)
        lowers, upper_tiles = _read_node(source, encoding, upper, UPPER, LOWER_SPAN)
        tiles.append(upper_tiles)
        for lower in lowers:
            children, lower_tiles = _read_node(source, encoding, lower, LOWER, LEAF)
            tiles.append(lower_tiles)
            leaves.append(children // LEAF)
            masks.append(source.bits(len(children) * LEAF_VOXELS).reshape(-1, LEAF_VOXELS))
    return Tree(background, np.concatenate(leaves), np.concatenate(masks), [t for t in tiles if len(t.lowest)])


def _read_root_origin(source: Source, seen: set[tuple[int, int, int]]) -> np.ndarray:
    origin = source.unpack("<iii")
    if origin in seen or any(index % UPPER_SPAN for index in origin):
        raise source.error(f"damaged: root entry at {origin}; allowed: multiples of {UPPER_SPAN}, each once")
    seen.add(origin)
    return np.array(origin, np.int64)


def _read_node(
    source: Source, encoding: Encoding, origin: np.ndarray, size: int, span: int
) -> tuple[np.ndarray, Tiles]:
    """Reads an inner node of size³ children of span³ voxels: its children's lowest voxels [n, 3] and active tiles."""
    children, active = source.bits(size**3), source.bits(size**3)
    if np.any(children & active):
        raise source.error(f"damaged: node at {origin.tolist()} has a tile where it has a child")
    values = encoding.decode(_read_values(source, encoding, active))
    child_corners, tile_corners = (
        np.stack(np.unravel_index(mask.nonzero()[0], (size, size, size)), axis=1) * span + origin
        for mask in (children, active)
    )
    return child_corners, Tiles(tile_corners, span, values)


def read_leaf(source: Source, encoding: Encoding, mask: np.ndarray) -> bytes:
    """Reads the bytes of a leaf's active values."""
    if not np.array_equal(source.bits(LEAF_VOXELS), mask):
        raise source.error(f"damaged: the two masks of a leaf before byte {source.position} differ")
    return _read_values(source, encoding, mask)


def _read_values(source: Source, encoding: Encoding, active: np.ndarray) -> bytes:
    """Reads the bytes of a node's active values and skips inactive ones.

    The first byte tells what precedes the values: nothing (0, 1, 6), one (2, 4) or two (5) inactive values, and a mask
    that selects between two (3, 4, 5). With 6, or without mask compression, the values of all slots follow.
    """
    (kind,) = source.take(1)
    if kind > 6:
        raise source.error(f"damaged: value code {kind} at byte {source.position - 1}; allowed: 0 to 6")
    source.take({2: 1, 4: 1, 5: 2}.get(kind, 0) * 4 * encoding.components)
    if kind in (3, 4, 5):
        source.take(len(active) // 8)
    if encoding.flags & ACTIVE_MASK and kind != 6:
        return _read_data(source, encoding, int(np.count_nonzero(active)))
    stored = np.frombuffer(_read_data(source, encoding, len(active)), np.dtype((np.void, encoding.value_size)))
    return stored[active].tobytes()


def _read_data(source: Source, encoding: Encoding, count: int) -> bytes:
    """Reads the bytes of `count` values, inflated."""
    size = count * encoding.value_size
    if not encoding.flags & ZIP or (encoding.half and not count):
        return source.take(size)
    (length,) = source.unpack("<q")
    if length <= 0:
        if -length != size:
            raise source.error(f"damaged: {-length} bytes of values before byte {source.position}, not {size}")
        return source.take(size)
    inflater = zlib.decompressobj()
    try:
        data = inflater.decompress(source.take(length), size + 1)  # never more, whatever the stream claims
    except zlib.error as error:
        raise source.error(f"damaged: zip stream before byte {source.position}: {error}") from None
    if len(data) != size or not inflater.eof:
        raise source.error(f"damaged: zip stream before byte {source.position} does not hold {size} bytes")
    return data
