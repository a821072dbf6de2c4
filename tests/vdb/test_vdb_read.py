import re
import struct
import tracemalloc
import zlib
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warp_smoke.vdb import Grid, read_grid_names, read_vdb, write_vdb

ZIP, ACTIVE_MASK = 1, 2


def text(string: str) -> bytes:
    """A string as files hold it."""
    return struct.pack("<I", len(string)) + string.encode()


def mask(slots, count: int) -> bytes:
    """A node's bit mask with bits at some slots."""
    bits = np.zeros(count, bool)
    bits[list(slots)] = True
    return np.packbits(bits, bitorder="little").tobytes()


SCALE = text("UniformScaleMap") + struct.pack("<15d", *([0.5] * 15))


def file_of_grid(
    topology: bytes,
    leaves: bytes = b"",
    *,
    flags=0,
    kind="Tree_float_5_4_3",
    metadata=None,
    transform=SCALE,
    parent="",
) -> bytes:
    """A file of one grid "d" without offsets, as streams are written."""
    header = struct.pack("<qIIIB36s", 0x56444220, 224, 10, 0, 0, bytes(36))
    descriptor = text("d") + text(kind) + text(parent) + bytes(24)
    entries = metadata or {}
    info = struct.pack("<I", len(entries))
    info += b"".join(text(key) + text("string") + text(value) for key, value in entries.items())
    start = header + struct.pack("<Ii", 0, 1) + descriptor + struct.pack("<I", flags)
    return start + info + transform + topology + leaves


def node(children, tiles: dict, size: int, inactive=0.0) -> bytes:
    """An inner node whose values are stored raw, for every slot."""
    values = np.full(size**3, inactive, "<f4")
    values[list(tiles)] = list(tiles.values())
    return mask(children, size**3) + mask(tiles, size**3) + b"\6" + values.tobytes()


def root(*children: bytes, tiles=(), background=0.0) -> bytes:
    """A root with tiles (origin, value, active) and children, each with its origin in front."""
    packed = b"".join(struct.pack("<iiif?", *origin, value, active) for origin, value, active in tiles)
    return struct.pack("<ifII", 1, background, len(tiles), len(children)) + packed + b"".join(children)


ORIGIN = struct.pack("<iii", 0, 0, 0)


def one_leaf(stored: bytes, leaf_mask: bytes, *, background=0.0, **grid) -> bytes:
    """A file of one leaf at the origin."""
    topology = root(ORIGIN + node([0], {}, 32) + node([0], {}, 16) + leaf_mask, background=background)
    return file_of_grid(topology, leaf_mask + stored, **grid)


@pytest.fixture
def read(tmp_path):
    """Reads the one grid of a file that is given as bytes."""

    def read(data: bytes, **limits) -> Grid:
        path = tmp_path / "a.vdb"
        path.write_bytes(data)
        return read_vdb(path, **limits)["d"]

    return read


def test_raw_leaf(read):
    """Without any compression a leaf holds all 512 values; those of inactive voxels give way to the background."""
    values = np.arange(512, dtype="<f4")
    grid = read(one_leaf(b"\6" + values.tobytes(), mask([73, 511], 512), background=-1.0))
    assert grid.origin == (1, 1, 1)
    assert grid.shape == (7, 7, 7)
    assert np.argwhere(grid.active).tolist() == [[0, 0, 0], [6, 6, 6]]
    assert grid.values[grid.active].tolist() == [73.0, 511.0]
    assert np.all(grid.values[~grid.active] == -1.0)
    assert (grid.grid_class, grid.half, grid.voxel_size, grid.translation) == ("unknown", False, (0.5,) * 3, (0.0,) * 3)


@pytest.mark.parametrize(("code", "before"), [(0, 0), (1, 0), (2, 4), (3, 64), (4, 4 + 64), (5, 8 + 64)])
@pytest.mark.parametrize("zipped", [False, True])
def test_inactive_value_codes(read, code, before, zipped):
    """What mask compression stores of inactive values is passed over, zipped or not."""
    values = np.float32([4.0, 5.0]).tobytes()
    if zipped:
        stream = zlib.compress(values)
        values = struct.pack("<q", len(stream)) + stream
    inner = b"\0" + (bytes(8) if zipped else b"")
    leaf_mask = mask([0, 3], 512)
    topology = root(ORIGIN + mask([0], 32**3) + bytes(4096) + inner + mask([0], 4096) + bytes(512) + inner + leaf_mask)
    stored = bytes([code]) + b"\xff" * before + values
    flags = ACTIVE_MASK | (ZIP if zipped else 0)
    grid = read(file_of_grid(topology, leaf_mask + stored, flags=flags))
    assert grid.values.ravel().tolist() == [4.0, 0.0, 0.0, 5.0]


def test_tiles(read):
    """Active tiles of upper and lower nodes fill their 128³ and 8³ voxels; inactive ones nothing."""
    upper = node([1], {0: 2.0}, 32) + node([], {17: 3.0}, 16, inactive=9.0)
    grid = read(file_of_grid(root(ORIGIN + upper, tiles=[((4096, 0, 0), 7.0, False)])))
    assert grid.origin == (0, 0, 0)
    assert grid.shape == (128, 128, 128 + 16)
    expected = np.zeros(grid.shape, np.float32)
    expected[:, :, :128] = 2.0
    expected[0:8, 8:16, 128 + 8 : 128 + 16] = 3.0
    np.testing.assert_array_equal(grid.values, expected)
    np.testing.assert_array_equal(grid.active, expected != 0)


@pytest.mark.parametrize(
    ("kind", "numbers", "voxel_size", "translation"),
    [
        ("ScaleMap", [1, 2, 3, *[0] * 12], (1, 2, 3), (0, 0, 0)),
        ("UniformScaleTranslateMap", [5, 6, 7, 2, 2, 2, *[0] * 12], (2, 2, 2), (5, 6, 7)),
        ("ScaleTranslateMap", [5, 6, 7, 1, 2, 3, *[0] * 12], (1, 2, 3), (5, 6, 7)),
    ],
)
def test_transforms(read, kind, numbers, voxel_size, translation):
    """Scales, with and without translation."""
    grid = read(file_of_grid(root(), transform=text(kind) + struct.pack(f"<{len(numbers)}d", *numbers)))
    assert (grid.shape, grid.voxel_size, grid.translation) == ((0, 0, 0), voxel_size, translation)


LEAF = mask([0], 512)
NAN = b"\6" + np.full(512, np.nan, "<f4").tobytes()
FULL = np.zeros(512, "<f4").tobytes()
BOMB = zlib.compress(bytes(10**7))
ROOT_TILE = file_of_grid(root(tiles=[((0, 0, 0), 1.0, True)]))
TWIN = ORIGIN + node([], {}, 32)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "damaged: needs 57 bytes at 0, 0 are left"),
        (b"#usda 1.0" + bytes(99), "not an OpenVDB file"),
        (struct.pack("<qIIIB36s", 0x56444220, 221, 4, 0, 1, bytes(36)), "file version is 221; allowed: 222 to 224"),
        (struct.pack("<qIIIB36sIi", 0x56444220, 224, 4, 0, 1, bytes(36), 0, -1), "number of grids is -1"),
        (struct.pack("<qIIIB36sIi", 0x56444220, 224, 4, 0, 1, bytes(36), 0, 2**31 - 1), "damaged"),
        (file_of_grid(b"", kind="Tree_bool_5_4_3"), "grid 'd': type is 'Tree_bool_5_4_3'; allowed: Tree_float_5_4_3"),
        (file_of_grid(b"", parent="e"), "grid 'd': shares the tree of 'e'"),
        (file_of_grid(b"", flags=6), "grid 'd': compression is blosc; allowed: zip, none"),
        (file_of_grid(b"", transform=text("AffineMap") + bytes(128)), "grid 'd': transform is 'AffineMap'"),
        (file_of_grid(root(), transform=text("ScaleMap") + bytes(120)), "grid 'd': voxel_size is"),
        (file_of_grid(struct.pack("<i", 2)), "grid 'd': damaged: 2 buffers"),
        (file_of_grid(root(TWIN, TWIN)), "grid 'd': damaged: root entry at (0, 0, 0)"),
        (file_of_grid(root(struct.pack("<iii", 0, 1, 0) + TWIN[12:])), "damaged: root entry at (0, 1, 0)"),
        (file_of_grid(root(ORIGIN + node([5], {5: 1.0}, 32))), "has a tile where it has a child"),
        (ROOT_TILE, "grid 'd': active voxels span [4096, 4096, 4096]; allowed: 134217728 voxels"),
        (one_leaf(NAN, LEAF), "grid 'd': value at [0, 0, 0] is not a finite number"),
        (file_of_grid(root(background=np.inf)), "grid 'd': background is inf"),
        (file_of_grid(root(), metadata={"class": "a\nb"}), r"grid 'd': grid_class is a\nb"),
        (one_leaf(b"\7" + FULL, LEAF), "grid 'd': damaged: value code 7"),
        (one_leaf(b"\6" + FULL[:-1], LEAF), "grid 'd': damaged: needs 2048 bytes"),
        (one_leaf(b"", LEAF)[:-64] + bytes(64) + b"\6" + FULL, "damaged: the two masks of a leaf"),
    ],
)
def test_refused(read, data, message):
    """What is damaged or not supported is said in one line with the file's name."""
    with pytest.raises(ValueError, match="a.vdb: .*" + re.escape(message)):
        read(data)


@pytest.mark.parametrize(
    "stored",
    [
        struct.pack("<q", -7) + FULL,
        struct.pack("<q", 2**62) + FULL,
        struct.pack("<q", len(BOMB)) + BOMB,
        struct.pack("<q", 40) + FULL,
        struct.pack("<q", 15) + zlib.compress(FULL[:-4]),
        struct.pack("<q", 10) + zlib.compress(FULL)[:10],
    ],
)
def test_bad_zip(read, stored):
    """Wrong lengths, broken streams and streams that inflate to too little or to much more are damage."""
    topology = root(
        ORIGIN + mask([0], 32**3) + bytes(4096 + 9) + mask([0], 4096) + bytes(512 + 9) + mask(range(512), 512)
    )
    data = file_of_grid(topology, mask(range(512), 512) + b"\0" + stored, flags=ZIP | ACTIVE_MASK)
    with pytest.raises(ValueError, match="damaged"):
        read(data)


def test_far_apart(read):
    """Two voxels far apart would make a huge dense box: refused; the limit can be set."""
    far = struct.pack("<iii", 4096, 0, 0)
    nodes = node([0], {}, 32) + node([0], {}, 16) + LEAF
    leaf = LEAF + b"\6" + np.ones(512, "<f4").tobytes()
    data = file_of_grid(root(ORIGIN + nodes, far + nodes), leaf + leaf)
    grid = read(data)
    assert grid.shape == (4097, 1, 1)
    assert np.count_nonzero(grid.active) == 2
    with pytest.raises(ValueError, match=r"active voxels span \[4104, 8, 8\]; allowed: 1000 voxels"):
        read(data, max_voxels=1000)


def written(folder, half=True) -> bytes:
    """A file with a scalar and a vector grid, some leaves deflated and some raw."""
    x, y, z = np.meshgrid(*[np.linspace(-1, 1, 18, dtype=np.float32)] * 3, indexing="ij")
    density = np.maximum(0, 1 - x * x - y * y - z * z)
    place = {"origin": (-5, 0, 2), "voxel_size": 0.1, "half": half}
    write_vdb(folder / "whole.vdb", [
        Grid("density", density, **place),
        Grid("vel", np.stack([x, y, z], axis=-1), active=density > 0.5, **place),
    ])  # fmt: skip
    return (folder / "whole.vdb").read_bytes()


@pytest.fixture(scope="module", params=[True, False])
def whole(request, tmp_path_factory):
    """The bytes of a good file, of halves or of floats."""
    return written(tmp_path_factory.mktemp("vdb"), request.param)


def can_read(path, data: bytes) -> bool:
    """Whether bytes can be read; anything but grids or a ValueError with the file's name fails the test."""
    path.write_bytes(data)
    for reader in (read_grid_names, partial(read_vdb, max_voxels=64**3)):
        try:
            reader(path)
        except ValueError as error:
            if not str(error).startswith(f"{path}: ") or "\n" in str(error):
                raise
            readable = False
        else:
            readable = True
    return readable


@settings(deadline=None, max_examples=200)
@given(data=st.data())
def test_truncated(tmp_path_factory, whole, data):
    """A file that ends early anywhere is a ValueError."""
    size = data.draw(st.integers(0, len(whole) - 1))
    assert not can_read(tmp_path_factory.getbasetemp() / "cut.vdb", whole[:size])


@settings(deadline=None, max_examples=400)
@given(
    damage=st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.binary(min_size=1, max_size=9)), min_size=1, max_size=4
    )
)
def test_damaged(tmp_path_factory, whole, damage):
    """Bytes overwritten anywhere give grids or a ValueError, quickly and without much memory."""
    damaged = bytearray(whole)
    for place, patch in damage:
        # The places that say how to read on are few: prefer the file's beginning and the nodes' ends.
        at = int(place**3 * len(whole))
        damaged[at : at + len(patch)] = patch
    tracemalloc.start()
    can_read(tmp_path_factory.getbasetemp() / "damaged.vdb", bytes(damaged[: len(whole)]))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 32e6  # a box of 64³ vectors takes 3 MB, three times that while it is filled


@settings(deadline=None, max_examples=200)
@given(noise=st.binary(max_size=300))
def test_noise(tmp_path_factory, whole, noise):
    """Random bytes, alone or behind a good header, are a ValueError or at most an empty file."""
    path = tmp_path_factory.getbasetemp() / "noise.vdb"
    can_read(path, noise)
    can_read(path, whole[:65] + noise)


def test_missing(tmp_path):
    """A file that is not there is an OSError."""
    with pytest.raises(FileNotFoundError):
        read_vdb(tmp_path / "none.vdb")
