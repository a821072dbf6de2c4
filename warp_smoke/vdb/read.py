"""Reads OpenVDB files (`layout`) back into dense grids.

It reads every file from `write`, and any other whose grids are scalars or vectors of 32- or 16-bit floats, raw or
zipped, with a transform of scale and translation; active tiles become voxels. Blosc, other grid types and shared trees
are refused. No byte of a file is trusted: anything wrong in it raises a ValueError.
"""

import os
from collections.abc import Iterator

import numpy as np

from warp_smoke.vdb.grid import Grid
from warp_smoke.vdb.layout import (
    BLOSC,
    FILE_VERSION,
    HALF_SUFFIX,
    HEADER,
    LEAF,
    LEAF_VOXELS,
    MAGIC,
    SCALAR_TREE,
    VECTOR_TREE,
    active_bounds,
)
from warp_smoke.vdb.source import Source
from warp_smoke.vdb.tree import Encoding, Tree, read_leaf, read_topology

OLDEST_VERSION = 222  # the first with compression flags for each grid
# For each map, its number of triples of doubles and which of them is the scale.
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
        Grids by name, in the order of the file. Each is dense over the bounding box of its active voxels, which its
        field `active` marks; the other voxels hold the background. Without active voxels the shape is (0, 0, 0).

    Raises:
        ValueError: the file is damaged, or contains something that this reader does not support.
        OSError: the file cannot be read.
    """
    source = Source(path)
    has_offsets, count = _read_header(source)
    grids = {}
    for _ in range(count):
        grid = _read_grid(source, has_offsets, max_voxels)
        if grid.name in grids:
            raise source.error(f"grid {grid.name!r} occurs twice")
        grids[grid.name] = grid
    return grids


def read_grid_names(path: str | os.PathLike) -> tuple[str, ...]:
    """Reads the names of all grids in a `.vdb` file, of any type and compression, in the order of the file.

    Raises:
        ValueError: the file is cut off or damaged, or too old to say where its grids end.
        OSError: the file cannot be read.
    """
    return tuple(name for name, _ in _grids(Source(path)))


def read_grid_bounds(path: str | os.PathLike) -> dict[str, np.ndarray | None]:
    """Reads the bounds of the active voxels of each grid, of any type and compression, by grid name.

    Returns:
        Lowest and highest corner of these voxels in the file's space, [2, 3]; None if there are none, if the file does
        not give them, or if the grid's transform is more than scale and translation.

    Raises:
        ValueError: as for `read_grid_names`.
        OSError: the file cannot be read.
    """
    source = Source(path)
    return {name: _read_bounds(source, start) for name, start in _grids(source)}


def _grids(source: Source) -> Iterator[tuple[str, int]]:
    """Yields the name and start of each grid."""
    has_offsets, count = _read_header(source)
    if not has_offsets:
        raise source.error("does not say where its grids end; allowed: files with offsets")
    for _ in range(count):
        name = _read_name(source)
        _type, _parent = source.string(), source.string()
        start, _, end = source.unpack("<qqq")
        if not source.position <= start <= end <= len(source.data):
            raise source.error(f"damaged: grid {name!r} ends at byte {end} of {len(source.data)}")
        yield name, start
        source.position = end


def _read_bounds(source: Source, start: int) -> np.ndarray | None:
    source.position = start
    source.unpack("<I")
    metadata = _read_metadata(source)
    corners = [metadata.get(name, b"") for name in ("file_bbox_min", "file_bbox_max")]
    before = source.position
    if source.string() not in MAPS or any(len(corner) != 12 for corner in corners):
        return None
    source.position = before
    scale, translation = _read_transform(source)
    first, last = (np.frombuffer(corner, "<i4").astype(float) for corner in corners)
    if np.any(first > last):
        return None
    return np.sort(translation + scale * np.array([first - 0.5, last + 0.5]), axis=0)


def _read_header(source: Source) -> tuple[bool, int]:
    """Returns whether the file has grid offsets, and how many grids there are."""
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


def _read_name(source: Source) -> str:
    """Reads a grid's name; OpenVDB numbers grids that share a name after a record separator."""
    return source.string().replace("\x1e", " #")


def _read_grid(source: Source, has_offsets: bool, max_voxels: int) -> Grid:
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
    encoding = Encoding(flags, kind != tree_type, (3,) if tree_type == VECTOR_TREE else ())
    tree = read_topology(source, encoding)
    if has_offsets:
        source.expect(leaf_start, "leaves begin")
    leaf_values = [read_leaf(source, encoding, mask) for mask in tree.masks]
    if has_offsets:
        source.expect(end, "grid ends")
    values, active, origin = _dense(source, tree, encoding.decode(b"".join(leaf_values)), max_voxels)
    try:
        grid = Grid(
            name,
            values,
            origin,
            voxel_size=voxel_size,
            translation=translation,
            background=tree.background.tolist(),
            active=active,
            half=encoding.half,
            grid_class=_token(metadata.get("class", b"unknown")),
            vector_type=_token(metadata.get("vector_type", b"invariant")),
        )
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None
    source.label = file
    return grid


def _read_metadata(source: Source) -> dict[str, bytes]:
    (count,) = source.unpack("<I")
    metadata = {}
    for _ in range(count):
        name, _ = source.string(), source.string()
        (size,) = source.unpack("<I")
        metadata[name] = bytes(source.take(size))
    return metadata


def _token(value: bytes) -> str:
    """Decodes a metadata value to text, with unprintable characters escaped."""
    return repr(value.decode("utf-8", "replace"))[1:-1]


def _read_transform(source: Source) -> tuple[list[float], list[float]]:
    """Reads voxel size and translation."""
    kind = source.string()
    if kind not in MAPS:
        raise source.error(f"transform is {kind!r}; allowed: {', '.join(MAPS)}")
    count, scale = MAPS[kind]
    triples = source.array("<f8", 3 * count).reshape(count, 3)
    return triples[scale].tolist(), triples[0].tolist() if scale else [0.0] * 3


def _dense(
    source: Source, tree: Tree, leaf_values: np.ndarray, max_voxels: int
) -> tuple[np.ndarray, np.ndarray, tuple[int, int, int]]:
    """Returns values [nx, ny, nz, ...] and active voxels [nx, ny, nz] of the active bounding box, and its origin."""
    value_shape = tree.background.shape
    occupied = tree.masks.any(axis=1)
    leaves, masks = tree.leaves[occupied], tree.masks[occupied]
    bounds = [(t.lowest.min(axis=0), t.lowest.max(axis=0) + t.span - 1) for t in tree.tiles]
    if len(leaves):
        bounds.append(active_bounds(leaves, masks))
    if not bounds:
        return np.empty((0, 0, 0, *value_shape), np.float32), np.empty((0, 0, 0), bool), (0, 0, 0)
    lowest = np.min([low for low, _ in bounds], axis=0)
    highest = np.max([high for _, high in bounds], axis=0)
    first = lowest // LEAF
    nx, ny, nz = ((highest // LEAF + 1 - first) * LEAF).tolist()
    if nx * ny * nz > max_voxels:
        raise source.error(f"active voxels span {[nx, ny, nz]}; allowed: {max_voxels} voxels")

    values = np.full((nx, ny, nz, *value_shape), tree.background)
    active = np.zeros((nx, ny, nz), bool)
    for tiles in tree.tiles:
        for corner, value in zip((tiles.lowest - first * LEAF).tolist(), tiles.values, strict=True):
            box = tuple(slice(index, index + tiles.span) for index in corner)
            values[box], active[box] = value, True
    blocks = np.full((len(leaves), LEAF_VOXELS, *value_shape), tree.background)
    blocks[masks] = leaf_values
    i, j, k = (leaves - first).T
    split = (nx // LEAF, LEAF, ny // LEAF, LEAF, nz // LEAF, LEAF)
    values.reshape(*split, *value_shape)[i, :, j, :, k] = blocks.reshape(-1, LEAF, LEAF, LEAF, *value_shape)
    active.reshape(split)[i, :, j, :, k] = masks.reshape(-1, LEAF, LEAF, LEAF)

    good = np.isfinite(values)
    if not good.all():
        index = np.argwhere(~good)[0, :3] + first * LEAF
        raise source.error(f"value at {index.tolist()} is not a finite number")
    box = tuple(slice(*ends) for ends in zip(lowest - first * LEAF, highest + 1 - first * LEAF, strict=True))
    return np.ascontiguousarray(values[box]), np.ascontiguousarray(active[box]), tuple(lowest.tolist())
