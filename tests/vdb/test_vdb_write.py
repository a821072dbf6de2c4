import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warp_smoke.record import FieldError
from warp_smoke.vdb import Grid, read_vdb, write_vdb


def ball(shape=(21, 18, 30), radius=9.0, seed=0, vector=False):
    """A noisy ball: values fall to 0 at the radius, float32."""
    rng = np.random.default_rng(seed)
    axes = np.meshgrid(*(np.arange(n) - (n - 1) / 2 for n in shape), indexing="ij")
    density = np.maximum(0.0, 1.0 - sum(x * x for x in axes) / radius**2)
    if vector:
        return (density[..., None] * rng.standard_normal((*shape, 3))).astype(np.float32)
    return (density * rng.uniform(0.5, 1.5, shape)).astype(np.float32)


def stored(grid: Grid) -> np.ndarray:
    """What a file holds of a grid's active values."""
    values = np.clip(grid.values, -65504, 65504).astype(np.float16) if grid.half else grid.values
    return values.astype(np.float32)


def assert_round_trip(grid: Grid, active: np.ndarray, read: Grid) -> None:
    """The grid that was read has exactly the active voxels and values of the one that was written, where they were."""
    background = np.asarray(grid.background, np.float16 if grid.half else np.float32).astype(np.float32)
    np.testing.assert_array_equal(np.asarray(read.background, np.float32), background)
    for field in ("name", "voxel_size", "translation", "half", "grid_class", "vector_type"):
        assert getattr(read, field) == getattr(grid, field)
    if not active.any():
        assert read.shape == (0, 0, 0)
        return
    where = np.argwhere(active)
    lowest, highest = where.min(axis=0), where.max(axis=0)
    assert read.origin == tuple((lowest + grid.origin).tolist())
    box = tuple(slice(a, b + 1) for a, b in zip(lowest, highest, strict=True))
    np.testing.assert_array_equal(read.active, active[box])
    expected = np.broadcast_to(background, read.values.shape).copy()
    expected[read.active] = stored(grid)[box][read.active]
    np.testing.assert_array_equal(read.values.view(np.uint32), expected.view(np.uint32))


@settings(deadline=None, max_examples=80)
@given(
    shape=st.tuples(*[st.integers(0, 20)] * 3),
    origin=st.tuples(*[st.integers(-5000, 5000)] * 3),
    vector=st.booleans(),
    half=st.booleans(),
    compression=st.sampled_from(["zip", "none"]),
    share=st.sampled_from([0.0, 0.01, 0.3, 1.0]),
    background=st.sampled_from([0.0, 1.5, 293.1]),
    threads=st.integers(1, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_round_trip(tmp_path_factory, shape, origin, vector, half, compression, share, background, threads, seed):
    """Any box of voxels, anywhere and active anyhow, comes back bit for bit."""
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((*shape, 3) if vector else shape).astype(np.float32)
    active = rng.random(shape) < share
    grid = Grid(
        "density",
        values,
        origin,
        voxel_size=(0.1, 0.2, 0.3),
        translation=(1.0, -2.0, 1e-3),
        background=background,
        active=active,
        half=half,
        grid_class="staggered" if vector else "fog volume",
        vector_type="contravariant relative" if vector else "invariant",
    )
    path = tmp_path_factory.mktemp("vdb") / "smoke.vdb"
    size = write_vdb(path, [grid], compression=compression, threads=threads)
    assert size == path.stat().st_size
    grids = read_vdb(path)
    assert list(grids) == ["density"]
    assert_round_trip(grid, active, grids["density"])


@pytest.mark.parametrize("origin", [(0, 0, 0), (-1, -1, -1), (-4096, 4095, 123), (-(2**31), 2**31 - 1, 0)])
def test_single_voxel(tmp_path, origin):
    """One voxel comes back where it was, also at the ends of index space."""
    grid = Grid("density", np.full((1, 1, 1), 0.25, np.float32), origin, voxel_size=1.0)
    write_vdb(tmp_path / "a.vdb", [grid])
    read = read_vdb(tmp_path / "a.vdb")["density"]
    assert read.origin == origin
    np.testing.assert_array_equal(read.values, grid.values)


def test_several_roots(tmp_path):
    """A grid around the corner of eight root children of 4096³ voxels comes back."""
    grid = Grid("density", ball((16, 16, 16)), (-5, 4096 - 7, -4096 - 8), voxel_size=0.5)
    write_vdb(tmp_path / "a.vdb", [grid])
    assert_round_trip(grid, grid.values != 0, read_vdb(tmp_path / "a.vdb")["density"])


def test_several_grids(tmp_path):
    """Grids of different kinds share a file and keep their order."""
    density = Grid("density", ball(), voxel_size=0.1)
    temperature = Grid("temperature", ball(seed=1) + 293, voxel_size=0.1, background=293.0, half=False)
    velocity = Grid("vel", ball(vector=True), voxel_size=0.1, vector_type="contravariant relative")
    write_vdb(tmp_path / "a.vdb", [velocity, density, temperature])
    grids = read_vdb(tmp_path / "a.vdb")
    assert list(grids) == ["vel", "density", "temperature"]
    assert_round_trip(velocity, np.any(velocity.values != 0, axis=-1), grids["vel"])
    assert_round_trip(density, density.values != 0, grids["density"])
    assert_round_trip(temperature, temperature.values != 293, grids["temperature"])


def test_no_grids(tmp_path):
    """A file without grids is a file."""
    write_vdb(tmp_path / "a.vdb", [])
    assert read_vdb(tmp_path / "a.vdb") == {}


@pytest.mark.parametrize("vector", [False, True])
def test_threshold(tmp_path, vector):
    """A voxel is active where a component is further from the background than the threshold, and only there."""
    values = np.float32([1.0, 1.25, 0.75, 1.2500001, 0.7499999, 3.0]).reshape(1, 1, 6)
    active = np.array([False, False, False, True, True, True]).reshape(1, 1, 6)
    if vector:
        values = np.stack([np.ones_like(values), values, np.ones_like(values)], axis=-1)
    grid = Grid("density", values, voxel_size=1.0, background=1.0, threshold=0.25, half=False)
    write_vdb(tmp_path / "a.vdb", [grid])
    assert_round_trip(grid, active, read_vdb(tmp_path / "a.vdb")["density"])


def test_vector_background(tmp_path):
    """A vector grid may have a background of three numbers; a voxel that equals it is inactive."""
    values = np.float32([[1, 2, 3], [1, 2, 4], [3, 2, 1]]).reshape(3, 1, 1, 3)
    grid = Grid("vel", values, voxel_size=1.0, background=(1.0, 2.0, 3.0))
    write_vdb(tmp_path / "a.vdb", [grid])
    assert_round_trip(grid, np.array([False, True, True]).reshape(3, 1, 1), read_vdb(tmp_path / "a.vdb")["vel"])


def test_half_clamps(tmp_path):
    """Half floats round to nearest even; what is beyond their range becomes the largest one, not infinite."""
    values = np.float32([1 + 2**-11, 1 + 3 * 2**-11, 65519.0, 65520.0, 3e38, -3e38, 6e-8, 1e-9]).reshape(2, 2, 2)
    expected = np.float32([1.0, 1 + 2**-9, 65504, 65504, 65504, -65504, 2**-24, 0.0]).reshape(2, 2, 2)
    write_vdb(tmp_path / "a.vdb", [Grid("density", values, voxel_size=1.0)])
    np.testing.assert_array_equal(read_vdb(tmp_path / "a.vdb")["density"].values, expected)


def test_views(tmp_path):
    """Arrays that are not contiguous give the same file as their copies."""
    values = ball((24, 16, 20))[::2, :, 3:].transpose(2, 1, 0)
    active = (values > 0.3)[:, ::-1][:, ::-1]
    for name, array, mask in (("view", values, active), ("copy", values.copy(), active.copy())):
        write_vdb(tmp_path / name, [Grid("density", array, voxel_size=1.0, active=mask)])
    assert (tmp_path / "view").read_bytes() == (tmp_path / "copy").read_bytes()


def test_reproducible(tmp_path):
    """Equal grids give equal bytes with any number of threads; a different value gives a different UUID."""
    values = ball((100, 60, 70), radius=45.0)
    for threads in (1, 2, 5):
        write_vdb(tmp_path / f"{threads}", [Grid("density", values, voxel_size=0.1)], threads=threads)
    one = (tmp_path / "1").read_bytes()
    assert one == (tmp_path / "2").read_bytes() == (tmp_path / "5").read_bytes()
    values[50, 30, 35] += 1
    write_vdb(tmp_path / "other", [Grid("density", values, voxel_size=0.1)])
    uuid = slice(21, 57)
    assert one[uuid] != (tmp_path / "other").read_bytes()[uuid]


def test_known_bytes(tmp_path):
    """The file of one voxel is, byte for byte, what the OpenVDB layout says."""

    def text(string):
        return struct.pack("<I", len(string)) + string.encode()

    def entry(name, kind, value):
        return text(name) + text(kind) + struct.pack("<I", len(value)) + value

    # Voxel (-1, 0, 4096) = slot 31·32² + 0 + 0 of the upper node at (-4096, 0, 4096), slot 15·16² of the lower node
    # and slot 7·8² of the leaf.
    write_vdb(
        tmp_path / "a.vdb",
        [Grid("d", np.float32([[[2.5]]]), (-1, 0, 4096), voxel_size=0.5, translation=(1, 2, 3), half=False)],
        compression="none",
    )
    metadata = struct.pack("<I", 7) + b"".join(
        (
            entry("class", "string", b"fog volume"),
            entry("file_bbox_max", "vec3i", struct.pack("<iii", -1, 0, 4096)),
            entry("file_bbox_min", "vec3i", struct.pack("<iii", -1, 0, 4096)),
            entry("file_compression", "string", b"active values"),
            entry("file_voxel_count", "int64", struct.pack("<q", 1)),
            entry("is_saved_as_half_float", "bool", b"\0"),
            entry("name", "string", b"d"),
        )
    )
    triples = [(1, 2, 3), (0.5,) * 3, (0.5,) * 3, (2,) * 3, (4,) * 3, (1,) * 3]
    transform = text("UniformScaleTranslateMap") + b"".join(struct.pack("<ddd", *triple) for triple in triples)
    leaf_mask = bytes(56) + b"\1" + bytes(7)
    topology = b"".join(
        (
            struct.pack("<ifII", 1, 0.0, 0, 1),
            struct.pack("<iii", -4096, 0, 4096),
            bytes(31 * 128) + b"\1" + bytes(127) + bytes(4096) + b"\0",
            bytes(15 * 32) + b"\1" + bytes(31) + bytes(512) + b"\0",
            leaf_mask,
        )
    )
    content = struct.pack("<I", 2) + metadata + transform + topology
    leaf = leaf_mask + b"\0" + struct.pack("<f", 2.5)
    descriptor = text("d") + text("Tree_float_5_4_3") + text("")
    start = 57 + 8 + len(descriptor) + 24
    offsets = struct.pack("<qqq", start, start + len(content), start + len(content) + len(leaf))
    written = (tmp_path / "a.vdb").read_bytes()
    assert written[:21] == struct.pack("<qIIIB", 0x56444220, 224, 10, 0, 1)
    assert written[57:] == struct.pack("<Ii", 0, 1) + descriptor + offsets + content + leaf


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("threshold", [0.0, 0.5])
def test_not_finite(tmp_path, bad, threshold):
    """NaN and infinity are refused with the grid's name and the index; nothing is written."""
    values = ball()
    values[20, 3, 7] = bad
    with pytest.raises(FieldError, match=r"grid 'heat': voxel \[25, 0, 9\] is -?(nan|inf); allowed: finite numbers"):
        write_vdb(tmp_path / "a.vdb", [Grid("heat", values, (5, -3, 2), voxel_size=1.0, threshold=threshold)])
    assert not list(tmp_path.iterdir())


def test_what_is_not_active_may_be_anything(tmp_path):
    """Voxels that a mask leaves out are not stored, whatever they hold."""
    values = ball()
    active = values > 0
    holes = np.where(active, values, np.nan).astype(np.float32)
    write_vdb(tmp_path / "holes.vdb", [Grid("heat", holes, voxel_size=1.0, active=active)])
    write_vdb(tmp_path / "zeros.vdb", [Grid("heat", values, voxel_size=1.0, active=active)])
    assert (tmp_path / "holes.vdb").read_bytes() == (tmp_path / "zeros.vdb").read_bytes()


def test_error_keeps_old_file(tmp_path):
    """An error on the way leaves the file that was there, and nothing else."""
    path = tmp_path / "a.vdb"
    good = Grid("density", ball(), voxel_size=1.0)
    write_vdb(path, [good])
    before = path.read_bytes()
    with pytest.raises(FieldError):
        write_vdb(path, [good, Grid("bad", np.full((3, 3, 3), np.nan, np.float32), voxel_size=1.0)])
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_name_taken_by_folder(tmp_path):
    """An error at the last moment, when the file gets its name, leaves nothing behind."""
    path = tmp_path / "a.vdb"
    path.mkdir()
    with pytest.raises(IsADirectoryError):
        write_vdb(path, [Grid("density", ball(), voxel_size=1.0)])
    assert list(tmp_path.iterdir()) == [path]


def test_no_folder(tmp_path):
    """A folder that does not exist is an OSError."""
    with pytest.raises(FileNotFoundError):
        write_vdb(tmp_path / "none" / "a.vdb", [Grid("density", ball(), voxel_size=1.0)])


ONE = np.ones((2, 2, 2), np.float32)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"name": ""}, "name"),
        ({"name": "a\x1eb"}, "name"),
        ({"values": ONE.astype(np.float64)}, "values is float64"),
        ({"values": ONE[0]}, "shape of values"),
        ({"values": np.ones((2, 2, 2, 2), np.float32)}, "shape of values"),
        ({"origin": (0, 0)}, "origin"),
        ({"origin": (0, 0, 0.5)}, "origin"),
        ({"origin": (2**31 - 1, 0, 0)}, "origin"),
        ({"voxel_size": 0.0}, "voxel_size"),
        ({"voxel_size": (1.0, 1.0, -1.0)}, "voxel_size"),
        ({"voxel_size": np.nan}, "voxel_size"),
        ({"translation": (0.0, np.inf, 0.0)}, "translation"),
        ({"background": np.nan}, "background"),
        ({"background": 1e39}, "background"),
        ({"background": (1.0, 2.0, 3.0)}, "background"),
        ({"threshold": -1.0}, "threshold"),
        ({"active": np.ones((2, 2, 3), bool)}, "active"),
        ({"active": ONE}, "active"),
        ({"grid_class": "level set"}, "grid_class"),
        ({"vector_type": "velocity"}, "vector_type"),
    ],
)
def test_bad_fields(fields, message):
    """Every field that is not allowed is named in the error."""
    with pytest.raises(FieldError, match=f"^grid .*: {message}"):
        Grid(**{"name": "density", "values": ONE, "voxel_size": 1.0} | fields)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"compression": "blosc"}, "compression is blosc; allowed: zip, none"), ({"threads": 0}, "threads is 0")],
)
def test_bad_arguments(tmp_path, arguments, message):
    """Compression and threads are checked."""
    with pytest.raises(FieldError, match=message):
        write_vdb(tmp_path / "a.vdb", [], **arguments)


def test_same_names(tmp_path):
    """Two grids of one name are refused."""
    grid = Grid("density", ONE, voxel_size=1.0)
    with pytest.raises(FieldError, match="different name"):
        write_vdb(tmp_path / "a.vdb", [grid, grid])
