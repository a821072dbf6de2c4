"""Smoke shadows joined to scenes: colours, layers, several lights and domains, lights inside, bad options."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import at, floor, plume

import warp_smoke as ws
from warp_smoke.lighting import Lighting
from warp_smoke.record import FieldError, Samples
from warp_smoke.shading.bake import ReceiverBake


def _last(scene, frames=3):
    """The simulation and its last frame's pictures."""
    simulation = ws.Simulation(scene, threads=1)
    for _ in range(frames):
        frame = simulation.step()
    return simulation, frame.pictures


def _shadows(scene):
    """How smoke shadows the floor, by light and domain."""
    (receiver,) = ws.make_plan(scene).receivers
    return {(light.light.path, s.domain.domain.path): s for light in receiver.lights for s in light.smoke}


def test_coloured_extinction_gives_coloured_shadows():
    """Smoke that takes blue light only leaves red as it is without smoke, and blue as it is in grey smoke."""
    scene = plume(extinction=9.0)
    grey = _last(scene)[1]["/World/Floor", "lit"].astype(int)
    clear = _last(replace(scene, domains=[replace(scene.domains[0], extinction=1e-9)]))[1]["/World/Floor", "lit"]
    tinted = replace(scene.domains[0], extinction_color=(0.0, 0.5, 1.0))
    colored = _last(replace(scene, domains=[tinted]))[1]["/World/Floor", "lit"].astype(int)
    np.testing.assert_allclose(colored[..., 0], clear[..., 0], atol=1)
    np.testing.assert_allclose(colored[..., 2], grey[..., 2], atol=1)
    assert (clear.astype(int) - grey)[..., 2].max() > 20


def test_equal_colours_cost_one_channel():
    """An extinction colour that is grey is the same, to the bit, as that much extinction."""
    scene = plume()
    half = replace(scene, domains=[replace(scene.domains[0], extinction=4.0, extinction_color=(0.5, 0.5, 0.5))])
    plain = replace(scene, domains=[replace(scene.domains[0], extinction=2.0)])
    np.testing.assert_array_equal(_last(half)[1]["/World/Floor", "lit"], _last(plain)[1]["/World/Floor", "lit"])


def test_layers_only_where_a_receiver_is_inside():
    """The floor under the box needs one layer; a floor through it two slices a layer, or what the light says."""
    scene = plume()
    assert {shadow.layer for shadow in _shadows(scene).values()} == {None}
    through = replace(scene, surfaces=[replace(floor(), transform=at(0, 0.7, 0))])
    assert {shadow.layer for shadow in _shadows(through).values()} == {2}
    lights = [replace(light, smoke_shadow_layer=5) for light in scene.lights]
    assert {shadow.layer for shadow in _shadows(replace(through, lights=lights)).values()} == {5}


@pytest.mark.parametrize("method", ["nearest", "bilinear", "gaussian", "footprint", "dpd"])
def test_every_method_runs_in_a_scene(method):
    """A light that asks for a method gets its kernels, loaded beforehand, and a shadow."""
    scene = plume()
    fields = {"smoke_shadow": method, "smoke_diffusion": 0.5, "smoke_diffuser": "sweeps"}
    simulation, pictures = _last(replace(scene, lights=[replace(light, **fields) for light in scene.lights]))
    assert pictures["/World/Floor", "smokeShadow"].min() < 250
    assert ("_gather_splats" in simulation.launcher.launches) == (method != "dpd")
    assert {each.method for each in simulation.plan.passes if each.name == "project_smoke"} == {method}


def test_shadows_of_two_domains_multiply():
    """One buffer for each pair of a light and a domain, and darker where both stand before the light."""
    scene = plume()
    (domain,), (source,) = scene.domains, scene.emitters
    above = replace(domain, path="/World/Above", transform=at(0, 3.2, 0))
    smoke = replace(source, path="/World/SourceAbove", transform=at(0, 3.2, 0))
    sun = scene.lights[1:]
    both = replace(scene, domains=[domain, above], emitters=[source, smoke], lights=sun)
    assert set(_shadows(both)) == {("/World/Sun", "/World/Smoke"), ("/World/Sun", "/World/Above")}
    shares = []
    for one in ([domain], [above]):
        picture = _last(replace(both, domains=one), 1)[1]["/World/Floor", "smokeShadow"]
        shares.append(picture.astype(float) / 255)
    together = _last(both, 1)[1]["/World/Floor", "smokeShadow"].astype(float) / 255
    np.testing.assert_allclose(together, shares[0] * shares[1], atol=0.01)


def test_smoke_is_projected_once_for_each_pair():
    """Two floors under two lights take two projections a frame; where smoke is linked to one of the lights, one."""
    scene = plume()
    second = replace(scene.surfaces[0], path="/World/Second", transform=at(0, -0.5, 0))
    second = replace(second, receiver=replace(second.receiver, path="/World/Second"))
    linked = replace(scene.lights[0], shadowed_by=("/World/Floor",))
    for lights, pairs in ((scene.lights, 2), ((linked, *scene.lights[1:]), 1)):
        simulation = ws.Simulation(replace(scene, surfaces=[*scene.surfaces, second], lights=lights))
        for _ in range(2):
            simulation.step()
        counts = []
        for _ in range(2):
            launches = simulation.launcher.launches
            counts.append(launches["_shear_slices"] + launches["_march_slices"])
            simulation.step()
        assert counts[1] - counts[0] == pairs
        assert sum(each.name == "project_smoke" for each in simulation.plan.passes) == pairs


@pytest.mark.parametrize("method", ["march", "footprint", "dpd"])
@pytest.mark.parametrize("place", [(0, 1, 0), (0.2, 1.3, -0.4), (1, 2, 1), (1, 1, 0), (0.125, 1.125, 0.125)])
def test_light_inside_the_smoke_is_traced(method, place):
    """At the domain's centre, on a corner, on a side, on a cell's corner: rays are traced, and nothing is undefined."""
    scene = plume(frames=2)
    lamp = replace(scene.lights[0], transform=at(*place), smoke_shadow=method)
    simulation, pictures = _last(replace(scene, lights=[lamp]), 2)
    assert {s.method for s in _shadows(simulation.plan.scene).values()} <= {"ray_traced"}
    assert any("rays are traced" in out.why for out in simulation.plan.left_out) or not _shadows(simulation.plan.scene)
    assert pictures["/World/Floor", "lit"].max() > 0


@pytest.mark.parametrize("method", ["march", "gaussian", "dpd", "ray_traced"])
def test_texels_that_no_smoke_can_shadow_are_left_alone(monkeypatch, method):
    """Each frame's pictures have the bytes that they have when every texel is put together anew."""
    scene = plume(frames=4)
    scene = replace(scene, lights=[replace(light, smoke_shadow=method, smoke_diffusion=0.5) for light in scene.lights])

    def frames():
        simulation = ws.Simulation(scene, threads=1)
        return [simulation.step().pictures for _ in scene.frames]

    found = frames()
    monkeypatch.setattr(Lighting, "_limit_smoke", lambda *_: None)
    for one, other in zip(found, frames(), strict=True):
        assert set(one) == set(other)
        for key, pixels in one.items():
            np.testing.assert_array_equal(pixels, other[key])


def test_the_smokes_reach_is_the_shadow_of_its_box(monkeypatch):
    """Under the sun alone: the box's shadow on the floor, 4 + 2 · 0.8 + 2 · 0.4 of 36 square metres, and its border."""
    scene, counts = plume(frames=1), []
    limit = ReceiverBake.limit_smoke
    monkeypatch.setattr(
        ReceiverBake, "limit_smoke", lambda bake, reached: (counts.append(len(reached)), limit(bake, reached))
    )
    ws.Simulation(replace(scene, lights=scene.lights[1:])).step()
    (count,) = counts
    inside, border = 6.4 / 36 * 64**2, 9.8 * 0.125 / 36 * 64**2  # a cell wide, as the buffer's texels are
    assert inside - 0.1 * border <= count <= inside + 1.5 * border


def test_a_moving_light_reaches_all_texels(monkeypatch):
    """Where light or receiver moves, nothing is limited: every texel may change."""
    monkeypatch.setattr(ReceiverBake, "limit_smoke", lambda *_: pytest.fail("limited"))
    scene = plume(frames=2)
    moving = Samples([1, 2], np.stack([at(1.5, 3.5, 1.0), at(1.5, 3.4, 1.0)]))
    _last(replace(scene, lights=[replace(scene.lights[0], transform=moving)]), 2)


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("smoke_shadow_size", 0, "whole numbers from 1"),
        ("smoke_shadow_layer", 0, "whole numbers from 1"),
        ("smoke_sweeps", 0, "whole numbers from 1"),
        ("smoke_diffusion", -1.0, "≥ 0"),
        ("smoke_diffusion", 1e9, "0 to 1000"),
        ("smoke_diffusion", float("nan"), "finite"),
        ("smoke_diffuser", "fast", "paper, sweeps, exact"),
        ("smoke_projection", "wide", "parallel, rays"),
        ("smoke_compositing", "soft", "opacity, transmittance"),
    ],
)
def test_bad_options_of_lights(field, value, allowed):
    """One line that names the light, the field, the value and what is allowed."""
    with pytest.raises(FieldError, match=f"^/World/Lamp: {field} is .*allowed: .*{allowed}"):
        ws.PointLight(path="/World/Lamp", **{field: value})


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"albedo": (0.5, 0.5, 1.5)}, "albedo is .*allowed: 0 to 1"),
        ({"extinction_color": (0.5, -0.5, 1.0)}, "extinction_color is .*allowed: ≥ 0"),
        ({"lower": (0, 0, 0), "upper": (1, 0, 1)}, "upper is .*greater than lower"),
        ({"resolution": 0}, "resolution is 0"),
    ],
)
def test_bad_options_of_domains(fields, message):
    """A side of no size, no cells, and colours out of range are refused by name."""
    with pytest.raises(FieldError, match=message):
        ws.SmokeDomain(path="/World/Smoke", **fields)


def _light(lights, **domain):
    """What the smoke of the plume scatters at the last frame under some lights."""
    scene = plume(grids=("density", "light"), **domain)
    simulation = ws.Simulation(replace(scene, lights=lights, surfaces=[]), threads=1)
    (smoke,) = [simulation.step() for _ in range(3)][-1].smoke.values()
    return smoke.light


def test_light_linking_of_the_smoke():
    """A light whose lightLink leaves the domain out gives its smoke nothing, and the plan says so."""
    lamp, sun = plume().lights
    elsewhere = replace(lamp, illuminates=("/World/Floor",))
    np.testing.assert_array_equal(_light([elsewhere, sun]), _light([sun]))
    assert not _light([elsewhere]).any()
    plan = ws.make_plan(replace(plume(grids=("light",)), lights=[elsewhere]))
    assert "its lightLink leaves the domain out" in [each.why for each in plan.left_out if each.name == "light_volume"]


def test_shadow_linking_of_the_smoke():
    """A light whose shadowLink leaves the domain out shines through its smoke as if it cast no shadow at all."""
    lamp, _ = plume().lights
    through = _light([replace(lamp, shadowed_by=())])
    np.testing.assert_array_equal(through, _light([replace(lamp, shadow_enable=False)]))
    assert (through > _light([lamp])).any()
