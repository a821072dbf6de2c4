"""The plan keeps what the outputs need and nothing else, and says why."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import at, floor, plume, shining

import warp_smoke as ws
from warp_smoke.record import FieldError, Samples


def kept(plan):
    """Names of the passes that run."""
    return {each.name for each in plan.passes}


def reasons(plan, name):
    """Why a pass is left out, by its subjects."""
    return {out.subjects: out.why for out in plan.left_out if out.name == name}


def turning(times=(1, 4), degrees=90):
    """A transform that turns about y."""
    matrices = []
    for angle in np.radians(np.linspace(0, degrees, len(times))):
        matrix = np.eye(4)
        matrix[0, 0] = matrix[2, 2] = np.cos(angle)
        matrix[2, 0], matrix[0, 2] = np.sin(angle), -np.sin(angle)
        matrices.append(matrix)
    return Samples(times, matrices)


def test_whole_scene():
    """A plume over a lit floor calls for fluid, smoke shadows and a bake, but for no surface shadow."""
    plan = ws.make_plan(plume())
    assert kept(plan) == {
        "emit_density",
        "emit_temperature",
        "add_buoyancy",
        "fit_active_box",
        "project_pressure",
        "advect_velocity",
        "advect_density",
        "advect_temperature",
        "write_volume",
        "shade_light",
        "project_smoke",
        "smoke_transmittance",
        "bake",
    }
    assert [each.method for each in plan.passes if each.name == "project_pressure"] == ["spectral"]
    assert set(reasons(plan, "surface_visibility").values()) == {"nothing stands between the light and it"}
    assert all(out.why for out in plan.left_out)
    assert all(each.why for each in plan.passes)


def test_order_follows_the_data():
    """Fluid passes stand before what reads their density, and a bake stands last."""
    names = [each.name for each in ws.make_plan(plume()).passes]
    assert names.index("advect_density") < names.index("project_smoke") < names.index("smoke_transmittance")
    assert names[-1] == "bake"


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"vorticity": 0.5}, "confine_vorticity"),
        ({"wind": (0.0, 0.0, 1.0)}, "blow_wind"),
        ({"turbulence": 0.5}, "stir_air"),
        ({"viscosity": 0.5}, "diffuse_velocity"),
        ({"density_diffusion": 0.5}, "diffuse_density"),
        ({"density_dissipation": 0.5}, "dissipate_density"),
        ({"temperature_diffusion": 0.5}, "diffuse_temperature"),
        ({"temperature_cooling": 0.5}, "cool_temperature"),
    ],
)
def test_each_effect_runs_only_when_asked_for(change, name):
    """An effect's strength above zero, and nothing else, adds its pass."""
    without, with_it = ws.make_plan(plume()), ws.make_plan(plume(**change))
    assert kept(with_it) - kept(without) == {name}
    assert name in {out.name for out in without.left_out}


def test_partial_emission():
    """Noise or a skin asks for shares of cells; a plain emitter does not."""
    scene = plume()
    for change in ({"noise": 0.5}, {"source": "surface"}):
        plan = ws.make_plan(replace(scene, emitters=[replace(scene.emitters[0], **change)]))
        assert kept(plan) - kept(ws.make_plan(scene)) == {"vary_emission"}


def test_no_temperature_without_a_reader():
    """No buoyancy of heat and no temperature among the grids: no temperature field; exported, it is kept."""
    scene = plume()
    cold = replace(scene.domains[0], buoyancy_temperature=0.0, buoyancy_density=1.0)
    plan = ws.make_plan(replace(scene, domains=[cold]))
    assert not {"emit_temperature", "advect_temperature"} & kept(plan)
    exported = ws.make_plan(replace(scene, domains=[replace(cold, grids=("density", "temperature"))]))
    assert {"emit_temperature", "advect_temperature"} <= kept(exported)


def test_still_air_is_not_simulated():
    """Nothing moves the air: neither projection nor advection, nor a velocity grid, only emission."""
    scene = plume()
    still = replace(scene.domains[0], buoyancy_temperature=0.0)
    plan = ws.make_plan(replace(scene, domains=[still]))
    fluid = {"emit_density", "write_volume"}
    assert kept(plan) & {*ws.make_plan(scene).domains[0].passes, "write_volume"} == fluid
    assert plan.domains[0].grids == ("density",)


def test_no_emitter_no_fluid():
    """Without an emitter, or with one that is off, empty or far away, there is no fluid and no smoke shadow."""
    scene = plume()
    source = scene.emitters[0]
    for emitters in (
        (),
        [replace(source, enabled=False)],
        [replace(source, enabled=Samples([1, 2], [False, False]))],
        [replace(source, transform=at(0, 40, 0))],
        [replace(source, rate=0.0, temperature=0.0)],
    ):
        plan = ws.make_plan(replace(scene, emitters=emitters))
        assert not plan.domains
        assert not {"project_smoke", "smoke_transmittance", "write_volume"} & kept(plan)
        assert ("/World/Smoke",) in reasons(plan, "simulate")


def test_no_receiver_no_light():
    """Without a receiver no light, shadow or texture is computed; a scene without a light bakes nothing."""
    scene = plume()
    shading = {"shade_light", "project_smoke", "smoke_transmittance", "bake", "trace_shadow_map"}
    assert not shading & kept(ws.make_plan(replace(scene, surfaces=())))
    assert not shading & kept(ws.make_plan(replace(scene, lights=())))
    assert not shading & kept(ws.make_plan(replace(scene, surfaces=[replace(floor(), visible=False)])))


def test_lights_that_do_not_shine():
    """A light that is off, black or out of range of the receiver is left out with its reason."""
    scene = plume()
    lamp = scene.lights[0]
    for change, name, why in (
        ({"intensity": 0.0}, "light", "intensity or colour is 0"),
        ({"enabled": False}, "light", "off at every frame"),
        ({"falloff_end": 1.0}, "shade_light", "beyond its falloffEnd"),
    ):
        plan = ws.make_plan(replace(scene, lights=[replace(lamp, **change)]))
        assert "shade_light" not in kept(plan)
        assert any(why in reason for reason in reasons(plan, name).values())


def test_shadow_switches():
    """shadow:enable, receiveSmoke and receiveShadow each remove their passes and keep the light."""
    scene = plume()
    cube = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.5), transform=at(0.5, 1, 0))
    full = replace(scene, surfaces=[floor(), cube])
    assert {"trace_shadow_map", "surface_visibility", "smoke_transmittance"} <= kept(ws.make_plan(full))
    dark = replace(full, lights=[replace(light, shadow_enable=False) for light in full.lights])
    assert kept(ws.make_plan(dark)) & {"trace_shadow_map", "smoke_transmittance", "shade_light"} == {"shade_light"}
    receiver = replace(floor().receiver, receive_smoke=False)
    no_smoke = ws.make_plan(replace(full, surfaces=[replace(floor(), receiver=receiver), cube]))
    assert "smoke_transmittance" not in kept(no_smoke)
    assert "surface_visibility" in kept(no_smoke)
    receiver = replace(floor().receiver, receive_shadow=False)
    no_shadow = ws.make_plan(replace(full, surfaces=[replace(floor(), receiver=receiver), cube]))
    assert "surface_visibility" not in kept(no_shadow)
    assert "smoke_transmittance" in kept(no_shadow)


def test_what_cannot_shadow_is_not_traced():
    """A caster below the floor, beside the light's way or outside a spot's cone asks for no map; one above does."""
    scene = replace(plume(), domains=(), emitters=())
    sun = scene.lights[1]
    cube = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.5))
    spot = ws.SpotLight(path="/World/Spot", transform=at(0, 4, 0) @ np.eye(4), cone_angle=10.0)
    spot = replace(spot, transform=shining((0, -1, 0)) @ at(0, 4, 0))
    for light, place, shadows in (
        (sun, at(0, 1, 0), True),
        (sun, at(0, -1, 0), False),
        (sun, at(40, 1, 0), False),
        (spot, at(0, 1, 0), True),
        (spot, at(3, 1.5, 0), False),
    ):
        surfaces = [floor(), replace(cube, transform=place)]
        plan = ws.make_plan(replace(scene, surfaces=surfaces, lights=[light]))
        assert ("trace_shadow_map" in kept(plan)) == shadows, (light.path, place[3])


def test_smoke_that_cannot_shadow():
    """A light under the floor's level that shines away from the smoke leaves the pair out."""
    scene = plume()
    beside = ws.PointLight(path="/World/Beside", transform=at(40, 0.5, 0))
    away = replace(floor(), transform=at(30, 0, 0))
    plan = ws.make_plan(replace(scene, lights=[beside], surfaces=[away]))
    assert "smoke_transmittance" not in kept(plan)
    assert "never stands between" in next(iter(reasons(plan, "project_smoke").values()))


def test_light_inside_the_smoke_is_ray_traced():
    """A light in the domain has no plane behind the smoke: the method is ray_traced and there is no light buffer."""
    scene = plume()
    plan = ws.make_plan(replace(scene, lights=[replace(scene.lights[0], transform=at(0, 1, 0))]))
    assert "project_smoke" not in kept(plan)
    assert plan.receivers[0].lights[0].smoke[0][1] == "ray_traced"


def test_what_stands_still_is_computed_once():
    """Static lights, casters and receivers are traced and shaded once, moving ones each frame."""
    cube = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.5), transform=at(0, 1, 0))
    lamp = ws.PointLight(path="/World/Lamp", transform=at(0, 3, 0))
    scene = ws.Scene(surfaces=[floor(), cube], lights=[lamp], end=4)

    def when(scene):
        return {each.name: each.when for each in ws.make_plan(scene).passes}

    assert set(when(scene).values()) == {"once"}
    moving = when(replace(scene, surfaces=[floor(), replace(cube, transform=turning())]))
    assert {moving[name] for name in ("trace_shadow_map", "surface_visibility", "bake")} == {"each frame"}
    dimming = when(replace(scene, lights=[replace(lamp, intensity=Samples([1, 4], [1.0, 0.0]))]))
    assert dimming["trace_shadow_map"] == "once"
    assert dimming["shade_light"] == "each frame"


def test_colliders():
    """A collider asks for a solver that knows solids; a static one is voxelised once; one far away is left out."""
    scene = plume()
    ball = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 16), transform=at(0, 1, 0))

    def solid(collider):
        plan = ws.make_plan(replace(scene, colliders=[collider]))
        return {each.name: each for each in plan.passes}

    passes = solid(ball)
    assert passes["voxelize_colliders"].when == "once"
    assert passes["project_pressure"].method == "multigrid"
    assert "/World/Ball" in passes["project_pressure"].why
    assert solid(replace(ball, transform=turning()))["voxelize_colliders"].when == "each substep"
    assert "voxelize_colliders" not in solid(replace(ball, transform=at(9, 9, 9)))
    for name in ("pressure_solver", "diffusion_solver"):
        spectral = replace(scene.domains[0], **{name: "spectral"})
        with pytest.raises(FieldError, match=rf"/World/Smoke: {name} is spectral; allowed: .*/World/Ball"):
            ws.make_plan(replace(scene, domains=[spectral], colliders=[ball]))


def test_diffusion_solvers():
    """Spectral diffusion in an empty box, sweeps beside a collider; solids are known to smoke that only spreads."""
    ball = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 16), transform=at(0, 1, 0))
    scene = plume(density_diffusion=0.1, viscosity=0.1)
    for colliders, method in (((), "spectral"), ((ball,), "jacobi")):
        plan = ws.make_plan(replace(scene, colliders=colliders))
        found = {each.name: each.method for each in plan.passes if each.name.startswith("diffuse")}
        assert found == {"diffuse_velocity": method, "diffuse_density": method}
    still = replace(scene.domains[0], buoyancy_temperature=0.0)
    plan = ws.make_plan(replace(scene, domains=[still], colliders=[ball]))
    assert {"voxelize_colliders", "diffuse_density"} <= kept(plan)
    assert "diffuse_velocity" not in kept(plan)


def test_heat_that_spreads():
    """Heat that nothing reads does not spread; in still air it does, around colliders that are known to it."""
    ball = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 16), transform=at(0, 1, 0))
    scene = plume(temperature_diffusion=0.1)
    scene = replace(scene, domains=[replace(scene.domains[0], buoyancy_temperature=0.0)])
    assert "diffuse_temperature" not in kept(ws.make_plan(scene))
    exported = replace(scene.domains[0], grids=("density", "temperature"))
    plan = ws.make_plan(replace(scene, domains=[exported], colliders=[ball]))
    assert {"voxelize_colliders", "diffuse_temperature"} <= kept(plan)
    assert "project_pressure" not in kept(plan)


def test_images_touch_a_periodic_domain():
    """What is outside along a periodic axis is inside by its image; along another axis it is not."""
    scene = plume(boundary=("periodic", "periodic") + ("closed",) * 4)
    source = scene.emitters[0]
    for place, found in (((40, 0, 0), True), ((0, 0, 40), False)):
        plan = ws.make_plan(replace(scene, emitters=[replace(source, transform=at(*place))]))
        assert bool(plan.domains) == found


def test_sides_that_slip_after_all():
    """Without viscosity a plan says that sides which ask for no slip, and rough colliders, slip too."""
    ball = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 16), transform=at(0, 1, 0), friction=1.0)
    rough = ws.make_plan(replace(plume(), colliders=[ball]))
    assert any("/World/Ball" in out.why for out in rough.left_out if out.name == "diffuse_velocity")
    plan = ws.make_plan(plume(boundary=("no_slip",) * 6))
    (why,) = (out.why for out in plan.left_out if out.name == "diffuse_velocity")
    assert why == "viscosity is 0, so air slides along the sides that are no_slip too"


def test_plan_imports_no_warp():
    """Planning is quick: it loads neither Warp nor pyvista."""
    import subprocess
    import sys

    code = "import sys, warp_smoke as ws; ws.make_plan(ws.Scene()); sys.exit(bool({'warp', 'vtk'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_plan_reads_well():
    """The printed plan has a line for each pass and each omission."""
    plan = ws.make_plan(plume())
    text = str(plan)
    assert all(each.name in text and each.why in text for each in plan.passes)
    assert all(out.why in text for out in plan.left_out)


def test_light_linking():
    """A light linked past a floor does not shade it; one that smoke or a caster is not linked to has no such shadow."""
    scene = plume()
    ball = ws.Surface(path="/World/Ball", mesh=ws.Mesh.sphere(0.2, segments=8), transform=at(0, 1, 0))
    scene = replace(scene, surfaces=[*scene.surfaces, ball])
    path = scene.lights[0].path

    def plan(**links):
        return ws.make_plan(replace(scene, lights=[replace(scene.lights[0], **links)]))

    assert {"surface_visibility", "smoke_transmittance", "shade_light"} <= kept(plan())
    assert "shade_light" not in kept(plan(illuminates=("/World/Ball",)))
    why = reasons(plan(illuminates=()), "shade_light")
    assert why == {("/World/Floor", path): "its lightLink leaves the surface out"}
    smokeless = plan(shadowed_by=("/World/Ball",))
    assert "surface_visibility" in kept(smokeless)
    assert "smoke_transmittance" not in kept(smokeless)
    only_smoke = plan(shadowed_by=("/World/Smoke",))
    assert "smoke_transmittance" in kept(only_smoke)
    assert "surface_visibility" not in kept(only_smoke)


def test_empty_faces_of_a_cube_map_are_named():
    """A lamp above a cube on the floor: of six faces only the one below holds both, and the plan says why not."""
    cube = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.5), transform=at(0.2, 0.5, 0))
    lamp = ws.PointLight(path="/World/Lamp", transform=at(0, 3, 0))
    plan = ws.make_plan(ws.Scene(surfaces=[floor(), cube], lights=[lamp], end=1))
    faces = {subjects[1] for subjects in reasons(plan, "trace_shadow_map")}
    assert faces == {"+X", "-X", "+Y", "+Z", "-Z"}


@pytest.mark.parametrize(
    ("light", "method"),
    [
        (ws.PointLight(path="/World/L", transform=at(0, 3, 0)), "cube"),
        (ws.SpotLight(path="/World/L", transform=shining((0, -1, 0)) @ at(0, 3, 0), cone_angle=40.0), "spot"),
        (ws.SpotLight(path="/World/L", transform=shining((0, -1, 0)) @ at(0, 3, 0), cone_angle=70.0), "cube"),
        (ws.DistantLight(path="/World/L", transform=shining((0, -1, 0))), "directional"),
        (ws.DistantLight(path="/World/L", transform=shining((0, -1, 0)), shadow_filter="area"), "area"),
    ],
)
def test_each_light_has_its_kind_of_map(light, method):
    """Point, spot and distant lights each have their map; rays need none."""
    cube = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.5), transform=at(0.2, 0.5, 0))
    plan = ws.make_plan(ws.Scene(surfaces=[floor(), cube], lights=[light], end=1))
    assert plan.receivers[0].lights[0].surface_shadow == method
    assert ("trace_shadow_map" in kept(plan)) == (method != "area")
