import numpy as np
import pytest

from warp_smoke.vdb import Grid, read_grid_bounds, read_grid_names, read_vdb, write_vdb


@pytest.fixture
def path(tmp_path):
    """A file with two grids."""
    values = np.random.default_rng(0).random((9, 9, 9), np.float32)
    path = tmp_path / "a.vdb"
    write_vdb(path, [Grid("smoke", values, voxel_size=1.0), Grid("vel", np.stack([values] * 3, -1), voxel_size=1.0)])
    return path


def test_names_come_in_the_order_of_the_file(path):
    """The names are those of the grids that a full reading finds."""
    assert read_grid_names(path) == ("smoke", "vel") == tuple(read_vdb(path))


def test_grids_that_cannot_be_read_have_names(path):
    """A type of grid that `read_vdb` refuses does not hide the names."""
    path.write_bytes(path.read_bytes().replace(b"Tree_float_5_4_3", b"Tree_int32_5_4_3"))
    with pytest.raises(ValueError, match="Tree_int32"):
        read_vdb(path)
    assert read_grid_names(path) == ("smoke", "vel")


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.999])
def test_a_file_that_is_cut_off_is_refused(path, share):
    """Wherever the file ends too early, even in its last grid."""
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(ValueError, match=r"a\.vdb: "):
        read_grid_names(path)


def test_bounds_hold_the_active_voxels(tmp_path):
    """Corners of the box of active voxels, by scale and translation; None for a grid without any."""
    values = np.zeros((20, 9, 9), np.float32)
    values[12, 3, 5] = values[15, 1, 8] = 1.0
    place = {"voxel_size": 0.5, "translation": (10.0, 0.0, -1.0)}
    path = tmp_path / "b.vdb"
    write_vdb(path, [Grid("smoke", values, (-2, 0, 4), **place), Grid("none", 0 * values, **place)])
    bounds = read_grid_bounds(path)
    expected = [[10 + 0.5 * 9.5, 0.5 * 0.5, -1 + 0.5 * 8.5], [10 + 0.5 * 13.5, 0.5 * 3.5, -1 + 0.5 * 12.5]]
    np.testing.assert_allclose(bounds["smoke"], expected)
    assert bounds["none"] is None


def test_bounds_are_unknown_where_a_grid_is_turned(path):
    """A map of another kind is no error, as other programs write them."""
    path.write_bytes(path.read_bytes().replace(b"UniformScaleTranslateMap", b"UnitaryTurnedAroundItMap"))
    assert read_grid_bounds(path) == {"smoke": None, "vel": None}
