"""Files checked with the OpenVDB library itself, by its Python module of the system's interpreter."""

import json
import subprocess

import numpy as np
import pytest

from warp_smoke.vdb import Grid, read_vdb, write_vdb

PYTHON = "/usr/bin/python3"

# Reads a file; gives for each grid what OpenVDB says of it and, in a .npy file, its values over `box`.
READ = """
import json, sys
import numpy as np, pyopenvdb
path, low, high = sys.argv[1], json.loads(sys.argv[2]), json.loads(sys.argv[3])
grids, _ = pyopenvdb.readAll(path)
out = {}
for grid in grids:
    vector = isinstance(grid, pyopenvdb.Vec3SGrid)
    shape = [b - a + 1 for a, b in zip(low, high)]
    values = np.empty(shape + [3] if vector else shape, np.float32)
    grid.copyToArray(values, low)
    np.save(f"{path}.{grid.name}.values.npy", values)
    active = np.zeros(shape, bool)
    for item in grid.citerOnValues():
        box = tuple(slice(a - o, b - o + 1) for a, b, o in zip(item.min, item.max, low))
        active[box] = True
    np.save(f"{path}.{grid.name}.active.npy", active)
    transform = grid.transform
    out[grid.name] = dict(
        kind=type(grid).__name__, grid_class=grid.gridClass, half=grid.saveFloatAsHalf,
        vector_type=grid.vectorType, voxels=grid.activeVoxelCount(), leaves=grid.leafCount(), empty=grid.empty(),
        background=np.ravel(grid.background).tolist(), box=grid.evalActiveVoxelBoundingBox(), map=transform.typeName,
        voxel_size=transform.voxelSize(), corner=transform.indexToWorld((0, 0, 0)),
        other=transform.indexToWorld((3, -5, 8)),
        metadata={key: list(value) if isinstance(value, tuple) else value for key, value in grid.metadata.items()},
    )
print(json.dumps(out))
"""

WRITE = """
import sys
import numpy as np, pyopenvdb
grid = pyopenvdb.FloatGrid()
grid.name = "density"
grid.copyFromArray(np.ones((20, 20, 20), np.float32))
pyopenvdb.write(sys.argv[1], [grid])
"""


def run(program: str, *arguments) -> str:
    """Output of a program of the system's interpreter."""
    done = subprocess.run([PYTHON, "-c", program, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def has_openvdb() -> bool:
    """Whether that interpreter has OpenVDB's module."""
    try:
        return subprocess.run([PYTHON, "-c", "import pyopenvdb"], capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


pytestmark = pytest.mark.skipif(not has_openvdb(), reason=f"{PYTHON} has no pyopenvdb")


def assert_same_in_openvdb(path, grids: list[Grid], actives: list[np.ndarray], compression: str) -> None:
    """OpenVDB finds exactly the values, active voxels, places and metadata of the grids."""
    low = np.min([grid.origin for grid in grids], axis=0) - 9
    high = np.max([np.add(grid.origin, grid.shape) for grid in grids], axis=0) + 9
    found = json.loads(run(READ, path, low.tolist(), high.tolist()))
    assert set(found) == {grid.name for grid in grids}
    for grid, inside in zip(grids, actives, strict=True):
        item = found[grid.name]
        number_type = np.float16 if grid.half else np.float32
        active = np.zeros(high - low + 1, bool)
        box = tuple(slice(o, o + n) for o, n in zip(grid.origin - low, grid.shape, strict=True))
        active[box] = inside
        background = np.asarray(grid.background, number_type).astype(np.float32)
        expected = np.empty(active.shape + grid.values.shape[3:], np.float32)
        expected[...] = background
        expected[active] = grid.values[inside].astype(number_type)
        values = np.load(f"{path}.{grid.name}.values.npy")
        np.testing.assert_array_equal(values.view(np.uint32), expected.view(np.uint32))
        np.testing.assert_array_equal(np.load(f"{path}.{grid.name}.active.npy"), active)
        where = np.argwhere(active) + low
        box = [[2**31 - 1] * 3, [-(2**31)] * 3]
        if len(where):
            box = [where.min(axis=0).tolist(), where.max(axis=0).tolist()]
        assert item["voxels"] == len(where)
        assert item["leaves"] == len(np.unique(where // 8, axis=0))
        assert item["box"] == box
        assert item["background"] == background.ravel().tolist()
        assert item["kind"] == ("Vec3SGrid" if grid.is_vector else "FloatGrid")
        assert item["half"] == grid.half
        assert item["grid_class"] == grid.grid_class
        assert item["vector_type"] == grid.vector_type
        cube = len(set(grid.voxel_size)) == 1
        assert item["map"] == ("UniformScaleTranslateMap" if cube else "ScaleTranslateMap")
        assert item["voxel_size"] == list(grid.voxel_size)
        assert item["corner"] == list(grid.translation)
        # Dyadic numbers: exact in any order of operations.
        assert item["other"] == (np.array(grid.translation) + np.array([3, -5, 8]) * grid.voxel_size).tolist()
        metadata = {
            "class": grid.grid_class,
            "file_bbox_max": box[1],
            "file_bbox_min": box[0],
            "file_compression": "zip + active values" if compression == "zip" else "active values",
            "file_voxel_count": len(where),
            "is_saved_as_half_float": grid.half,
            "name": grid.name,
        }
        assert item["metadata"] == metadata | ({"vector_type": grid.vector_type} if grid.is_vector else {})


def smoke(shape, seed):
    """A smooth plume-like field with values over several octaves, zero in about half of the box."""
    rng = np.random.default_rng(seed)
    x, y, z = (np.linspace(-1, 1, n, dtype=np.float32) for n in shape)
    radius = np.sqrt(x[:, None, None] ** 2 + y[None, :, None] ** 2 + 0.4 * z**2)
    field = np.exp(-6 * radius**2) * (1 + 0.05 * rng.standard_normal(shape))
    return np.where(radius < 0.8, field, 0).astype(np.float32)


@pytest.mark.parametrize("compression", ["zip", "none"])
@pytest.mark.parametrize("half", [True, False])
def test_smoke(tmp_path, half, compression):
    """OpenVDB reads density, temperature and velocity of one file bit for bit, with their places and metadata."""
    shape = (25, 18, 29)
    density, heat = smoke(shape, 1), smoke(shape, 2)
    velocity = np.stack([heat, -density, 3 * density - heat], axis=-1)
    place = {"voxel_size": 0.125, "translation": (1.5, -2.25, 0.0625), "half": half}
    grids = [
        Grid("density", density, (-7, 0, 4090), **place),
        Grid("temperature", 300 + 50 * heat, (-7, 0, 4090), background=300.0, threshold=0.5, **place),
        Grid("vel", velocity, (-7, 0, 4090), active=density != 0, grid_class="staggered",
             vector_type="contravariant relative", **place),
    ]  # fmt: skip
    active = density != 0
    hot = np.abs(grids[1].values - 300) > 0.5
    write_vdb(tmp_path / "smoke.vdb", grids, compression=compression, threads=2)
    assert_same_in_openvdb(tmp_path / "smoke.vdb", grids, [active, hot, active], compression)


@pytest.mark.parametrize("compression", ["zip", "none"])
@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize("vector", [False, True])
def test_sparse(tmp_path, vector, half, compression):
    """OpenVDB reads empty, one-voxel, full and constant grids at odd places, scalar and vector, bit for bit."""
    rng = np.random.default_rng(3)
    tail = (3,) if vector else ()
    kind = {"half": half, "voxel_size": (0.5, 0.25, 2.0)}
    grids = [
        Grid("nothing", np.zeros((5, 6, 7, *tail), np.float32), **kind),
        Grid("one", np.full((1, 1, 1, *tail), -1.5, np.float32), (-1, -9, 17), **kind),
        Grid("full", rng.standard_normal((17, 9, 8, *tail)).astype(np.float32), (-3, -8, 5), **kind),
        Grid("constant", np.full((16, 24, 9, *tail), 0.1, np.float32), (8, -16, 3), background=0.3, **kind),
    ]
    actives = [np.zeros((5, 6, 7), bool)] + [np.ones(grid.shape, bool) for grid in grids[1:]]
    write_vdb(tmp_path / "smoke.vdb", grids, compression=compression)
    assert_same_in_openvdb(tmp_path / "smoke.vdb", grids, actives, compression)


def test_own_file_of_openvdb_is_refused(tmp_path):
    """OpenVDB's own files are compressed with blosc by default; the error names file, grid and compression."""
    path = tmp_path / "blosc.vdb"
    run(WRITE, path)
    with pytest.raises(ValueError, match=r"blosc.vdb: grid 'density': compression is blosc; allowed: zip, none"):
        read_vdb(path)
