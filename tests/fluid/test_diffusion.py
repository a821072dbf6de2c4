"""Diffusion: exact eigenmodes of all fields and sides, sweeps that reach the same, limits, conservation, colliders."""

from itertools import product

import numpy as np
import pytest
from staggered import CLOSED, MIXED, OPEN, PERIODIC, SLAB, lattice_of

from warp_smoke import Collider, Mesh
from warp_smoke.fluid.colliders import Solids
from warp_smoke.fluid.diffusion import DIFFUSION_SOLVERS, DiffusionProblem, diffusion_number
from warp_smoke.fluid.grid import face_shape

SHAPE = (6, 9, 7)
SLIP, STICK = (False,) * 6, (True,) * 6
FIELDS = (None, 0, 1, 2)
ENOUGH = 5000  # sweeps: more than any r of these tests takes


def make(launcher, name, sides=CLOSED, no_slip=SLIP, shape=SHAPE, fields=FIELDS, sweeps=ENOUGH, solids=None):
    """A solver by its name."""
    return DIFFUSION_SOLVERS[name](launcher, DiffusionProblem(shape, sides, no_slip, fields, sweeps, solids))


def laplacian(sides, no_slip, field, shape) -> np.ndarray:
    """The matrix of r = 1 over all samples of a field, row by row from the definition; 0 in rows of closed faces."""
    size = shape if field is None else face_shape(shape, field)
    matrix = np.zeros((np.prod(size),) * 2)
    number = np.arange(np.prod(size)).reshape(size)
    for place in np.ndindex(size):
        row = number[place]
        if field is not None:
            low, high = sides[2 * field : 2 * field + 2]
            closed = {0: low == "closed", shape[field]: high == "closed"}
            if closed.get(place[field]):
                continue
        for axis, step in product(range(3), (-1, 1)):
            neighbour = list(place)
            neighbour[axis] += step
            side = 2 * axis + (step > 0)
            if sides[side] == "periodic":
                neighbour[axis] %= shape[axis]
                matrix[row, number[tuple(neighbour)]] += 1.0
                matrix[row, row] -= 1.0
            elif 0 <= neighbour[axis] < size[axis]:
                matrix[row, number[tuple(neighbour)]] += 1.0
                matrix[row, row] -= 1.0
            elif field == axis:  # an open side: mirrored on its face
                neighbour[axis] -= 2 * step
                matrix[row, number[tuple(neighbour)]] += 1.0
                matrix[row, row] -= 1.0
            elif sides[side] == "open" if field is None else no_slip[side]:
                matrix[row, row] -= 2.0  # 0 half a cell away
    return matrix


def random_field(sides, field, shape=SHAPE) -> np.ndarray:
    """Random samples ≥ 0, with 0 on closed faces."""
    size = shape if field is None else face_shape(shape, field)
    a = np.random.default_rng(4).uniform(0.0, 1.0, size)
    if field is not None:
        faces = np.moveaxis(a, field, 0)
        for end, side in zip((0, -1), sides[2 * field : 2 * field + 2], strict=True):
            faces[end] *= side != "closed"
        if "periodic" in sides[2 * field]:
            faces[-1] = faces[0]
    return a


CASES = [(CLOSED, SLIP), (CLOSED, STICK), (OPEN, SLIP), (MIXED, SLIP), (MIXED, tuple(s == "closed" for s in MIXED))]
CASES += [(SLAB, SLIP), (PERIODIC, SLIP)]
NAMES = ["closed", "stick", "open", "mixed", "mixed stick", "slab", "periodic"]


@pytest.mark.parametrize("field", FIELDS, ids=["cells", "u", "v", "w"])
@pytest.mark.parametrize(("sides", "no_slip"), CASES, ids=NAMES)
@pytest.mark.parametrize("name", DIFFUSION_SOLVERS)
@pytest.mark.parametrize("r", [0.03, 1.0, 20.0])
def test_solves_the_implicit_equation(launcher, upload, name, field, sides, no_slip, r):
    """Both solvers find the solution of (I − r ∇²) a₁ = a₀ that a dense solve of the stencil finds."""
    before = random_field(sides, field)
    a = upload(before)
    error = make(launcher, name, sides, no_slip).diffuse(field, a, r)
    matrix = np.eye(before.size) - r * laplacian(sides, no_slip, field, SHAPE)
    expected = np.linalg.solve(matrix, before.ravel()).reshape(before.shape)
    assert error <= 1e-6
    np.testing.assert_allclose(a.numpy(), expected, atol=3e-6)


@pytest.mark.parametrize("name", DIFFUSION_SOLVERS)
@pytest.mark.parametrize("r", [1e3, 1e12, diffusion_number(1e300, 1e5, 1e-3)])
@pytest.mark.parametrize("field", FIELDS, ids=["cells", "u", "v", "w"])
def test_any_coefficient_is_stable(launcher, upload, name, field, r):
    """However large r is: finite, within the range of the field and the sides, few sweeps or many."""
    for sides, no_slip in CASES:
        before = random_field(sides, field)
        a = upload(before)
        make(launcher, name, sides, no_slip, sweeps=7).diffuse(field, a, r)
        found = a.numpy()
        assert np.isfinite(found).all()
        assert -1e-6 <= found.min() <= found.max() <= before.max() + 1e-6


@pytest.mark.parametrize("name", DIFFUSION_SOLVERS)
def test_nothing_diffuses_at_zero(launcher, upload, name):
    """A coefficient of 0 leaves every bit."""
    before = random_field(MIXED, None).astype(np.float32)
    a = upload(before)
    assert make(launcher, name, MIXED).diffuse(None, a, 0.0) == 0.0
    np.testing.assert_array_equal(a.numpy(), before)


@pytest.mark.parametrize("name", DIFFUSION_SOLVERS)
def test_smoke_is_kept_in_a_closed_box(launcher, upload, name):
    """No flux through closed sides: the sum stays; what was nowhere negative stays so."""
    before = np.zeros(SHAPE)
    before[2, 3, 4] = 1.0
    a = upload(before)
    make(launcher, name).diffuse(None, a, 0.7)
    assert a.numpy().sum(dtype=float) == pytest.approx(1.0, rel=1e-5)
    assert a.numpy().min() >= 0.0


@pytest.mark.parametrize("name", DIFFUSION_SOLVERS)
@pytest.mark.parametrize("sides", [OPEN, CLOSED], ids=["open", "closed"])
def test_uniform_motion_is_kept(launcher, upload, name, sides):
    """Along sides that let it slip, and through open ones, uniform motion goes on as it is."""
    for axis in range(3) if sides == OPEN else ():
        a = upload(np.full(face_shape(SHAPE, axis), 1.5))
        make(launcher, name, sides).diffuse(axis, a, 4.0)
        np.testing.assert_allclose(a.numpy(), 1.5, rtol=1e-5)
    sheet = tuple("open" if side < 2 else "closed" for side in range(6))
    a = upload(np.full(face_shape(SHAPE, 0), 1.5))
    make(launcher, name, sheet).diffuse(0, a, 4.0)
    np.testing.assert_allclose(a.numpy(), 1.5, rtol=1e-5)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 5, 4), (5, 1, 4), (5, 4, 1), (2, 2, 2)])
@pytest.mark.parametrize("name", DIFFUSION_SOLVERS)
def test_thin_domains(launcher, upload, name, shape):
    """Sheets and rods one cell thick too have the solution of a dense solve."""
    for (sides, no_slip), field in product(CASES, FIELDS):
        before = random_field(sides, field, shape)
        a = upload(before)
        make(launcher, name, sides, no_slip, shape).diffuse(field, a, 0.6)
        matrix = np.eye(before.size) - 0.6 * laplacian(sides, no_slip, field, shape)
        expected = np.linalg.solve(matrix, before.ravel()).reshape(before.shape)
        np.testing.assert_allclose(a.numpy(), expected, atol=3e-6)


def test_walls_hold_smoke_and_let_air_slip(launcher, upload):
    """A wall of no thickness: no smoke spreads through it, none is lost, and air along it is not held back."""
    shape = (8, 6, 5)
    wall = Mesh.grid((4, -1, -1), (0, 8, 0), (0, 0, 8))
    solids = Solids(launcher, lattice_of(shape, CLOSED), [Collider(path="/Wall", mesh=wall)])
    solids.update(1.0, 1.0, 0.0)
    solver = make(launcher, "jacobi", shape=shape, solids=solids)
    before = np.zeros(shape)
    before[1:3, 2, 2] = 1.0
    density = upload(before)
    solver.diffuse(None, density, 30.0)
    assert density.numpy()[4:].max() == 0.0
    assert density.numpy().sum(dtype=float) == pytest.approx(2.0, rel=1e-4)
    assert density.numpy()[:4].min() > 0.9 * 2.0 / (4 * 6 * 5)  # nearly even by now
    w = np.zeros(face_shape(shape, 2))
    w[:4], w[4:] = 1.0, -2.0
    w[..., 0] = w[..., -1] = 0.0
    alone = [w.copy(), w.copy()]
    alone[0][4:], alone[1][:4] = 0.0, 0.0
    results = []
    for each in (w, *alone):
        component = upload(each)
        solver.diffuse(2, component, 2.0)
        results.append(component.numpy())
    np.testing.assert_array_equal(results[0][:4], results[1][:4])  # what is behind the wall makes no difference
    np.testing.assert_array_equal(results[0][4:], results[2][4:])
    np.testing.assert_allclose(results[0][:4], np.broadcast_to(results[0][:1, :1], (4, 6, 6)), rtol=1e-6)
