"""Surfaces between cells: faces they cross, sides kept apart, fills, speeds, and cells that they pass over."""

import numpy as np
import pytest
import scipy.sparse
import scipy.spatial
from hypothesis import given, settings
from hypothesis import strategies as st
from real_meshes import asset
from shapes import shell
from staggered import CLOSED, OPEN, lattice_of

from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.voxelize import MeshVoxels
from warp_smoke.fluid.walls import MeshWalls
from warp_smoke.geometry import Mesh
from warp_smoke.launch import Launcher
from warp_smoke.record import Samples
from warp_smoke.scene import Collider


def placed(*offset, turn=None):
    """A matrix that turns, then moves."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) if turn is None else turn
    matrix[3, :3] = offset
    return matrix


def moving(start, end):
    """A transform that goes from one matrix to another between times 0 and 1."""
    return Samples(np.array([0.0, 1.0]), np.stack([start, end]))


def rotation(seed):
    """Any rotation."""
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def walls_of(launcher, lattice, mesh, transform=None, start=0.0, end=0.0, seconds=0.0):
    """The walls of a mesh at a time."""
    walls = MeshWalls(launcher, lattice, Collider(path="/mesh", mesh=mesh, transform=transform or np.eye(4)))
    walls.update(start, end, seconds)
    return walls


def solids_of(launcher, lattice, mesh, transform=None, start=0.0, end=0.0, seconds=0.0):
    """A mesh as the only collider at a time."""
    transform = np.eye(4) if transform is None else transform
    solids = Solids(launcher, lattice, [Collider(path="/mesh", mesh=mesh, transform=transform)])
    solids.update(start, end, seconds)
    return solids


def bodies(solids):
    """The number of the body of fluid that each cell belongs to, from a graph of all cells."""
    shape = solids.fluid.shape
    cells = np.arange(np.prod(shape)).reshape(shape)
    a, b = [], []
    for axis, share in enumerate((solids.wx, solids.wy, solids.wz)):
        opened = np.moveaxis(share.numpy(), axis, 0)[1:-1] > 0
        index = np.moveaxis(cells, axis, 0)
        a.append(index[:-1][opened])
        b.append(index[1:][opened])
    a, b = np.concatenate(a), np.concatenate(b)
    graph = scipy.sparse.coo_array((np.ones(len(a)), (a, b)), shape=(cells.size, cells.size))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1].reshape(shape)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(("place", "faces"), [(5.3, [5]), (5.7, [6]), (5.0, [5]), (0.2, [0]), (7.8, [8]), (-0.4, [0])])
def test_sheet_between_centres_closes_the_faces_it_crosses(launcher, axis, place, faces):
    """A sheet from 2 to 5 across an axis closes the faces between the centres on either side, and no others."""
    corner = np.full(3, 2.0)
    corner[axis] = place
    u, v = np.eye(3)[(axis + 1) % 3] * 3, np.eye(3)[(axis + 2) % 3] * 3
    solids = solids_of(launcher, lattice_of((8, 8, 8)), Mesh.grid(corner, u, v))
    assert np.all(solids.fluid.numpy() == 1.0)
    for other, share in enumerate((solids.wx, solids.wy, solids.wz)):
        expected = np.ones(share.shape)
        if other == axis:
            across = [slice(2, 5)] * 3
            across[axis] = faces
            expected[tuple(across)] = 0.0
        np.testing.assert_array_equal(share.numpy(), expected)


def test_sheet_through_centres_fills_their_cells(launcher):
    """Cells are solid where a sheet passes through their centres: round-off cannot say on which side they are."""
    sheet = Mesh.grid((5.5, 2, 2), (0, 3, 0), (0, 0, 3))
    solids = solids_of(launcher, lattice_of((8, 8, 8)), sheet)
    expected = np.ones((8, 8, 8))
    expected[5, 2:5, 2:5] = 0.0
    np.testing.assert_array_equal(solids.fluid.numpy(), expected)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.01, 0.9), st.tuples(*[st.floats(-0.5, 0.5)] * 3))
def test_closed_shell_keeps_its_sides_apart(seed, thickness, offset):
    """No way through open faces leads from inside a hollow sphere to outside, however thin it is and where it lies."""
    transform = placed(*(np.array(offset) + 7), turn=rotation(seed))
    solids = solids_of(Launcher("cpu", 1), lattice_of((14, 14, 14)), shell(5.0, thickness), transform)
    body = bodies(solids)
    distance = np.linalg.norm(np.indices((14, 14, 14)).T + 0.5 - 7 - np.array(offset), axis=3).T
    free = solids.fluid.numpy() > 0
    inside, outside = body[free & (distance < 4.0)], body[free & (distance > 5.1)]
    assert len(np.unique(inside)) == len(np.unique(outside)) == 1
    assert inside[0] != outside[0]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_convex_mesh_against_its_planes(seed):
    """Cells are filled, and faces between them crossed, as the planes of a convex body say."""
    points = np.random.default_rng(seed).uniform(0.5, 9.5, (8, 3))
    hull = scipy.spatial.ConvexHull(points)
    triangles = hull.simplices.copy()
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    turned = np.sum(normals * hull.equations[:, :3], axis=1) < 0
    triangles[turned] = triangles[turned, ::-1]
    solids = solids_of(Launcher("cpu", 1), lattice_of((10, 10, 10)), Mesh(points, triangles))
    centres = np.indices((10, 10, 10)).reshape(3, -1).T + 0.5
    depth = (centres @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1).reshape(10, 10, 10)
    sure = np.abs(depth) > 2e-3
    fluid = solids.fluid.numpy()
    np.testing.assert_array_equal(fluid[sure], (depth[sure] > 0).astype(np.float32))


@pytest.mark.parametrize("name", ["bunny", "bear", "rocks"])
def test_fill_of_real_meshes(launcher, name):
    """Following rows fills the same cells as asking for the sign in each, but for centres within 0.001 cells."""
    mesh = asset(name)
    lattice = lattice_of((30, 30, 30), voxel_size=2 / 30, to_world=placed(-1, -1, -1))
    walls = walls_of(launcher, lattice, mesh)
    # With a tiny triangle more the mesh counts as not closed, so that each cell is asked.
    tiny = mesh.points[0] + 1e-4 * np.eye(3)
    split = Mesh(
        np.concatenate([mesh.points, tiny]), np.concatenate([mesh.triangles, [len(mesh.points) + np.arange(3)]])
    )
    voxels = MeshVoxels(launcher, lattice, Collider(path="/m", mesh=split), "test")
    voxels.update(0.0, 0.0, 0.0)
    assert (walls.lower, walls.shape) == (voxels.lower, voxels.shape)
    fraction = voxels.fraction.numpy()
    sure = np.abs(fraction - 0.5) > 2e-3
    np.testing.assert_array_equal(walls.fraction.numpy()[sure], np.round(fraction[sure]))
    inside = walls.fraction.numpy()
    for axis, crossed in enumerate(walls.crossed):
        cells, known = np.moveaxis(inside, axis, 0), np.moveaxis(sure, axis, 0)
        changes = (cells[1:] != cells[:-1]) & known[1:] & known[:-1]
        assert np.all(np.moveaxis(crossed.numpy(), axis, 0)[1:-1][changes] == 1.0)


def test_mesh_cut_off_by_the_lattice(launcher):
    """Rows that start inside a mesh, since the lattice ends there, are filled from their first cell on."""
    solids = solids_of(launcher, lattice_of((8, 8, 8)), Mesh.box((6, 6, 20), lower=(1, 1, -10)))
    expected = np.ones((8, 8, 8))
    expected[1:7, 1:7] = 0.0
    np.testing.assert_array_equal(solids.fluid.numpy(), expected)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(-2, 8, width=32)] * 3), min_size=3, max_size=12),
    st.lists(st.tuples(*[st.integers(0, 2)] * 3), max_size=8),
    st.floats(0.0, 2.0),
)
def test_any_triangles_give_whole_shares_and_finite_speeds(points, triangles, thickness):
    """Any soup of triangles, moved by any way, leaves cells and faces 0 or 1 and speeds finite."""
    mesh = Mesh(np.array(points), np.array(triangles, int).reshape(-1, 3))
    transform = moving(np.eye(4), placed(1, -2, 3, turn=rotation(1)))
    collider = Collider(path="/mesh", mesh=mesh, transform=transform, thickness=thickness)
    solids = Solids(Launcher("cpu", 1), lattice_of((6, 6, 6)), [collider])
    for start, end in ((0.0, 0.0), (0.0, 0.5), (0.5, 1.0)):
        solids.update(start, end, 0.1)
        for array in (solids.fluid, solids.held, solids.wx, solids.wy, solids.wz):
            assert np.isin(array.numpy(), (0.0, 1.0)).all()
        assert all(np.isfinite(u.numpy()).all() for u in solids.velocity)


def test_thin_wall_has_the_speed_of_its_surface(launcher):
    """Faces crossed by a turning sheet move with ω × r there; all other faces have none."""
    angle, seconds = 0.02, 0.1
    turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    sheet = Mesh.grid((-4.0, 0.0, -3.0), (0, 0, 6), (8, 0, 0))
    transform = moving(placed(6, 5.3, 6), placed(6, 5.3, 6, turn=turn))
    solids = solids_of(launcher, lattice_of((12, 12, 12)), sheet, transform, 0.0, 1.0, seconds)
    v, closed = solids.velocity[1].numpy(), solids.wy.numpy() == 0
    x = np.indices(v.shape)[0] + 0.5 - 6
    # A step along the chord is shorter than the arc by ω² dt² / 24 of itself; off the axis it also moves inwards.
    np.testing.assert_allclose(v[closed], (angle / seconds * x)[closed], rtol=1e-3, atol=1e-5)
    assert closed.sum() == 8 * 6
    assert not v[~closed].any()


@pytest.mark.parametrize("velocity", [0.4, -1.0, 3.7])
def test_cells_that_a_sheet_passes_over_are_not_held(launcher, velocity):
    """Held are all cells but those whose centres lie between where a sheet was and where it is."""
    sheet = Mesh.grid((0.0, -20, -20), (0, 40, 0), (0, 0, 40))
    lattice = lattice_of((16, 4, 4))
    prim = Collider(path="/sheet", mesh=sheet, transform=moving(placed(8.2, 0, 0), placed(8.2 + velocity, 0, 0)))
    solids = Solids(launcher, lattice, [prim])
    solids.update(0.0, 0.0, 0.0)
    assert np.all(solids.held.numpy() == 1.0)
    solids.update(0.0, 1.0, 0.1)
    x, ends = np.arange(16) + 0.5, sorted((8.2, 8.2 + velocity))
    expected = np.where((x > ends[0]) & (x < ends[1]), 0.0, 1.0)
    np.testing.assert_array_equal(solids.held.numpy(), np.broadcast_to(expected[:, None, None], lattice.shape))
    solids.update(1.0, 2.0, 0.1)
    assert np.all(solids.held.numpy() == 1.0)


def test_cells_that_a_small_body_jumps_over_are_not_held(launcher):
    """A ball that is far from where it was holds no cell on its way, though none there is solid before or after."""
    lattice = lattice_of((24, 9, 9))
    transform = moving(placed(4.5, 4.5, 4.5), placed(19.5, 4.5, 4.5))
    prim = Collider(path="/ball", mesh=Mesh.sphere(2.0, 32), transform=transform)
    solids = Solids(launcher, lattice, [prim])
    solids.update(0.0, 0.0, 0.0)
    solids.update(0.0, 1.0, 0.1)
    held = solids.held.numpy()
    y, z = np.indices((9, 9)) - 4.0
    path = np.hypot(y, z) < 1.9
    assert not held[4:18, path].any()
    assert np.all(held[:, np.hypot(y, z) > 2.1] == 1.0)


@pytest.mark.parametrize("deforms", [False, True], ids=["rigid", "deforming"])
def test_deforming_and_rigid_motion_sweep_alike(launcher, deforms):
    """A sheet moved by its points sweeps the cells that it sweeps when moved by its transform."""
    sheet = Mesh.grid((3.1, -20, -20), (0, 40, 0), (0, 0, 40))
    if deforms:
        points = np.stack([sheet.points, sheet.points + np.array([2.0, 0, 0])])
        prim = Collider(path="/sheet", mesh=Mesh(Samples(np.array([0.0, 1.0]), points), sheet.triangles))
    else:
        prim = Collider(path="/sheet", mesh=sheet, transform=moving(np.eye(4), placed(2, 0, 0)))
    solids = Solids(launcher, lattice_of((8, 4, 4)), [prim])
    solids.update(0.0, 0.0, 0.0)
    solids.update(0.0, 1.0, 0.5)
    np.testing.assert_array_equal(solids.held.numpy()[:, 2, 2], [1, 1, 1, 0, 0, 1, 1, 1])
    np.testing.assert_allclose(solids.velocity[0].numpy()[:, 2, 2], [0, 0, 0, 0, 0, 4, 0, 0, 0], rtol=1e-5)


def test_max_speed(launcher):
    """The largest speed of a corner of the collider's box, in m/s; 0 where nothing moves."""
    lattice = lattice_of((8, 8, 8), voxel_size=0.5, meters_per_unit=0.01)
    prim = Collider(path="/box", mesh=Mesh.box(), transform=moving(np.eye(4), placed(3, 4, 0)))
    solids = Solids(launcher, lattice, [prim])
    assert solids.max_speed(0.0, 0.5, 0.1) == pytest.approx(2.5 * 0.01 / 0.1)
    assert solids.max_speed(2.0, 3.0, 0.1) == 0.0
    assert solids.max_speed(0.0, 0.0, 0.0) == 0.0


@pytest.mark.parametrize("sides", [CLOSED, OPEN], ids=["closed", "open"])
def test_sides_of_the_domain_stand_still(launcher, sides):
    """A sheet that moves along a closed side of the domain gives it no velocity."""
    sheet = Mesh.grid((0.1, -9, -9), (0, 18, 0), (0, 0, 18))
    transform = moving(np.eye(4), placed(0.1, 0, 0))
    solids = solids_of(launcher, lattice_of((6, 4, 4), sides), sheet, transform, 0.0, 1.0, 0.1)
    expected = 0.0 if sides == CLOSED else 1.0
    np.testing.assert_allclose(solids.velocity[0].numpy()[0], expected, rtol=1e-5)


@pytest.mark.usefixtures("divided_launches")
def test_same_bits_for_any_number_of_threads():
    """1, 2 and 7 threads give bit-equal walls, speeds and held cells."""
    results = []
    for threads in (1, 2, 7):
        transform = moving(placed(30, 30, 30), placed(33, 31, 29, turn=rotation(2)))
        lattice = lattice_of((60, 60, 60))
        solids = Solids(
            Launcher("cpu", threads), lattice, [Collider(path="/m", mesh=shell(24.0, 0.3), transform=transform)]
        )
        solids.update(0.0, 0.0, 0.0)
        solids.update(0.0, 0.2, 0.1)
        arrays = (solids.fluid, solids.held, solids.wx, solids.wy, solids.wz, *solids.velocity)
        results.append([array.numpy().copy() for array in arrays])
    for result in results[1:]:
        for one, other in zip(results[0], result, strict=True):
            np.testing.assert_array_equal(one.view(np.int32), other.view(np.int32))
