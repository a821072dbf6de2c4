"""Writes OpenVDB files (`layout`): dense grids in, sparse trees of leaves out.

Inactive voxels are not stored (active mask compression); the active values of a leaf are deflated, or raw where that
does not pay. No active tiles are made: every active voxel lies in a leaf.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from itertools import chain, pairwise
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
LEAVES_PER_TASK = 256


def write_vdb(path: str | os.PathLike, grids: Iterable[Grid], *, compression: str = "zip", threads: int = 1) -> int:
    """Writes grids to a `.vdb` file, all or nothing.

    The file appears under its name only when it is complete; an error leaves what was there before. Equal grids give
    equal bytes, with any number of threads.

    Args:
        path: the file; its folder must exist.
        grids: grids with different names, in the order of the file.
        compression: "zip" or "none".
        threads: threads that gather and deflate leaves.

    Returns:
        Size of the file [bytes].

    Raises:
        FieldError: a value is NaN or infinite, two grids have the same name, or an argument is not allowed.
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
        run = pool.map if threads > 1 else map
        for grid in grids:
            record = _grid_record(grid, position, compression == "zip", run)
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
        position: in units of leaves, [n, 3].
        masks: active voxels, bool [n, 512].
        index: place of each leaf in `blocks`, [3, n].
        blocks: the grid's values, [bx, 8, by, 8, bz, 8] or [bx, 8, by, 8, bz, 8, 3].
    """

    position: np.ndarray
    masks: np.ndarray
    index: np.ndarray
    blocks: np.ndarray

    def active_values(self, chosen: slice) -> np.ndarray:
        """Active values of some leaves, one leaf after the other, [m] or [m, 3]."""
        i, j, k = self.index[:, chosen]
        values = self.blocks[i, :, j, :, k]
        return values.reshape(-1, *values.shape[4:]).compress(self.masks[chosen].ravel(), axis=0)


def _active_leaves(grid: Grid, run: Callable) -> _Leaves:
    # Layer by layer, so that the work fits into the cache; at least one layer, if it is empty.
    start = -(grid.origin[0] % LEAF)
    layers = [slice(max(i, 0), i + LEAF) for i in range(start, max(grid.shape[0], 1), LEAF)]
    found = list(run(partial(_leaves_in_layer, grid), layers))
    position, masks = (np.concatenate(parts) for parts in zip(*found, strict=True))
    root, upper = position // (UPPER * LOWER), position // LOWER
    order = np.lexsort((slots(position % LOWER, LOWER), slots(upper % UPPER, UPPER), *root.T[::-1]))
    position = position[order]
    index = (position - [first // LEAF for first in grid.origin]).T
    return _Leaves(position, masks[order], index, _in_blocks(grid.values, grid.origin))


def _leaves_in_layer(grid: Grid, layer: slice) -> tuple[np.ndarray, np.ndarray]:
    """Positions [n, 3] and masks [n, 512] of the leaves with active voxels in a layer of leaves along i."""
    origin = (grid.origin[0] + layer.start, *grid.origin[1:])
    rows = _in_blocks(_active(grid, layer), origin).view(np.uint64)[..., 0]  # eight voxels along k are one word
    i, j, k = index = np.array(np.bitwise_or.reduce(rows, axis=(1, 3)).nonzero())
    masks = rows[i, :, j, :, k].view(bool).reshape(-1, LEAF_VOXELS)
    return index.T + [first // LEAF for first in origin], masks


def _active(grid: Grid, layer: slice) -> np.ndarray:
    """Which voxels of a layer are active, after a check that all its values are finite."""
    values = grid.values[layer]
    with np.errstate(over="ignore", invalid="ignore"):
        total = values.sum()
    if not np.isfinite(total):  # finite values can have an infinite sum, others never a finite one
        _check_finite(grid, layer)
    if grid.active is not None:
        return grid.active[layer]
    # Rows along k with all their components, so that numpy's inner loops are long.
    nx, ny, nz = values.shape[:3]
    background = np.tile(grid.background, nz)
    rows = values.reshape(nx, ny, len(background))
    if grid.threshold:
        above = rows > (background + grid.threshold).astype(np.float32)
        below = rows < (background - grid.threshold).astype(np.float32)
        outside = np.logical_or(above, below, out=above)
    else:
        outside = rows != background.astype(np.float32)
    outside = outside.reshape(values.shape)
    return outside[..., 0] | outside[..., 1] | outside[..., 2] if grid.is_vector else outside


def _check_finite(grid: Grid, layer: slice) -> None:
    """Raises FieldError if a layer has a value that is not finite."""
    bad = np.argwhere(~np.isfinite(grid.values[layer]))
    if len(bad):
        i, *others = bad[0].tolist()
        index = (layer.start + i, *others)
        raise FieldError(f"grid {grid.name!r}", f"values{list(index)}", grid.values[index], "finite numbers")


def _in_blocks(dense: np.ndarray, origin: tuple[int, int, int]) -> np.ndarray:
    """Dense [nx, ny, nz, ...] as blocks [bx, 8, by, 8, bz, 8, ...] of leaves, padded with zeros to whole leaves."""
    before = [first % LEAF for first in origin]
    after = [-(first + size) % LEAF for first, size in zip(origin, dense.shape[:3], strict=True)]
    if any(before + after):
        dense = np.pad(dense, [*zip(before, after, strict=True), *[(0, 0)] * (dense.ndim - 3)])
    nx, ny, nz, *components = dense.shape
    shape = (nx // LEAF, LEAF, ny // LEAF, LEAF, nz // LEAF, LEAF, *components)
    return np.ascontiguousarray(dense).reshape(shape)


def _grid_record(grid: Grid, position: int, zipped: bool, run: Callable) -> list[bytes]:
    """The bytes of a grid that starts at a position in the file, in pieces."""
    leaves = _active_leaves(grid, run)
    count = len(leaves.position)
    tasks = [slice(first, first + LEAVES_PER_TASK) for first in range(0, count, LEAVES_PER_TASK)]
    buffers = list(run(lambda chosen: _leaf_buffers(leaves, chosen, grid.half, zipped), tasks))
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
    """The root, its upper nodes, their lower nodes and the leaves' masks; depth first."""
    background = np.asarray(grid.background, np.float32)
    if grid.half:
        background = _to_half(background).astype(np.float32)
    # A node without tiles: no inactive values to restore, then an empty value array, which has a length of its own only
    # when it is zipped and not half.
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
    """Slices of equal consecutive rows of keys [n, m]."""
    if len(keys):
        changes = np.any(keys[1:] != keys[:-1], axis=1).nonzero()[0] + 1
        yield from (slice(*ends) for ends in pairwise((0, *changes.tolist(), len(keys))))


def _node_masks(children: np.ndarray, size: int) -> bytes:
    """Child mask with bits at some slots, then a value mask without any."""
    bits = np.zeros(size**3, bool)
    bits[children] = True
    return np.packbits(bits, bitorder="little").tobytes() + bytes(size**3 // 8)


def _leaf_buffers(leaves: _Leaves, chosen: slice, half: bool, zipped: bool) -> bytes:
    """Buffers of some leaves: mask, a zero byte, then the active values with (zipped) or without their length."""
    values = leaves.active_values(chosen)
    values = _to_half(values) if half else values.astype("<f4", copy=False)
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


def _to_half(values: np.ndarray) -> np.ndarray:
    return np.clip(values, -HALF_MAX, HALF_MAX).astype("<f2")
