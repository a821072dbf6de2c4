"""What a plan warns of: receivers that show their backs to every light, emitters that are tiny, idle or have holes."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import at, floor, shining

import warp_smoke as ws
from warp_smoke.simulation import Simulation

LIGHTS = {
    "point": ws.PointLight(path="/World/Lamp", transform=at(0.3, 3.0, 0.2), intensity=100.0),
    "distant": ws.DistantLight(path="/World/Sun", transform=shining((0.3, -1.0, 0.2)), intensity=3.0),
}

BOX = ws.Mesh.box(4.0)
AWAY = ws.Samples([1.0, 20.0], np.array([at(0.0, 0.0, 0.0), at(9.0, 0.0, 0.0)]))


def ground(turned_over: bool, with_normals: bool) -> ws.Surface:
    """A floor that may be wound the other way, as a leftHanded one is whose points are not."""
    surface = floor(2.0, texture_size=8)
    mesh = surface.mesh
    triangles = mesh.triangles[:, ::-1] if turned_over else mesh.triangles
    uvs = mesh.uvs[:, ::-1] if turned_over else mesh.uvs
    return replace(surface, mesh=ws.Mesh(mesh.points, triangles, mesh.normals if with_normals else None, uvs))


@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize("turned_over", [False, True])
@pytest.mark.parametrize("with_normals", [False, True])
def test_black_bakes_are_warned_of(light, turned_over, with_normals):
    """The warning is there if and only if the baked picture is black."""
    surface = ground(turned_over, with_normals)
    simulation = Simulation(ws.Scene(surfaces=[surface], lights=[light], end=1))
    picture = simulation.step().pictures["/World/Floor", "lit"]
    said = "/World/Floor: it faces away from every light; are its orientation and normals right?"
    assert simulation.plan.warnings == ((said,) if not picture.any() else ())
    assert picture.any() == (with_normals or not turned_over)


def test_one_light_in_front_is_enough():
    """A light on the other side, or one that moves, and nothing is said."""
    surface, lamp = ground(True, False), LIGHTS["point"]
    below = replace(lamp, path="/World/Below", transform=at(0.0, -2.0, 0.0))
    path = ws.Samples([1.0, 2.0], np.array([at(0.0, 3.0, 0.0), at(0.0, -3.0, 0.0)]))
    for lights in ([lamp, below], [replace(lamp, transform=path)]):
        assert ws.make_plan(ws.Scene(surfaces=[surface], lights=lights, end=2)).warnings == ()


FILLING = {
    "box": (ws.Collider(path="/Full", mesh=ws.Mesh.box(4.0)), True),
    "inside out": (ws.Collider(path="/Full", mesh=ws.Mesh(BOX.points, BOX.triangles[:, ::-1])), True),
    "ball": (ws.Collider(path="/Full", mesh=ws.Mesh.sphere(4.0)), True),
    "array": (ws.ArrayCollider(path="/Full", solid=np.ones((8, 8, 8), bool)), True),
    "array with room": (ws.ArrayCollider(path="/Full", solid=np.eye(8)[..., None] * np.ones(8) > 0), False),
    "all centres": (ws.Collider(path="/Full", mesh=ws.Mesh.box(1.8)), True),
    "room": (ws.Collider(path="/Full", mesh=ws.Mesh.box(1.6)), False),
    "beside": (ws.Collider(path="/Full", mesh=ws.Mesh.box(4.0), transform=at(2.5, 0.0, 0.0)), False),
    "leaves": (ws.Collider(path="/Full", mesh=ws.Mesh.box(4.0), transform=AWAY), False),
}


@pytest.mark.parametrize(("collider", "fills"), FILLING.values(), ids=FILLING)
def test_colliders_that_fill_a_domain_are_named(collider, fills):
    """The warning is there if no cell of the domain is left for the air, and nothing moves."""
    domain = ws.SmokeDomain(path="/Smoke", resolution=8)
    source = ws.Emitter(path="/Source", mesh=ws.Mesh.box(0.5))
    simulation = Simulation(ws.Scene(domains=[domain], emitters=[source], colliders=[collider]))
    simulation.step()
    said = "/Full: it fills /Smoke, which holds neither air nor smoke"
    assert simulation.plan.warnings == ((said,) if fills else ())
    assert fills == (not simulation.solver().solids.fluid.numpy().any()) or collider.moves
    assert np.isfinite(simulation.density.numpy()).all()


@pytest.mark.parametrize(("cells", "warned"), [(0.06, True), (0.25, True), (0.48, True), (0.75, False), (1.5, False)])
def test_tiny_emitters_are_named(cells, warned):
    """A ball is warned of, with its size and theirs, where the place in a cell decides how much of it is seen.

    From the corner to the middle of a cell the smoke of a ball of half a cell grows eightfold, as measured; that of one
    of 0.75 cells 2.6-fold. Larger than 5 counts.
    """
    made = []
    for middle in (0.0, 0.125):
        ball = ws.Mesh.sphere(cells * 0.125, 16)
        source = ws.Emitter(path="/Source", mesh=ball, transform=at(middle, middle, middle))
        scene = ws.Scene(domains=[ws.SmokeDomain(path="/Smoke", resolution=8)], emitters=[source])
        said = f"/Source: it is {cells * 0.25:.3g} across and the cells of /Smoke are 0.25"
        assert [each.startswith(said) for each in ws.make_plan(scene).warnings] == [True] * warned
        made.append(Simulation(scene).step().smoke["/Smoke"].density.sum())
    assert (max(made) > 5 * min(made)) == warned


IDLE = "/Source: it has no effect: its density or rate is 0, and its heat and motion are not used"
NEVER = "/Smoke: no emitter that is ever on touches it, so it never holds smoke"
AIR = "/Smoke: it never holds smoke: the density or rate of /Source is 0"


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({}, ()),
        ({"density": 0.0, "temperature": 1.0}, (AIR,)),
        ({"rate": 0.0, "temperature": 1.0}, (AIR,)),
        ({"rate": 0.0}, (NEVER, IDLE)),
        ({"density": 0.0, "rate": 2.0}, (IDLE, AIR)),
        ({"density": ws.Samples([1.0, 2.0], np.array([0.0, 1.0]))}, ()),
        ({"density": 0.0, "temperature": 1.0, "velocity": (0.0, 1.0, 0.0)}, (AIR,)),
    ],
)
def test_idle_emitters_are_named(fields, said):
    """Without density or rate there is no smoke; without used heat and motion either there is nothing at all."""
    source = ws.Emitter(path="/Source", mesh=ws.Mesh.box(0.5), **{"temperature": 0.0} | fields)
    domain = ws.SmokeDomain(path="/Smoke", resolution=8)
    warnings = ws.make_plan(ws.Scene(domains=[domain], emitters=[source], end=2)).warnings
    assert warnings == said


def test_open_meshes_are_named():
    """Emitters and colliders with a hole are named once each, closed ones and points not."""
    box = ws.Mesh.box(0.5)
    holed = ws.Mesh(box.points, box.triangles[1:])
    spark = ws.Emitter(path="/Spark", mesh=ws.Points([[0.0, 0.0, 0.0]], [0.2]))
    scene = ws.Scene(
        domains=[ws.SmokeDomain(path="/Smoke", resolution=8), ws.SmokeDomain(path="/Other", resolution=8)],
        emitters=[ws.Emitter(path="/Source", mesh=holed), ws.Emitter(path="/Whole", mesh=box), spark],
        colliders=[ws.Collider(path="/Wall", mesh=ws.Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2)))],
    )
    text = "its mesh is not closed; what counts as inside it is estimated"
    assert ws.make_plan(scene).warnings == (f"/Source: {text}", f"/Wall: {text}")
