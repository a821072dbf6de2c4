"""A receiver that bakes `depth` calls for the shadow maps of its lights, and for nothing else."""

from dataclasses import replace

import pytest
from scenes import at, floor, plume, shining

import warp_smoke as ws

CUBE = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.5), transform=at(0.2, 1.0, 0.0))
LAMP = ws.PointLight(path="/World/Lamp", transform=at(0.0, 3.0, 0.0))
SUN = ws.DistantLight(path="/World/Sun", transform=shining((0.1, -1.0, 0.0)))


def baking(*bakes: str, path: str = "/World/Floor", **fields) -> ws.Surface:
    """A floor that bakes these."""
    return replace(floor(), path=path, receiver=ws.Receiver(path=path, bake=bakes, texture_size=16, **fields))


def scene(*surfaces: ws.Surface, lights=(LAMP, SUN), **fields) -> ws.Scene:
    """Floors with a cube above them."""
    return ws.Scene(surfaces=[*surfaces, CUBE], lights=lights, end=4, **fields)


def lines(plan: ws.Plan) -> list[str]:
    """The passes that run."""
    return [str(each) for each in plan.passes]


def test_depth_alone_calls_for_maps_alone():
    """Depth alone traces and writes the two lights' maps, and neither lights nor bakes the surface."""
    assert lines(ws.make_plan(scene(baking("depth")))) == [
        "trace_shadow_map [cube]  /World/Lamp  (once): /World/Floor bakes depth",
        "trace_shadow_map [directional]  /World/Sun  (once): /World/Floor bakes depth",
        "write_depth_map  /World/Lamp  (once): /World/Floor bakes depth",
        "write_depth_map  /World/Sun  (once): /World/Floor bakes depth",
    ]


def test_smoke_casts_no_shadow_for_depth():
    """Over smoke, the fluid passes are as without a receiver: depth asks for no shadow of smoke."""
    bare, smoky = (replace(plume(), surfaces=surfaces) for surfaces in ((CUBE,), (baking("depth"), CUBE)))
    added = set(lines(ws.make_plan(smoky))) - set(lines(ws.make_plan(bare)))
    assert {line.split()[0] for line in added} == {"trace_shadow_map", "write_depth_map"}


def test_depth_beside_lit_adds_the_pictures_alone():
    """With `lit` the maps are traced anyway, for the reason that they were."""
    lit, both = (lines(ws.make_plan(scene(baking(*bakes)))) for bakes in (("lit",), ("lit", "depth")))
    assert [line for line in both if line not in lit] == [
        "write_depth_map  /World/Lamp  (once): /World/Floor bakes depth",
        "write_depth_map  /World/Sun  (once): /World/Floor bakes depth",
    ]
    assert [line for line in both if "write_depth_map" not in line] == lit


def test_one_picture_for_all_receivers():
    """A light that two receivers ask for is written once, for both."""
    plan = ws.make_plan(scene(baking("depth"), baking("depth", path="/World/Other"), lights=[LAMP]))
    written = [each for each in plan.passes if each.name == "write_depth_map"]
    assert [each.why for each in written] == ["/World/Floor, /World/Other bake depth"]
    assert plan.depth_maps == {"/World/Lamp": "once"}


@pytest.mark.parametrize("moving", ["light", "caster", "another receiver's caster"])
def test_a_map_that_changes_is_written_each_frame(moving):
    """A light or a caster that moves, also one that another receiver of the light brings in, changes the picture."""
    path = ws.Samples([1, 4], [at(0.2, 1.0, 0.0), at(0.6, 1.2, 0.0)])
    lamp, surfaces = LAMP, [baking("depth"), CUBE]
    if moving == "light":
        lamp = replace(LAMP, transform=ws.Samples([1, 4], [at(0.0, 3.0, 0.0), at(0.3, 3.0, 0.0)]))
    elif moving == "caster":
        surfaces[1] = replace(CUBE, transform=path)
    else:
        ceiling = replace(baking("lit", path="/World/Ceiling"), transform=at(0.0, 6.0, 0.0))
        above = ws.Samples([1, 4], [at(0.0, 5.0, 0.0), at(1.0, 5.0, 0.0)])
        surfaces += [ceiling, replace(CUBE, path="/World/High", transform=above)]
    plan = ws.make_plan(ws.Scene(surfaces=surfaces, lights=[lamp], end=4))
    when = {each.name: each.when for each in plan.passes}
    assert when["trace_shadow_map"] == when["write_depth_map"] == "each frame"


def test_what_does_not_change_a_map():
    """A light that dims and a receiver that moves leave the map as it is, and its picture is written once."""
    dimming = replace(LAMP, intensity=ws.Samples([1, 4], [1.0, 0.5]))
    rising = replace(baking("depth"), transform=ws.Samples([1, 4], [at(0.0, 0.0, 0.0), at(0.0, 0.1, 0.0)]))
    plan = ws.make_plan(scene(rising, lights=[dimming]))
    assert plan.depth_maps == {"/World/Lamp": "once"}


def test_only_lights_that_reach_the_receiver():
    """Lights that are linked past it, too far away or off are left out with their reason and without a warning."""
    elsewhere = replace(LAMP, path="/World/Elsewhere", illuminates=("/World/Cube",))
    far = replace(LAMP, path="/World/Far", falloff_end=1.0)
    off = replace(LAMP, path="/World/Off", enabled=False)
    plan = ws.make_plan(scene(baking("depth"), lights=[LAMP, elsewhere, far, off]))
    assert list(plan.depth_maps) == ["/World/Lamp"]
    why = {out.subjects: out.why for out in plan.left_out}
    assert why["/World/Elsewhere", "/World/Floor"] == "its lightLink leaves the surface out"
    assert why["/World/Far", "/World/Floor"] == "/World/Floor lies beyond its falloffEnd"
    assert why["/World/Off",] == "it is off at every frame"
    assert plan.warnings == ()


@pytest.mark.parametrize(
    ("light", "receiver", "why"),
    [
        (
            {"shadow_filter": "exact"},
            {},
            "its smoke:shadowFilter is exact, by rays; allowed: hard, pcf_grid, pcf_disk, pcf_disk_view, pcss",
        ),
        (
            {"shadow_filter": "area"},
            {},
            "its smoke:shadowFilter is area, by rays; allowed: hard, pcf_grid, pcf_disk, pcf_disk_view, pcss",
        ),
        ({"shadow_enable": False}, {}, "its inputs:shadow:enable is false; allowed: true"),
        ({}, {"receive_shadow": False}, "smoke:receiveShadow is false; allowed: true"),
        ({"shadowed_by": ()}, {}, "nothing casts a shadow there"),
    ],
)
def test_a_light_without_a_map_is_warned_of(light, receiver, why):
    """One line names the light, both receivers that go without, and what is allowed; the other light is written."""
    floors = [baking("depth", **receiver), baking("depth", "lit", path="/World/Other", **receiver)]
    kept = replace(floor(), path="/World/Kept", receiver=ws.Receiver(path="/World/Kept", bake=("depth",)))
    sun = replace(SUN, illuminates=("/World/Kept",))
    lamp = replace(LAMP, illuminates=("/World/Floor", "/World/Other"), **light)
    plan = ws.make_plan(scene(*floors, kept, lights=[lamp, sun]))
    assert plan.warnings == (f"/World/Lamp: no depth map for /World/Floor, /World/Other: {why}",)
    assert plan.depth_maps == {"/World/Sun": "once"}


@pytest.mark.parametrize(("ambient", "more"), [(0.2, "; a dome light has none"), (0.0, "")])
def test_without_a_light_that_could_have_a_map(ambient, more):
    """A dome's ambient light, or none at all, is one warning, and nothing runs."""
    plan = ws.make_plan(scene(baking("depth"), lights=(), ambient=(ambient,) * 3))
    assert plan.warnings == (f"/World/Floor: no depth map: no light that can have a shadow map reaches it{more}",)
    assert plan.passes == ()


def test_receivers_that_nothing_can_be_baked_for():
    """An invisible receiver is told of as for every other bake."""
    plan = ws.make_plan(scene(replace(baking("depth"), visible=False)))
    assert plan.warnings == ("/World/Floor: it is invisible at every frame",)
    assert plan.passes == ()


def test_the_host_holds_pictures_of_maps():
    """The estimate has the pictures that wait to be written: a cross of twelve faces, and a square."""
    host = ws.make_plan(scene(baking("depth"))).host_bytes
    assert host["/World/Lamp"] == 12 * 8 * LAMP.shadow_map_size**2
    assert host["/World/Sun"] == 8 * SUN.shadow_map_size**2
