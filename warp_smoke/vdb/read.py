"""Reads OpenVDB files (`layout`) back into dense grids.

That is every file of `write`, and others as far as they hold scalar or vector grids of 32- or 16-bit floats, raw or
zipped, placed by scale and translation; active tiles become voxels. Blosc, level sets, other types of grid and trees
that grids share are refused. No byte of a file is trusted: whatever is wrong with it ends in a ValueError.
"""

import os
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warp_smoke.vdb.grid import Grid
from warp_smoke.vdb.layout import (
    ACTIVE_MASK,
    BLOSC,
    FILE_VERSION,
    HALF_SUFFIX,
    HEADER,
    LEAF,
    LEAF_VOXELS,
    LOWER,
    LOWER_SPAN,
    MAGIC,
    SCALAR_TREE,
    UPPER,
    UPPER_SPAN,
    VECTOR_TREE,
    ZIP,
    active_bounds,
)

OLDEST_VERSION = 222  # the first with compression flags for each grid
# Maps by the number of their double triples, and which of these is the scale.
MAPS = {
    "UniformScaleTranslateMap": (6, 1),
    "ScaleTranslateMap": (6, 1),
    "UniformScaleMap": (5, 0),
    "ScaleMap": (5, 0),
}


def read_vdb(path: str | os.PathLike, *, max_voxels: int = 512**3) -> dict[str, Grid]:
    """Reads all grids of a `.vdb` file.

    Args:
        path: the file.
        max_voxels: most voxels that the dense box of a grid may have, in whole leaves.

    Returns:
        Grids by name, in the order of the file. Each is dense over the bounding box of its active voxels. Its field
        `active` tells which those are; the others in the box hold the background. Without any, its shape is (0, 0, 0).

    Raises:
        ValueError: the file is damaged, or has something in it that this reader does not support.
        OSError: the file cannot be read.
    """
    source = _Source(path)
    has_offsets, count = _read_header(source)
    grids = {}
    for _ in range(count):
        grid = _read_grid(source, has_offsets, max_voxels)
        if grid.name in grids:
            raise source.error("name occurs twice")
        grids[grid.name] = grid
    return grids


def read_grid_names(path: str | os.PathLike) -> tuple[str, ...]:
    """Names of all grids in a `.vdb` file, of whatever type and compression, in the order of the file.

    Raises:
        ValueError: the file is cut off or damaged, or too old to say where its grids end.
        OSError: the file cannot be read.
    """
    source = _Source(path)
    has_offsets, count = _read_header(source)
    if not has_offsets:
        raise source.error("does not say where its grids end; allowed: files with offsets")
    names = []
    for _ in range(count):
        names.append(_read_name(source))
        _type, _parent = source.string(), source.string()
        *_, end = source.unpack("<qqq")
        if not source.position <= end <= len(source.data):
            raise source.error(f"damaged: grid {names[-1]!r} ends at byte {end} of {len(source.data)}")
        source.position = end
    return tuple(names)


def _read_header(source: "_Source") -> tuple[bool, int]:
    """Whether grids say where they are, and how many there are."""
    magic, version, _, _, has_offsets, _ = source.unpack(HEADER.format)
    if magic != MAGIC:
        raise source.error("not an OpenVDB file")
    if not OLDEST_VERSION <= version <= FILE_VERSION:
        raise source.error(f"file version is {version}; allowed: {OLDEST_VERSION} to {FILE_VERSION}")
    _read_metadata(source)
    (count,) = source.unpack("<i")
    if count < 0:
        raise source.error(f"number of grids is {count}; allowed: ≥ 0")
    return bool(has_offsets), count


class _Source:
    """A file's bytes and how far they have been read; knows how to complain about them."""

    def __init__(self, path: str | os.PathLike):
        self.label = str(path)
        self.data = memoryview(Path(path).read_bytes())
        self.position = 0

    def error(self, text: str) -> ValueError:
        return ValueError(f"{self.label}: {text}")

    def take(self, size: int) -> memoryview:
        left = len(self.data) - self.position
        if size > left:
            raise self.error(f"damaged: needs {size} bytes at {self.position}, {left} are left")
        self.position += size
        return self.data[self.position - size : self.position]

    def unpack(self, layout: str) -> tuple:
        return struct.unpack(layout, self.take(struct.calcsize(layout)))

    def array(self, dtype: str, count: int) -> np.ndarray:
        return np.frombuffer(self.take(count * np.dtype(dtype).itemsize), dtype)

    def bits(self, count: int) -> np.ndarray:
        return np.unpackbits(self.array("u1", count // 8), bitorder="little").view(bool)

    def string(self) -> str:
        (size,) = self.unpack("<I")
        try:
            return str(self.take(size), "utf-8")
        except UnicodeDecodeError:
            raise self.error(f"damaged: no UTF-8 text before byte {self.position}") from None

    def expect(self, position: int, what: str) -> None:
        if position != self.position:
            raise self.error(f"damaged: {what} at byte {position}, not {self.position}")


@dataclass(frozen=True)
class _Encoding:
    """How a grid's values are stored."""

    flags: int
    half: bool
    components: int

    @property
    def value_size(self) -> int:
        """Bytes of a value."""
        return (2 if self.half else 4) * self.components

    def decode(self, data: bytes) -> np.ndarray:
        """Values [m, components], float32."""
        with np.errstate(invalid="ignore"):  # a NaN is found later
            return np.frombuffer(data, "<f2" if self.half else "<f4").astype(np.float32).reshape(-1, self.components)


def _read_name(source: _Source) -> str:
    """A grid's name; OpenVDB numbers grids of one name behind a record separator."""
    return source.string().replace("\x1e", " #")


def _read_grid(source: _Source, has_offsets: bool, max_voxels: int) -> Grid:
    name = _read_name(source)
    file, source.label = source.label, f"{source.label}: grid {name!r}"
    kind, parent = source.string(), source.string()
    start, leaf_start, end = source.unpack("<qqq")
    tree_type = kind.removesuffix(HALF_SUFFIX)
    if tree_type not in (SCALAR_TREE, VECTOR_TREE):
        raise source.error(f"type is {kind!r}; allowed: {SCALAR_TREE}, {VECTOR_TREE}")
    if parent:
        raise source.error(f"shares the tree of {parent!r}; allowed: grids with a tree of their own")
    if has_offsets:
        source.expect(start, "grid begins")
    (flags,) = source.unpack("<I")
    if flags & BLOSC:
        raise source.error("compression is blosc; allowed: zip, none")
    metadata = _read_metadata(source)
    voxel_size, translation = _read_transform(source)
    encoding = _Encoding(flags, kind != tree_type, 3 if tree_type == VECTOR_TREE else 1)
    tree = _read_topology(source, encoding)
    if has_offsets:
        source.expect(leaf_start, "leaves begin")
    leaf_values = [_read_leaf(source, encoding, mask) for mask in tree.masks]
    if has_offsets:
        source.expect(end, "grid ends")
    values, active, origin = _dense(source, tree, encoding.decode(b"".join(leaf_values)), max_voxels)
    if encoding.components == 1:
        values = values[..., 0]
    try:
        grid = Grid(
            name,
            values,
            origin,
            voxel_size=voxel_size,
            translation=translation,
            background=tuple(tree.background.tolist()) if encoding.components == 3 else float(tree.background[0]),
            active=active,
            half=encoding.half,
            grid_class=_token(metadata.get("class", b"unknown")),
            vector_type=_token(metadata.get("vector_type", b"invariant")),
        )
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    source.label = file
    return grid


def _read_metadata(source: _Source) -> dict[str, bytes]:
    (count,) = source.unpack("<I")
    metadata = {}
    for _ in range(count):
        name, _ = source.string(), source.string()
        (size,) = source.unpack("<I")
        metadata[name] = bytes(source.take(size))
    return metadata


def _token(value: bytes) -> str:
    """Text of a metadata value, escaped where it cannot be printed."""
    return repr(value.decode("utf-8", "replace"))[1:-1]


def _read_transform(source: _Source) -> tuple[list[float], list[float]]:
    """Voxel size and translation."""
    kind = source.string()
    if kind not in MAPS:
        raise source.error(f"transform is {kind!r}; allowed: {', '.join(MAPS)}")
    count, scale = MAPS[kind]
    triples = source.array("<f8", 3 * count).reshape(count, 3)
    return triples[scale].tolist(), triples[0].tolist() if scale else [0.0] * 3


@dataclass(frozen=True)
class _Tiles:
    """Active tiles of one size: lowest voxels [n, 3], voxels along an axis, values [n, components]."""

    lowest: np.ndarray
    span: int
    values: np.ndarray


@dataclass(frozen=True)
class _Tree:
    """A tree but for the values of its leaves.

    Attributes:
        background: value of inactive voxels, [components].
        leaves: positions of leaves in units of leaves, [n, 3].
        masks: active voxels of the leaves, bool [n, 512].
        tiles: active tiles.
    """

    background: np.ndarray
    leaves: np.ndarray
    masks: np.ndarray
    tiles: list[_Tiles]


def _read_topology(source: _Source, encoding: _Encoding) -> _Tree:
    (buffers,) = source.unpack("<i")
    if buffers != 1:
        raise source.error(f"damaged: {buffers} buffers; allowed: 1")
    background = source.array("<f4", encoding.components)
    tile_count, child_count = source.unpack("<II")
    origins, tiles = set(), []
    leaves, masks = [np.empty((0, 3), np.int64)], [np.empty((0, LEAF_VOXELS), bool)]
    for _ in range(tile_count):
        origin = _read_root_origin(source, origins)
        value = source.array("<f4", encoding.components)
        if source.take(1)[0]:
            tiles.append(_Tiles(origin[None], UPPER_SPAN, value[None]))
    for _ in range(child_count):
        upper = _read_root_origin(source, origins)
        lowers, upper_tiles = _read_node(source, encoding, upper, UPPER, LOWER_SPAN)
        tiles.append(upper_tiles)
        for lower in lowers:
            children, lower_tiles = _read_node(source, encoding, lower, LOWER, LEAF)
            tiles.append(lower_tiles)
            leaves.append(children // LEAF)
            masks.append(source.bits(len(children) * LEAF_VOXELS).reshape(-1, LEAF_VOXELS))
    return _Tree(background, np.concatenate(leaves), np.concatenate(masks), [t for t in tiles if len(t.lowest)])


def _read_root_origin(source: _Source, seen: set[tuple[int, int, int]]) -> np.ndarray:
    origin = source.unpack("<iii")
    if origin in seen or any(index % UPPER_SPAN for index in origin):
        raise source.error(f"damaged: root entry at {origin}; allowed: multiples of {UPPER_SPAN}, each once")
    seen.add(origin)
    return np.array(origin, np.int64)


def _read_node(
    source: _Source, encoding: _Encoding, origin: np.ndarray, size: int, span: int
) -> tuple[np.ndarray, _Tiles]:
    """Lowest voxels [n, 3] of the children of an inner node of size³ children of span³ voxels; its active tiles."""
    children, active = source.bits(size**3), source.bits(size**3)
    if np.any(children & active):
        raise source.error(f"damaged: node at {origin.tolist()} has a tile where it has a child")
    values = encoding.decode(_read_values(source, encoding, active))
    child_corners, tile_corners = (
        np.stack(np.unravel_index(mask.nonzero()[0], (size, size, size)), axis=1) * span + origin
        for mask in (children, active)
    )
    return child_corners, _Tiles(tile_corners, span, values)


def _read_leaf(source: _Source, encoding: _Encoding, mask: np.ndarray) -> bytes:
    """Bytes of a leaf's active values."""
    if not np.array_equal(source.bits(LEAF_VOXELS), mask):
        raise source.error(f"damaged: the two masks of a leaf before byte {source.position} differ")
    return _read_values(source, encoding, mask)


def _read_values(source: _Source, encoding: _Encoding, active: np.ndarray) -> bytes:
    """Bytes of a node's active values; inactive ones are passed over.

    A byte tells what comes before the values: nothing (0, 1, 6), one (2, 4) or two (5) inactive values, and a mask that
    selects between two (3, 4, 5). With 6, or without mask compression, the values of all slots follow.
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


def _read_data(source: _Source, encoding: _Encoding, count: int) -> bytes:
    """Bytes of some values, inflated."""
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


def _dense(
    source: _Source, tree: _Tree, leaf_values: np.ndarray, max_voxels: int
) -> tuple[np.ndarray, np.ndarray, tuple[int, int, int]]:
    """Values [nx, ny, nz, components] and active voxels [nx, ny, nz] of the active bounding box, and its origin."""
    components = len(tree.background)
    occupied = tree.masks.any(axis=1)
    leaves, masks = tree.leaves[occupied], tree.masks[occupied]
    bounds = [(t.lowest.min(axis=0), t.lowest.max(axis=0) + t.span - 1) for t in tree.tiles]
    if len(leaves):
        bounds.append(active_bounds(leaves, masks))
    if not bounds:
        return np.empty((0, 0, 0, components), np.float32), np.empty((0, 0, 0), bool), (0, 0, 0)
    lowest = np.min([low for low, _ in bounds], axis=0)
    highest = np.max([high for _, high in bounds], axis=0)
    first = lowest // LEAF
    nx, ny, nz = ((highest // LEAF + 1 - first) * LEAF).tolist()
    if nx * ny * nz > max_voxels:
        raise source.error(f"active voxels span {[nx, ny, nz]}; allowed: {max_voxels} voxels")

    values, active = np.empty((nx, ny, nz, components), np.float32), np.zeros((nx, ny, nz), bool)
    values[:] = tree.background
    for tiles in tree.tiles:
        for corner, value in zip((tiles.lowest - first * LEAF).tolist(), tiles.values, strict=True):
            box = tuple(slice(index, index + tiles.span) for index in corner)
            values[box], active[box] = value, True
    blocks = np.empty((len(leaves), LEAF_VOXELS, components), np.float32)
    blocks[:] = tree.background
    blocks[masks] = leaf_values
    i, j, k = (leaves - first).T
    split = (nx // LEAF, LEAF, ny // LEAF, LEAF, nz // LEAF, LEAF)
    values.reshape(*split, components)[i, :, j, :, k] = blocks.reshape(-1, LEAF, LEAF, LEAF, components)
    active.reshape(split)[i, :, j, :, k] = masks.reshape(-1, LEAF, LEAF, LEAF)

    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        raise source.error(f"value at {(bad[0, :3] + first * LEAF).tolist()} is not a finite number")
    box = tuple(slice(*ends) for ends in zip(lowest - first * LEAF, highest + 1 - first * LEAF, strict=True))
    return np.ascontiguousarray(values[box]), np.ascontiguousarray(active[box]), tuple(lowest.tolist())
