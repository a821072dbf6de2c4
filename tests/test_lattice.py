"""Where cells lie: sizes, turned, scaled and mirrored boxes, units, sides."""

import numpy as np
import pytest
from scenes import at

import warp_smoke as ws
from warp_smoke.geometry import transform_points
from warp_smoke.lattice import occupied_box, place_lattice
from warp_smoke.record import FieldError


def lattice(scene=None, **domain):
    """The lattice of one domain."""
    domain = ws.SmokeDomain(path="/Smoke", **domain)
    return place_lattice(scene or ws.Scene(domains=[domain]), domain)


def test_cube():
    """A cube of side 2 at resolution 8: cells of 0.25 from its lower corner."""
    cells = lattice(resolution=8)
    assert cells.shape == (8, 8, 8)
    assert cells.voxel_size == 0.25
    np.testing.assert_allclose(transform_points(cells.world_to_cells(), [[-1, -1, -1], [1, 1, 1]]), [[0] * 3, [8] * 3])
    assert cells.sides == ("open", "open", "closed", "open", "open", "open")
    assert cells.up == (0, 1, 0)


def test_sides_that_are_no_whole_number_of_cells():
    """Cells stay cubes; the lattice is centred in the box, but stands on its bottom."""
    cells = lattice(lower=(0, 0, 0), upper=(8, 1.3, 2.4), resolution=8)
    assert cells.shape == (8, 1, 2)
    corners = transform_points(cells.cells_to_world(), [[0, 0, 0], cells.shape])
    np.testing.assert_allclose(corners, [[0, 0, 0.2], [8, 1, 2.2]], atol=1e-12)


@pytest.mark.parametrize("thin", [(0.001, 1, 1), (1, 1, 0.001)])
def test_thin_boxes_keep_one_cell(thin):
    """An aspect of 1 to 1000 still has a cell along its thin axis."""
    cells = lattice(lower=(0, 0, 0), upper=thin, resolution=10)
    assert min(cells.shape) == 1


def test_mirrored_transform_gives_right_handed_axes():
    """A negative scale covers the same box with right-handed axes, and sides keep their place in the world."""
    boundary = ("open", "open", "closed", "open", "open", "closed")
    mirrored = lattice(transform=np.diag([1.0, 1.0, -1.0, 1.0]), boundary=boundary, resolution=4)
    assert np.linalg.det(mirrored.axes) == pytest.approx(1.0)
    corners = transform_points(mirrored.cells_to_world(), [[0, 0, 0], [4, 4, 4]])
    np.testing.assert_allclose(np.sort(corners, axis=0), [[-1] * 3, [1] * 3])
    # local +z is world -z; local +z is closed
    axis = mirrored.axes[2]
    side = 5 if axis[2] < 0 else 4
    assert mirrored.sides[side] == "closed"
    assert mirrored.sides.count("closed") == 2


def test_no_slip_sides_are_closed():
    """A side that is no_slip is closed for all but viscosity, and is turned with the axes."""
    boundary = ("open", "no_slip", "closed", "open", "no_slip", "open")
    plain = lattice(boundary=boundary, resolution=4)
    assert plain.sides == ("open", "closed", "closed", "open", "closed", "open")
    assert plain.no_slip == (False, True, False, False, True, False)
    mirrored = lattice(transform=np.diag([1.0, 1.0, -1.0, 1.0]), boundary=boundary, resolution=4)
    assert mirrored.no_slip == (False, True, False, False, False, True)


@pytest.mark.parametrize("units", [0.001, 0.01, 1.0, 1000.0])
def test_units(units):
    """The side of a cell in metres does not depend on the stage's unit."""
    domain = ws.SmokeDomain(path="/Smoke", transform=np.diag([1 / units] * 3 + [1.0]), resolution=16)
    cells = place_lattice(ws.Scene(domains=[domain], meters_per_unit=units), domain)
    assert cells.h == pytest.approx(2.0 / 16)


def test_up_axis_and_turned_boxes():
    """The bottom is the side that faces down, whichever local axis that is."""
    domain = ws.SmokeDomain(path="/Smoke")
    assert place_lattice(ws.Scene(domains=[domain], up_axis="Z"), domain).sides[4] == "closed"
    turned = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])  # local z looks down
    domain = ws.SmokeDomain(path="/Smoke", transform=turned)
    cells = place_lattice(ws.Scene(domains=[domain]), domain)
    assert cells.sides[5] == "closed"
    assert cells.up == (0, 0, -1)


def test_far_from_the_origin():
    """World to cell keeps float64 accuracy 1e6 units away."""
    cells = lattice(transform=at(1e6, -1e6, 1e6), resolution=64)
    middle = transform_points(cells.world_to_cells(), [[1e6 + 0.5, -1e6, 1e6]])
    np.testing.assert_allclose(middle, [[48, 32, 32]], atol=1e-7)


def test_shear_is_refused():
    """A sheared box has no cubic cells."""
    matrix = np.eye(4)
    matrix[0, 1] = 0.5
    with pytest.raises(FieldError, match=r"/Smoke: transform is .*right angles"):
        ws.SmokeDomain(path="/Smoke", transform=matrix)


def test_box_of_occupied_cells():
    """From the first to the last cell along each axis, wherever these are; none without any."""
    cells = np.zeros((4, 5, 6), bool)
    assert occupied_box(cells) is None
    cells[1, 2, 5] = True
    assert occupied_box(cells) == (slice(1, 2), slice(2, 3), slice(5, 6))
    cells[3, 0, 4] = True
    assert occupied_box(cells) == (slice(1, 4), slice(0, 3), slice(4, 6))
