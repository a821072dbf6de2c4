"""Smoke stays on its side of walls that are thinner than a cell, at rest and moving, at any Courant number."""

import numpy as np
import pytest
from shapes import shell

import warp_smoke as ws
from warp_smoke.fluid.solver import SmokeSolver
from warp_smoke.timing import Timings

N = 16
H = 2 / N
CENTRES = (np.indices((N, N, N)) + 0.5) * H - 1
COURANT = pytest.mark.parametrize("courant", [1.0, 4.0])
SHEET = ws.Mesh.grid((-3, 0, -3), (0, 0, 6), (6, 0, 0))


def at(x, y, z):
    """A transform that moves the origin to (x, y, z)."""
    matrix = np.eye(4)
    matrix[3, :3] = x, y, z
    return matrix


def path(*places):
    """A transform that goes from place to place in a hundred frames."""
    return ws.Samples(np.linspace(1.0, 100.0, len(places)), np.stack([at(*place) for place in places]))


def follow(launcher, wall, source, courant, behind):
    """Runs a hundred frames; returns the most smoke ever behind the wall, and all that is there at last."""
    domain = ws.SmokeDomain(
        path="/Smoke", resolution=N, buoyancy_temperature=20.0, max_courant=courant, boundary=("open",) * 6
    )
    (plan,) = ws.make_plan(ws.Scene(domains=[domain], emitters=[source], colliders=[wall], end=100)).domains
    solver = SmokeSolver(launcher, plan, Timings(launcher))
    solver.begin(1)
    most = 0.0
    for frame in range(2, 101):
        solver.advance(frame - 1, frame, 1 / 24)
        density = solver.state.density.numpy()
        most = max(most, density[behind(frame)].max())
    return most, density


@COURANT
@pytest.mark.parametrize("moves", [False, True], ids=["still", "moving"])
def test_plume_under_a_sheet(launcher, courant, moves, record_property):
    """A plume spreads under a sheet right across the domain, which may go up and down, and none of it gets above."""
    transform = path((0, 0.03, 0), (0, 0.6, 0), (0, -0.1, 0)) if moves else at(0, 0.03, 0)
    sheet = ws.Collider(path="/Sheet", mesh=SHEET, transform=transform)
    source = ws.Emitter(path="/Source", mesh=ws.Mesh.sphere(0.25, 16), transform=at(0, -0.6, 0))
    above, density = follow(launcher, sheet, source, courant, lambda time: CENTRES[1] > sheet.transform_at(time)[3, 1])
    record_property("largest density above the sheet", float(above))
    assert above == 0.0
    assert np.count_nonzero(density > 0.1) > 300  # the source alone fills 30 cells


STILL, SLOW = [(0, 0, 0)], [(0, 0, 0), (0.2, 0.2, 0.1), (-0.2, 0.1, -0.1)]
SHAKEN = [(0.3 * (-1) ** n, 0, 0) for n in range(40)]


@pytest.mark.parametrize(
    ("places", "courant"),
    [(STILL, 1.0), (STILL, 4.0), (SLOW, 1.0), (SLOW, 4.0), (SHAKEN, 4.0)],
    ids=["still", "still, far", "slow", "slow, far", "shaken"],
)
def test_source_in_a_closed_shell(launcher, places, courant, record_property):
    """Hot smoke in a hollow sphere with a wall of 0.16 cells, which may be shaken, stays in it."""
    transform = path(*places) if len(places) > 1 else at(*places[0])
    ball = ws.Collider(path="/Shell", mesh=shell(0.6, 0.02), transform=transform)
    source = ws.Emitter(path="/Source", mesh=ws.Mesh.sphere(0.2, 16), transform=transform)

    def outside(time):
        return np.linalg.norm(CENTRES - ball.transform_at(time)[3, :3, None, None, None], axis=0) > 0.6

    beyond, density = follow(launcher, ball, source, courant, outside)
    record_property("largest density outside the shell", float(beyond))
    assert beyond == 0.0
    assert np.count_nonzero(density > 0.1) > 100  # the source alone fills 20 cells


def test_fast_walls_take_more_steps(launcher):
    """A wall that crosses 12 cells in a frame of still air moves by no more than the Courant limit in each step."""
    sheet = ws.Collider(path="/Sheet", mesh=SHEET, transform=path((0, -2.1, 0), (0, -2.1 + 99 * 12 * H, 0)))
    source = ws.Emitter(path="/Source", mesh=ws.Mesh.sphere(0.25, 16), temperature=0.0)
    domain = ws.SmokeDomain(path="/Smoke", resolution=N, boundary=("open",) * 6)
    (plan,) = ws.make_plan(ws.Scene(domains=[domain], emitters=[source], colliders=[sheet], end=2)).domains
    solver = SmokeSolver(launcher, plan, Timings(launcher))
    solver.begin(1)
    assert solver.advance(1, 2, 1 / 24).substeps >= 3


@pytest.mark.parametrize("free", [0, 1], ids=["no cell free", "one cell free"])
def test_solid_all_but_one_cell(launcher, free):
    """In a domain that a collider fills, or fills but for one cell with hot smoke, nothing moves and all is finite."""
    block = ws.Mesh.box(4.0)
    hole = ws.Mesh.box(H, lower=(0.0, 0.0, 0.0))
    points = np.concatenate([block.points, hole.points])
    hollow = ws.Mesh(points, np.concatenate([block.triangles, hole.triangles[:, ::-1] + len(block.points)]))
    wall = ws.Collider(path="/Block", mesh=hollow if free else block)
    source = ws.Emitter(path="/Source", mesh=ws.Mesh.sphere(0.25, 16))
    most, density = follow(launcher, wall, source, 4.0, lambda _: np.abs(CENTRES - H / 2).max(axis=0) > H / 2)
    assert most == 0.0
    assert np.count_nonzero(density) == free
    assert np.isfinite(density).all()
