import numpy as np
import pytest
from pxr import Usd, UsdGeom
from results import SET, write_all
from scipy.ndimage import binary_dilation

import warp_smoke as ws
from warp_smoke.lattice import place_lattice
from warp_smoke.record import FieldError
from warp_smoke.usd.volume import VELOCITY_MARGIN, VolumeResult, write_volume
from warp_smoke.vdb import read_vdb

VOLUME_DOMAIN = SET.replace('def Cube "Box"', 'def Volume "Box"').replace("        double size = 100\n", "")


@pytest.fixture(params=["turned", "mirrored", "volume", "moving", "moving volume"])
def placed(request, tmp_path):
    """Results for domains that are turned, mirrored, Volumes themselves, or under a parent that moves."""
    text = VOLUME_DOMAIN if "volume" in request.param else SET
    if request.param == "mirrored":
        text = text.replace("(1, 0.5, 0.75)", "(1, -0.5, 0.75)")
    if "moving" in request.param:
        still = "double3 xformOp:translate = (10, -20, 30)"
        text = text.replace(still, "double3 xformOp:translate.timeSamples = { 5: (10, -20, 30), 7: (90, 0, 0) }")
    source = tmp_path / "user.usda"
    source.write_text(text)
    return write_all(source, tmp_path / "out")


def the_volume(stage: Usd.Stage) -> Usd.Prim:
    """The one Volume with fields."""
    (volume,) = (prim for prim in stage.Traverse() if prim.GetPropertiesInNamespace("field"))
    return volume


def test_voxels_lie_where_the_cells_are(placed):
    """The grid's transform and then the prim's take every voxel to the centre of its cell, at every frame."""
    stage = Usd.Stage.Open(str(placed.root))
    volume = the_volume(stage)
    lattice = placed.lattice
    voxels = np.stack(np.meshgrid(*map(np.arange, lattice.shape), indexing="ij"), axis=-1).reshape(-1, 3)
    centres = lattice.cells_to_world()
    expected = (voxels + 0.5) @ centres[:3, :3] + centres[3, :3]
    for frame in placed.scene.frames:
        to_world = np.array(UsdGeom.XformCache(frame).GetLocalToWorldTransform(volume))
        path = stage.GetAttributeAtPath(f"{volume.GetPath()}/density.filePath").Get(frame).resolvedPath
        for grid in read_vdb(path).values():
            local = grid.translation + np.asarray(grid.voxel_size) * voxels
            world = local @ to_world[:3, :3] + to_world[3, :3]
            assert np.abs(world - expected).max() < 1e-6 * np.abs(expected).max(), grid.name


def test_the_extent_holds_the_smoke(placed):
    """The volume's bound in the world is the lattice's, and the box that marks a domain no longer counts."""
    stage = Usd.Stage.Open(str(placed.root))
    corners = np.stack(np.meshgrid(*((0, n) for n in placed.lattice.shape)), axis=-1).reshape(-1, 3)
    to_world = placed.lattice.cells_to_world()
    corners = corners @ to_world[:3, :3] + to_world[3, :3]
    bounds = UsdGeom.BBoxCache(5, ["default"]).ComputeWorldBound(the_volume(stage)).ComputeAlignedRange()
    assert np.allclose(bounds.GetMin(), corners.min(axis=0), atol=1e-3)  # extents are in single precision
    assert np.allclose(bounds.GetMax(), corners.max(axis=0), atol=1e-3)


def test_the_smoke_stands_beside_its_domain(results):
    """A box that marks a domain is not drawn; the smoke is a prim next to it."""
    stage = Usd.Stage.Open(str(results.root))
    assert the_volume(stage).GetPath() == "/World/Box_smoke"
    assert UsdGeom.Imageable(stage.GetPrimAtPath("/World/Box")).ComputePurpose() == "guide"


def test_a_volume_is_its_own_smoke(tmp_path):
    """A domain that is a Volume gets the fields itself, and stays visible."""
    source = tmp_path / "user.usda"
    source.write_text(VOLUME_DOMAIN)
    stage = Usd.Stage.Open(str(write_all(source, tmp_path / "out").root))
    assert the_volume(stage).GetPath() == "/World/Box"
    assert UsdGeom.Imageable(stage.GetPrimAtPath("/World/Box")).ComputePurpose() == "default"


def test_a_name_that_is_taken_is_left_alone(tmp_path):
    """Another prim called Box_smoke stays as it is."""
    source = tmp_path / "user.usda"
    source.write_text(
        SET.replace('    def Mesh "Floor"', '    def Xform "Box_smoke"\n    {\n    }\n\n    def Mesh "Floor"')
    )
    stage = Usd.Stage.Open(str(write_all(source, tmp_path / "out").root))
    assert stage.GetPrimAtPath("/World/Box_smoke").GetTypeName() == "Xform"
    assert the_volume(stage).GetPath() == "/World/Box_smoke_2"


def test_each_field_names_its_grid_and_files(results):
    """Names, types and roles that DCCs know; a file for each whole frame; the last one for readers without time."""
    stage = Usd.Stage.Open(str(results.root))
    volume = the_volume(stage)
    for name, data_type, role in (
        ("density", "half", "None"),
        ("temperature", "half", "None"),
        ("vel", "half3", "Vector"),
    ):
        assert volume.GetRelationship(f"field:{name}").GetTargets() == [f"{volume.GetPath()}/{name}"]
        field = stage.GetPrimAtPath(f"{volume.GetPath()}/{name}")
        assert field.GetTypeName() == "OpenVDBAsset"
        assert field.GetAttribute("fieldName").Get() == name
        assert field.GetAttribute("fieldDataType").Get() == data_type
        assert field.GetAttribute("vectorDataRoleHint").Get() == role
        files = field.GetAttribute("filePath")
        assert [files.Get(frame).path for frame in (5, 6, 7)] == [f"./volumes/Box.000{n}.vdb" for n in (5, 6, 7)]
        assert files.GetTimeSamples() == [5, 6, 7]
        assert files.Get().path == "./volumes/Box.0007.vdb"


def test_the_files_hold_what_was_simulated(results):
    """Values come back within half precision, velocities as centimetres for each second along the lattice."""
    half = 2.0**-11
    for frame, (density, temperature, velocity) in results.fields.items():
        grids = read_vdb(results.root.parent / f"volumes/Box.{frame:04d}.vdb")
        for name, expected in (("density", density), ("temperature", temperature), ("vel", 100 * velocity)):
            # Left out at most: smoke that dims a cell of 0.25 m by 1e-6, and 0.001 of the highest temperature.
            assert np.allclose(dense(grids[name], expected.shape[:3]), expected, rtol=half, atol=1e-3), name


def dense(grid, shape) -> np.ndarray:
    """A grid's values over the whole lattice of a shape, [nx, ny, nz, ...]."""
    whole = np.full((*shape, *grid.values.shape[3:]), grid.background, np.float32)
    box = tuple(slice(first, first + size) for first, size in zip(grid.origin, grid.shape, strict=True))
    whole[box] = grid.values
    return whole


@pytest.fixture
def domain():
    """A metre-wide domain of 16³ cells."""
    return ws.SmokeDomain(
        path="/World/Smoke", lower=(0, 0, 0), upper=(1, 1, 1), resolution=16, density_scale=3.0, time_scale=2.0
    )


def written(path, domain, density=None, temperature=None, velocity=None) -> dict:
    """The grids of a file by name."""
    lattice = place_lattice(ws.Scene(domains=[domain]), domain)
    size = write_volume(path, domain, lattice, density, temperature, velocity)
    assert size == path.stat().st_size
    return read_vdb(path)


def test_only_smoke_that_shows_is_kept(tmp_path, domain):
    """Density too thin to dim light is left out, velocity is kept a little around the rest, and both are scaled."""
    shape = (16, 16, 16)
    density, velocity = np.full(shape, 1e-9, np.float32), np.full((*shape, 3), 0.5, np.float32)
    density[8, 8, 8] = 0.25
    grids = written(tmp_path / "a.vdb", domain, density=density, velocity=velocity)
    expected = np.zeros(shape, np.float32)
    expected[8, 8, 8] = 0.75  # density_scale 3
    assert np.array_equal(dense(grids["density"], shape), expected)
    expected = np.zeros((*shape, 3), np.float32)
    around = slice(8 - VELOCITY_MARGIN, 9 + VELOCITY_MARGIN)
    # time_scale 2: a second of the stage is two of the smoke. A stage unit is 1 m.
    expected[around, around, around] = 1.0
    assert np.array_equal(dense(grids["vel"], shape), expected)


@pytest.mark.parametrize("seed", range(6))
def test_scattered_smoke_is_kept_whole(tmp_path, seed):
    """Of a few cells anywhere, at the sides too, each comes back at its place with the velocity around it."""
    rng = np.random.default_rng(seed)
    box = ws.SmokeDomain(path="/World/Smoke", lower=(0, 0, 0), upper=(2.3, 1.9, 0.9), resolution=23)
    shape = place_lattice(ws.Scene(domains=[box]), box).shape
    density, temperature = (np.zeros(shape, np.float32) for _ in range(2))
    density.flat[rng.choice(density.size, seed + 1)] = 0.5
    temperature.flat[rng.choice(density.size, seed + 1)] = rng.choice([-8.0, 8.0], seed + 1)
    velocity = rng.normal(size=(*shape, 3)).astype(np.float16).astype(np.float32)
    grids = written(tmp_path / "a.vdb", box, density, temperature, velocity)
    assert np.array_equal(dense(grids["density"], shape), density)
    assert np.array_equal(dense(grids["temperature"], shape), temperature)
    near = binary_dilation(density > 0, np.ones((2 * VELOCITY_MARGIN + 1,) * 3))
    assert np.array_equal(dense(grids["vel"], shape), np.where(near[..., None], velocity, 0))


@pytest.mark.parametrize("field", ["density", "temperature", "velocity"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_refused(tmp_path, domain, field, bad):
    """A value that is not finite is an error that names its grid and voxel, and no file is left."""
    fields = {field: np.zeros((16, 16, 16, 3) if field == "velocity" else (16, 16, 16), np.float32)}
    fields[field][3, 9, 12] = bad
    with pytest.raises(FieldError, match=r"voxel \[3, 9, 12\] is (nan|inf); allowed: finite numbers"):
        written(tmp_path / "a.vdb", domain, **fields)
    assert not any(tmp_path.iterdir())


def test_air_at_rest_has_the_ambient_temperature(tmp_path, domain):
    """Temperature is kept where it differs from the air's, which is the grid's background."""
    shape = (16, 16, 16)
    air = ws.SmokeDomain(path="/World/Smoke", lower=(0, 0, 0), upper=(1, 1, 1), resolution=16, ambient_temperature=20.0)
    temperature = np.full(shape, 20.0, np.float32)
    temperature[3, 4, 5], temperature[6, 4, 5] = 320.0, 20.1
    (grid,) = written(tmp_path / "a.vdb", air, temperature=temperature).values()
    assert grid.background == 20.0
    expected = np.full(shape, 20.0, np.float32)
    expected[3, 4, 5] = 320.0
    assert np.array_equal(dense(grid, shape), expected)


def test_no_smoke_is_an_empty_file(tmp_path, domain):
    """A frame before the first emission is a valid file with all its grids."""
    nothing = np.zeros((16, 16, 16), np.float32)
    grids = written(tmp_path / "a.vdb", domain, nothing, nothing, np.zeros((16, 16, 16, 3), np.float32))
    assert list(grids) == ["density", "temperature", "vel"]


@pytest.mark.parametrize("frames", [(), (1, 2, 4), (1.5, 2.5)])
def test_frames_have_no_gaps(domain, frames):
    """A gap, a time between frames or no frame at all is refused: DCCs number the files through."""
    lattice = place_lattice(ws.Scene(domains=[domain]), domain)
    with pytest.raises(FieldError, match="/World/Smoke: files"):
        VolumeResult(domain=domain, lattice=lattice, grids=("density",), files=dict.fromkeys(frames, "./a.vdb"))
