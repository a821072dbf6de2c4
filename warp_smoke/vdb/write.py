"""Writes OpenVDB files (`layout`): dense grids in, sparse trees of leaves out.

Inactive voxels are not stored (active mask compression); the active values of a leaf are deflated if that pays, else
raw. No active tiles are made: every active voxel lies in a leaf.
"""

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial, reduce
from hashlib import sha256
from itertools import chain, pairwise
from math import ceil, prod
from pathlib import Path
from struct import pack
from uuid import UUID

import numpy as np

from warp_smoke.files import replacing
from warp_smoke.record import FieldError, one_of, whole
from warp_smoke.vdb.deflate import deflate_leaves
from warp_smoke.vdb.grid import INDEX_MAX, INDEX_MIN, Grid
from warp_smoke.vdb.layout import (
    ACTIVE_MASK,
    FILE_VERSION,
    HALF_SUFFIX,
    HEADER,
    LEAF,
    LEAF_VOXELS,
    LOWER,
    MAGIC,
    SCALAR_TREE,
    UPPER,
    UPPER_SPAN,
    VECTOR_TREE,
    ZIP,
    active_bounds,
    slots,
)

COMPRESSIONS = ("zip", "none")
LIBRARY_VERSION = (10, 0)
HALF_MAX = float(np.finfo(np.float16).max)
LEAVES_PER_TASK = (256, 1024)  # fewer are not worth a thread's start, more do not fit into the cache


def write_vdb(path: str | os.PathLike, grids: Iterable[Grid], *, compression: str = "zip", threads: int = 1) -> int:
    """Writes grids to a `.vdb` file, all or nothing.

    The file appears under its name only when it is complete; an error leaves a previous file as it was. Equal grids
    give equal bytes, with any number of threads.

    Args:
        path: the file; its folder must exist.
        grids: grids with different names, in the order to write them.
        compression: "zip" or "none".
        threads: threads that gather and deflate leaves.

    Returns:
        Size of the file [bytes].

    Raises:
        FieldError: an active value is NaN or infinite, two grids have the same name, or an argument is not allowed.
        OSError: the file cannot be written.
    """
    path, grids = Path(path), list(grids)
    one_of(str(path), "compression", compression, COMPRESSIONS)
    whole(str(path), "threads", threads, 1, 1024)
    names = [grid.name for grid in grids]
    if len(set(names)) < len(names):
        raise FieldError(str(path), "names of grids", names, "a different name for each grid")
    body = [pack("<Ii", 0, len(grids))]  # no file metadata
    position = HEADER.size + len(body[0])
    with ThreadPoolExecutor(threads) as pool:
        for grid in grids:
            record = _grid_record(grid, position, compression == "zip", pool, threads)
            body += record
            position += sum(map(len, record))
    digest = sha256()
    for part in body:
        digest.update(part)
    uuid = str(UUID(bytes=digest.digest()[:16])).encode()
    with replacing(path) as partial_path, partial_path.open("wb") as file:
        file.writelines([HEADER.pack(MAGIC, FILE_VERSION, *LIBRARY_VERSION, True, uuid), *body])
    return position


@dataclass(frozen=True)
class _Leaves:
    """The leaves of a grid that have active voxels, in the order of the file.

    Attributes:
        position: position of each leaf in units of leaves, [n, 3].
        masks: active voxels, bool [n, 512].
        index: index of each leaf in `blocks`, [3, n].
        blocks: the grid's values, [bx, 8, by, 8, bz, 8] or [bx, 8, by, 8, bz, 8, 3].
    """

    position: np.ndarray
    masks: np.ndarray
    index: np.ndarray
    blocks: np.ndarray

    def active_values(self, chosen: slice) -> np.ndarray:
        """Returns the active values of some leaves, one leaf after the other, [m] or [m, 3]."""
        i, j, k = self.index[:, chosen]
        values = self.blocks[i, :, j, :, k]
        return values.reshape(-1, *values.shape[4:]).compress(self.masks[chosen].ravel(), axis=0)


def _active_leaves(grid: Grid) -> _Leaves:
    # One layer of leaves at a time, so that the work fits into the cache; at least one layer, even if empty.
    start = -(grid.origin[0] % LEAF)
    layers = [slice(max(i, 0), i + LEAF) for i in range(start, max(grid.shape[0], 1), LEAF)]
    # Allocating this for each layer would cost more than the comparisons.
    room = np.empty((LEAF, *grid.values.shape[1:]), bool) if grid.active is None else None
    found = [_leaves_in_layer(grid, layer, room) for layer in layers]
    position, masks = (np.concatenate(parts) for parts in zip(*found, strict=True))
    root, upper = position // (UPPER * LOWER), position // LOWER
    order = np.lexsort((slots(position % LOWER, LOWER), slots(upper % UPPER, UPPER), *root.T[::-1]))
    position = position[order]
    index = (position - [first // LEAF for first in grid.origin]).T
    return _Leaves(position, masks[order], index, _in_blocks(grid.values, grid.origin))


def _leaves_in_layer(grid: Grid, layer: slice, room: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Returns positions [n, 3] and masks [n, 512] of the leaves with active voxels in a layer of leaves along i."""
    origin = (grid.origin[0] + layer.start, *grid.origin[1:])
    blocks = _in_blocks(grid.active[layer] if room is None else _outside(grid, layer, room), origin)
    words = blocks.reshape(*blocks.shape[:5], prod(blocks.shape[5:])).view(np.uint64)  # eight flags each
    by_leaf = np.bitwise_or.reduce(np.bitwise_or.reduce(words, axis=1), axis=2)
    i, j, k = index = np.array(np.bitwise_or.reduce(by_leaf, axis=-1).nonzero())
    flags = words[i, :, j, :, k].view(bool).reshape(-1, LEAF_VOXELS, words.shape[-1])
    return index.T + [first // LEAF for first in origin], reduce(np.logical_or, np.moveaxis(flags, -1, 0))


def _outside(grid: Grid, layer: slice, room: np.ndarray) -> np.ndarray:
    """Finds the numbers of a layer that differ from the background by more than the threshold; NaN always does.

    Args:
        grid: the grid.
        layer: rows of its values along i, at most eight.
        room: storage for the result, [8, ny, nz] or [8, ny, nz, 3].

    Returns:
        The result: the part of `room` for these rows.
    """
    # Rows along k with all their components, so that numpy's inner loops are long.
    values, room = grid.values[layer], room[: len(grid.values[layer])]
    background = np.tile(grid.background, grid.shape[2])
    rows, outside = (each.reshape(*each.shape[:2], len(background)) for each in (values, room))
    if grid.threshold:
        np.less_equal(rows, (background + grid.threshold).astype(np.float32), out=outside)
        outside &= rows >= (background - grid.threshold).astype(np.float32)
        np.logical_not(outside, out=outside)
    else:
        np.not_equal(rows, background.astype(np.float32), out=outside)
    return room


def _in_blocks(dense: np.ndarray, origin: tuple[int, int, int]) -> np.ndarray:
    """Splits an array [nx, ny, nz, ...] into leaves [bx, 8, by, 8, bz, 8, ...], zero-padded to whole leaves."""
    before = [first % LEAF for first in origin]
    after = [-(first + size) % LEAF for first, size in zip(origin, dense.shape[:3], strict=True)]
    if any(before + after):
        dense = np.pad(dense, [*zip(before, after, strict=True), *[(0, 0)] * (dense.ndim - 3)])
    nx, ny, nz, *components = dense.shape
    shape = (nx // LEAF, LEAF, ny // LEAF, LEAF, nz // LEAF, LEAF, *components)
    return np.ascontiguousarray(dense).reshape(shape)


def _grid_record(grid: Grid, position: int, zipped: bool, pool: ThreadPoolExecutor, threads: int) -> list[bytes]:
    """Returns the bytes of a grid that starts at a position in the file, in pieces."""
    leaves = _active_leaves(grid)
    count = len(leaves.position)
    fewest, most = LEAVES_PER_TASK
    size = min(max(ceil(count / threads), fewest), most)
    tasks = [slice(first, first + size) for first in range(0, count, size)]
    run = pool.map if threads > 1 and len(tasks) > 1 else map
    buffers = list(run(partial(_leaf_buffers, grid, leaves, zipped), tasks))
    tree_type = (VECTOR_TREE if grid.is_vector else SCALAR_TREE) + (HALF_SUFFIX if grid.half else "")
    descriptor = _string(grid.name) + _string(tree_type) + _string("")
    content = b"".join(
        (
            pack("<I", ACTIVE_MASK | (ZIP if zipped else 0)),
            _metadata(grid, leaves, zipped),
            _transform(grid),
            *_topology(grid, leaves, zipped),
        )
    )
    start = position + len(descriptor) + 24
    leaf_start = start + len(content)
    end = leaf_start + sum(map(len, buffers))
    return [descriptor, pack("<qqq", start, leaf_start, end), content, *buffers]


def _string(text: str) -> bytes:
    data = text.encode()
    return pack("<I", len(data)) + data


def _metadata(grid: Grid, leaves: _Leaves, zipped: bool) -> bytes:
    lowest, highest = [INDEX_MAX] * 3, [INDEX_MIN] * 3
    if len(leaves.position):
        lowest, highest = active_bounds(leaves.position, leaves.masks)
    entries = {
        "class": ("string", grid.grid_class.encode()),
        "file_bbox_max": ("vec3i", pack("<iii", *highest)),
        "file_bbox_min": ("vec3i", pack("<iii", *lowest)),
        "file_compression": ("string", b"zip + active values" if zipped else b"active values"),
        "file_voxel_count": ("int64", pack("<q", np.count_nonzero(leaves.masks))),
        "is_saved_as_half_float": ("bool", pack("<?", grid.half)),
        "name": ("string", grid.name.encode()),
    }
    if grid.is_vector:
        entries["vector_type"] = ("string", grid.vector_type.encode())
    return pack("<I", len(entries)) + b"".join(
        _string(key) + _string(kind) + pack("<I", len(value)) + value for key, (kind, value) in entries.items()
    )


def _transform(grid: Grid) -> bytes:
    scale = np.array(grid.voxel_size)
    kind = "UniformScaleTranslateMap" if len(set(grid.voxel_size)) == 1 else "ScaleTranslateMap"
    numbers = np.array([grid.translation, scale, scale, 1 / scale, 1 / scale**2, 0.5 / scale])
    return _string(kind) + numbers.astype("<f8").tobytes()


def _topology(grid: Grid, leaves: _Leaves, zipped: bool) -> Iterator[bytes]:
    """Yields the root, its upper nodes, their lower nodes and the leaves' masks, depth first."""
    background = np.asarray(grid.background, np.float32)
    if grid.half:
        background = _to_half(background).astype(np.float32)
    # A node without tiles: no inactive values to restore, then an empty value array, which is preceded by a length
    # only if zipped and not half.
    no_values = b"\0" + (bytes(8) if zipped and not grid.half else b"")
    leaf_masks = np.packbits(leaves.masks, axis=1, bitorder="little")
    roots = list(_runs(leaves.position // (UPPER * LOWER)))
    yield pack("<i", 1) + background.astype("<f4").tobytes() + pack("<II", 0, len(roots))
    for in_upper in roots:
        position = leaves.position[in_upper]
        origin = position[0] // (UPPER * LOWER) * UPPER_SPAN
        lower = position // LOWER
        yield origin.astype("<i4").tobytes() + _node_masks(slots(lower % UPPER, UPPER), UPPER) + no_values
        for in_lower in _runs(lower):
            yield _node_masks(slots(position[in_lower] % LOWER, LOWER), LOWER) + no_values
            yield leaf_masks[in_upper][in_lower].tobytes()


def _runs(keys: np.ndarray) -> Iterator[slice]:
    """Yields slices of equal consecutive rows of keys [n, m]."""
    if len(keys):
        changes = np.any(keys[1:] != keys[:-1], axis=1).nonzero()[0] + 1
        yield from (slice(*ends) for ends in pairwise((0, *changes.tolist(), len(keys))))


def _node_masks(children: np.ndarray, size: int) -> bytes:
    """Returns a child mask with these slots set, then an empty value mask."""
    bits = np.zeros(size**3, bool)
    bits[children] = True
    return np.packbits(bits, bitorder="little").tobytes() + bytes(size**3 // 8)


def _leaf_buffers(grid: Grid, leaves: _Leaves, zipped: bool, chosen: slice) -> bytes:
    """Returns the buffers of some leaves: mask, zero byte, then active values, with their length first if zipped."""
    values = leaves.active_values(chosen)
    with np.errstate(over="ignore", invalid="ignore"):
        total = values.sum()
    if not np.isfinite(total):  # finite values can overflow the sum, but others never have a finite one
        _check_finite(grid, leaves, chosen)
    values = _to_half(values) if grid.half else values.astype("<f4", copy=False)
    masks = leaves.masks[chosen]
    counts = np.count_nonzero(masks, axis=1) * (values.size // len(values))
    heads = np.zeros((len(masks), 65 + 8 * zipped), np.uint8)
    heads[:, :64] = np.packbits(masks, axis=1, bitorder="little")
    if zipped:
        payloads = deflate_leaves(values, counts)
        lengths = np.fromiter(map(len, payloads), "<i8")
        lengths[lengths == counts * values.itemsize] *= -1  # raw
        heads[:, 65:] = lengths[:, None].view(np.uint8)
    else:
        payloads = np.split(values, np.cumsum(np.count_nonzero(masks, axis=1))[:-1])
    return b"".join(chain.from_iterable(zip(heads, payloads, strict=True)))


def _check_finite(grid: Grid, leaves: _Leaves, chosen: slice) -> None:
    """Raises FieldError if some leaves have an active value that is not finite."""
    leaf, voxel = leaves.masks[chosen].nonzero()
    position = leaves.position[chosen][leaf] * LEAF + np.stack(np.unravel_index(voxel, (LEAF,) * 3), axis=-1)
    bad = np.argwhere(~np.isfinite(leaves.active_values(chosen)))
    if len(bad):
        number, *component = bad[0].tolist()
        value = grid.values[(*(position[number] - grid.origin), *component)]
        raise FieldError(f"grid {grid.name!r}", f"voxel {position[number].tolist()}", value, "finite numbers")


def _to_half(values: np.ndarray) -> np.ndarray:
    return np.clip(values, -HALF_MAX, HALF_MAX).astype("<f2")
