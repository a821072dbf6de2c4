"""A plan at work: what is left out is neither launched nor allocated, and threads do not matter."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import warp as wp
from scenes import at, floor, plume, shining

import warp_smoke as ws
from warp_smoke.kernels import kernel_modules
from warp_smoke.simulation import Simulation


def kernels_of(*modules):
    """Names of the kernels that modules define."""
    found = set()
    for name in modules:
        members = vars(import_module(f"warp_smoke.{name}")).values()
        found |= {m.key for m in members if isinstance(m, wp.Kernel) and m.module.name == f"warp_smoke.{name}"}
    return found


def simulate(scene, frames=3, **options):
    """A simulation after some frames, and its frames."""
    simulation = Simulation(scene, **options)
    return simulation, [simulation.step() for _ in range(frames)]


CUBE = ws.Surface(path="/World/Cube", mesh=ws.Mesh.box(0.3), transform=at(0.6, 1.5, 0))
BALL = ws.Collider(path="/World/Ball", mesh=ws.Mesh.sphere(0.3, 16), transform=at(0, 1.2, 0))
WAY = ws.Samples([1.0, 5.0], np.array([at(0, 1.2, 0), at(0.3, 1.2, 0)]))
ROUGH = replace(BALL, transform=WAY, friction=1.0)
CHANNEL = ("periodic", "periodic", "closed", "open", "periodic", "periodic")


# What switches an effect on, the modules whose kernels it launches, and labels of the memory that it takes.
EFFECTS = {
    "vorticity": ({"vorticity": 0.5}, {}, ["fluid.vorticity"], ["vorticity"]),
    "turbulence": ({"turbulence": 0.5}, {}, ["fluid.turbulence"], ["turbulence"]),
    "viscosity": (
        {"viscosity": 0.01, "diffusion_solver": "jacobi"},
        {},
        ["fluid.diffusion.spectral", "fluid.diffusion.jacobi"],
        ["diffusion"],
    ),
    "density diffusion": ({"density_diffusion": 0.01}, {}, ["fluid.diffusion.spectral"], ["diffusion"]),
    "wind": ({"wind": (1.0, 0.0, 0.0)}, {}, ["fluid.wind"], []),
    "dissipation": ({"density_dissipation": 0.5}, {}, ["fluid.dissipation"], []),
    "emitter noise": ({}, {"emitters": [replace(plume().emitters[0], noise=0.5)]}, ["fluid.emitter_share"], []),
    "emitter skin": ({}, {"emitters": [replace(plume().emitters[0], source="surface")]}, ["fluid.emitter_share"], []),
    "collider": ({}, {"colliders": [BALL]}, ["fluid.solid_faces", "fluid.pressure.v_cycle"], ["colliders"]),
    "surface shadow": (
        {},
        {"surfaces": [floor(), CUBE]},
        ["shadow.depth_map", "shadow.point_map", "shadow.directional_map"],
        ["casters", "shadow_map"],
    ),
}


@pytest.mark.parametrize("name", EFFECTS)
def test_left_out_effects_cost_nothing(name):
    """Without the effect its kernels are never launched, loaded or given memory; with it they are."""
    domain, scene, modules, labels = EFFECTS[name]
    without, _ = simulate(plume())
    with_it, _ = simulate(replace(plume(**domain), **scene))
    kernels = kernels_of(*modules)
    assert kernels
    assert not kernels & set(without.launcher.launches)
    assert kernels & set(with_it.launcher.launches)
    assert not {f"warp_smoke.{module}" for module in modules} & set(kernel_modules(without.plan))
    for label in labels:
        assert label not in without.launcher.allocated
        assert with_it.launcher.allocated[label] > 0


def test_smokeless_scene_has_no_fluid():
    """A set without smoke launches no kernel of the fluid or of smoke shadows, and bakes once."""
    scene = replace(plume(), domains=(), emitters=(), surfaces=[floor(), CUBE])
    simulation, frames = simulate(scene)
    assert not kernels_of("fluid.advection", "fluid.operators", "shadow.slice_projection", "shadow.smoke") & set(
        simulation.launcher.launches
    )
    assert set(frames[0].pictures) == {("/World/Floor", "lit"), ("/World/Floor", "visibility")}
    assert not frames[1].pictures
    counts = dict(simulation.launcher.launches)
    simulation.step()
    assert dict(simulation.launcher.launches) == counts  # nothing moves: a frame launches nothing at all


def test_unlit_scene_has_no_shading():
    """Smoke alone launches no kernel of shadows or shading."""
    simulation, _ = simulate(replace(plume(), surfaces=(), lights=()))
    assert not kernels_of("shading.compose", "shading.texels", "shadow.slice_projection", "shadow.smoke") & set(
        simulation.launcher.launches
    )
    assert "light_buffer" not in simulation.launcher.allocated


def test_static_shadows_are_traced_once():
    """Maps of static lights and casters are traced at the first frame only."""
    simulation, _ = simulate(replace(plume(), surfaces=[floor(), CUBE]))
    assert simulation.launcher.launches["_trace_tiles"] == 2  # one for each light


def test_only_the_lights_that_reach_are_traced():
    """Of two lamps over a floor with a cube on it, one is out of range: one map, one look-up; without range, two."""
    scene = replace(plume(), domains=(), emitters=(), surfaces=[floor(), CUBE])
    lamp = replace(scene.lights[0], path="/World/Lamp", transform=at(0, 3, 0))
    for reach, count in ((1.0, 1), (None, 2)):
        short = replace(lamp, path="/World/Short", falloff_end=reach)
        simulation, _ = simulate(replace(scene, lights=[lamp, short]))
        launches = simulation.launcher.launches
        assert launches["_trace_tiles"] == count
        assert launches["_filter_taps"] + launches["_filter_penumbra"] == count


def test_minimal_plan_equals_full_plan():
    """An emitter, collider and light that the plan leaves out change nothing, to the bit."""
    scene = plume()
    far = at(50, 0, 0)
    more = replace(
        scene,
        emitters=[*scene.emitters, replace(scene.emitters[0], path="/World/Off", enabled=False)],
        colliders=[replace(BALL, transform=far)],
        lights=[*scene.lights, ws.PointLight(path="/World/Dark", intensity=0.0)],
    )
    _, plain = simulate(scene)
    _, full = simulate(more)
    for a, b in zip(plain, full, strict=True):
        np.testing.assert_array_equal(a.smoke["/World/Smoke"].density, b.smoke["/World/Smoke"].density)
        for key, pixels in a.pictures.items():
            np.testing.assert_array_equal(pixels, b.pictures[key])


@pytest.mark.usefixtures("divided_launches")
@pytest.mark.parametrize("collider", [False, True])
def test_same_bits_for_any_number_of_threads(collider):
    """Fields and pictures of whole frames are bit-equal for 1, 2 and 7 threads, and from run to run."""
    scene = plume(resolution=24, vorticity=0.5, grids=("density", "temperature", "velocity"))
    scene = replace(scene, surfaces=[floor(), CUBE], colliders=[BALL] if collider else [])
    _, reference = simulate(scene, threads=1)
    for threads in (1, 2, 7):
        _, frames = simulate(scene, threads=threads)
        for a, b in zip(reference, frames, strict=True):
            for name in ("density", "temperature", "velocity"):
                x, y = (getattr(frame.smoke["/World/Smoke"], name) for frame in (a, b))
                np.testing.assert_array_equal(x.view(np.int32), y.view(np.int32))
            for key, pixels in a.pictures.items():
                np.testing.assert_array_equal(pixels, b.pictures[key])


def test_smoke_rises_and_shadows_the_floor():
    """The plume's centre of mass goes up, its mass stays positive, and the floor below gets darker."""
    _, frames = simulate(plume(resolution=24), frames=8)
    heights = []
    for frame in frames:
        density = frame.smoke["/World/Smoke"].density
        assert np.all(np.isfinite(density))
        assert density.min() >= 0.0
        heights.append((density.sum(axis=(0, 2)) * (np.arange(density.shape[1]) + 0.5)).sum() / density.sum())
    assert heights[-1] > heights[0] + 0.5
    first, last = (frame.pictures["/World/Floor", "smokeShadow"].astype(int) for frame in (frames[0], frames[-1]))
    assert first.min() < 250  # the emitter's own smoke is there from the first frame
    assert last.sum() < first.sum()


def test_fields_can_be_written_between_steps():
    """What a script puts into the density is carried on and seen in the next frame."""
    simulation, _ = simulate(plume(), frames=1)
    before = simulation.density.numpy().sum()
    density = np.zeros(simulation.density.shape, np.float32)
    density[4:8, 4:8, 4:8] = 5.0
    simulation.density.assign(density)
    frame = simulation.step()
    assert frame.smoke["/World/Smoke"].density.sum() > 2 * before


@pytest.mark.parametrize(
    "change",
    [
        {"vorticity": 0.5},
        {"turbulence": 0.5},
        {"viscosity": 0.01},
        {"viscosity": 0.01, "diffusion_solver": "jacobi"},
        {"density_diffusion": 0.01, "colliders": [BALL]},
        {"viscosity": 0.01, "colliders": [ROUGH]},
        {"viscosity": 0.01, "colliders": [ROUGH], "boundary": CHANNEL},
        {"advection": "semi_lagrangian"},
        {"advection": "bfecc"},
        {"boundary": CHANNEL},
        {"colliders": [BALL]},
        {"pressure_solver": "multigrid"},
        {"pressure_solver": "jacobi"},
        {"turbulence": 1.0, "turbulence_scale": 0.1},
        {"surfaces": [floor(texture_size=256), CUBE]},
        {"grids": ("density", "light"), "surfaces": [CUBE]},
        {"grids": ("density", "light"), "surfaces": (), "extinction_color": (1.0, 0.5, 0.2)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_memory_estimate(change):
    """The plan's estimate of device memory is within 15 % of what is allocated."""
    of_domain = {name: value for name, value in change.items() if hasattr(ws.SmokeDomain, name)}
    scene = replace(plume(resolution=32, **of_domain), **{k: v for k, v in change.items() if k not in of_domain})
    simulation, _ = simulate(scene, frames=1)
    allocated = sum(simulation.launcher.allocated.values())
    assert sum(simulation.plan.bytes.values()) == pytest.approx(allocated, rel=0.15)


@pytest.mark.parametrize("smoke_shadow", ["march", "nearest", "bilinear", "gaussian", "footprint", "dpd"])
@pytest.mark.parametrize(
    ("shadow_filter", "direction"), [("pcss", (0.2, -1.0, 0.1)), ("exact", (0.2, -0.1, -1.0))], ids=["map", "rays"]
)
def test_memory_estimate_of_lights(smoke_shadow, shadow_filter, direction):
    """Maps, masks, buffers, splats' tables, turned slices and the light grid: within 15 % of what is allocated."""
    shadows = {"smoke_shadow": smoke_shadow, "smoke_diffusion": 0.5, "shadow_filter": shadow_filter}
    lamp = ws.PointLight(path="/Lamp", transform=at(1.5, 3.5, 1.0), shadow_map_size=60, **shadows)
    sun = ws.DistantLight(path="/Sun", transform=shining(direction), shadow_map_size=64, **shadows)
    ball = ws.Surface(path="/Ball", mesh=ws.Mesh.sphere(0.3, 16), transform=at(0.5, 2.5, 0))
    domain = {"grids": ("density", "light"), "extinction_color": (1.0, 0.5, 0.2)}
    scene = replace(plume(resolution=24, **domain), lights=[lamp, sun], surfaces=[floor(), ball])
    simulation, _ = simulate(scene, frames=1)
    labels = ("shadow_map", "shadow_mask", "light_buffer", "smoke_slices", "smoke_splats", "volume_light")
    allocated = sum(simulation.launcher.allocated[label] for label in labels)
    allocated += 156 * sum(len(surface.mesh.triangles) for surface in scene.surfaces)  # the plan counts the hierarchy
    without = ws.make_plan(replace(scene, domains=[replace(scene.domains[0], grids=("density",))]))
    grid = simulation.plan.bytes["/World/Smoke"] - without.bytes["/World/Smoke"]
    assert grid == simulation.launcher.allocated["volume_light"]
    assert sum(simulation.plan.bytes[path] for path in ("/Lamp", "/Sun")) + grid == pytest.approx(allocated, rel=0.15)


def test_linked_surfaces_cast_the_only_shadows():
    """A ball left out of a light's shadowLink leaves the floor as if it were not there; in it, it darkens the floor."""
    ball = ws.Surface(path="/World/Ball", mesh=ws.Mesh.sphere(0.4, segments=16), transform=at(0, 0.8, 0))
    other = replace(ball, path="/World/Other", transform=at(2, 0.8, 0))
    lamp = ws.PointLight(path="/World/Lamp", transform=at(0, 4, 0), intensity=40.0)

    def baked(surfaces, shadowed_by):
        scene = ws.Scene(surfaces=[floor(), *surfaces], lights=[replace(lamp, shadowed_by=shadowed_by)], end=1)
        return ws.Simulation(scene).step().pictures["/World/Floor", "lit"]

    without = baked([other], None)
    np.testing.assert_array_equal(baked([ball, other], ("/World/Floor", "/World/Other")), without)
    assert baked([ball, other], None).sum() < without.sum()


@pytest.mark.parametrize(
    ("fields", "meant"),
    [
        ({"normalize": False, "angle": 0.53, "intensity": 2.0}, "; is inputs:normalize meant, or more exposure?"),
        ({"intensity": 1e-4}, "; is more exposure meant?"),
        ({"intensity": 1e-2}, None),
        ({"intensity": 0.0}, None),
    ],
)
def test_light_too_dim_to_be_seen_is_told(fields, meant):
    """A black lit texture is warned of once, with what the brightest light gives a matte floor: albedo B cos."""
    sun = ws.DistantLight(path="/World/Sun", transform=shining((0, -1, 0)), **fields)
    simulation = ws.Simulation(ws.Scene(surfaces=[floor()], lights=[sun], end=3))
    pictures = [simulation.step().pictures for _ in range(2)]
    told = [warning for warning in simulation.warnings if "black" in warning]
    if meant is None:
        assert told == []
        return
    assert not pictures[0]["/World/Floor", "lit"].any()
    # The irradiance over π: I sin² of half the angle, or I/π with `normalize`; 0.18 is the default grey.
    given = 0.18 * (2.0 * np.sin(np.radians(0.265)) ** 2 if "angle" in fields else 1e-4 / np.pi)
    said = f"/World/Floor: its lit bake is black: the brightest light, /World/Sun, gives {given:.1e} of white{meant}"
    assert told == [said]


def test_what_is_black_by_shadow_is_not_told():
    """A floor under a lid is black with light enough: nothing is said."""
    lid = ws.Surface(path="/World/Lid", mesh=ws.Mesh.box(20.0), transform=at(0, 10.5, 0))
    sun = ws.DistantLight(path="/World/Sun", transform=shining((0, -1, 0)), intensity=3.0)
    simulation = ws.Simulation(ws.Scene(surfaces=[floor(), lid], lights=[sun], end=1))
    assert not simulation.step().pictures["/World/Floor", "lit"].any()
    assert not any("black" in warning for warning in simulation.warnings)


def test_no_smoke_to_step():
    """A scene without smoke says why there is none, with the domain's path."""
    scene = plume()
    scene = replace(scene, emitters=[replace(each, transform=at(100, 0, 0)) for each in scene.emitters])
    with pytest.raises(ValueError, match=r"calls for no smoke: /World/Smoke: "):
        ws.Simulation(scene).solver()
