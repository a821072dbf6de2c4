"""The light that smoke scatters: its formula, shadows of the smoke on itself and on others, and what is left out."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from pxr import Usd
from scenes import at, plume, shining

import warp_smoke as ws
from warp_smoke.lattice import place_lattice
from warp_smoke.shading.volume import VolumeLight
from warp_smoke.shadow.smoke_ray_traced import RayTracedSmokeShadow
from warp_smoke.vdb import read_vdb


def _run(scene, frames=2):
    """The last frame, and the simulation."""
    simulation = ws.Simulation(scene, threads=1)
    for _ in range(frames):
        frame = simulation.step()
    return frame, simulation


def test_formula(launcher):
    """S = albedo ⊗ (ambient + Σ V T ⊗ B / 4) in smoky cells, black in the others, for any number of blocks."""
    domain = ws.SmokeDomain(path="/World/Smoke", transform=at(0, 1, 0), resolution=30)
    lattice = place_lattice(ws.Scene(domains=[domain]), domain)
    lamp = ws.PointLight(path="/Lamp", transform=at(0.3, 4, 0.2), intensity=40.0, color=(1.0, 0.5, 0.25))
    sun = ws.DistantLight(path="/Sun", transform=shining((0, -1, 0.2)), intensity=3.0, color=(0.2, 0.4, 1.0))
    origin, albedo, ambient = np.array([5.0, -3.0, 2.0]), np.array([0.9, 0.5, 0.1]), np.array([0.1, 0.2, 0.3])
    lights, colors = [(lamp, 3), (sun, 1)], (tuple(albedo), tuple(ambient))
    volume = VolumeLight(launcher, lattice, lights, origin, *colors, shadowed=["/Sun"])
    density = np.random.default_rng(0).random(lattice.shape) * (np.random.default_rng(1).random(lattice.shape) > 0.3)
    assert (density > 0).sum() > 16384

    def look_through(light, points, shares):
        color = np.array([[0.2], [0.5], [0.8]]) if light is lamp else np.array([[0.7]])
        shares.assign(np.broadcast_to(color, shares.shape).astype(np.float32))

    def look_past(light, points, normals, visibility):
        assert light is sun
        towards = np.array([0, 1, -0.2]) / np.hypot(1, 0.2)
        np.testing.assert_allclose(normals.numpy(), np.broadcast_to(towards, (len(normals), 3)), atol=1e-6)
        visibility.fill_(0.25)

    found = volume.update(density, 1.0, look_through, look_past)
    centres = (np.stack(np.indices(lattice.shape), axis=-1) + 0.5) @ lattice.cells_to_world()[:3, :3]
    centres += lattice.to_world[3, :3]
    distance2 = np.sum((centres - (0.3, 4, 0.2)) ** 2, axis=-1)[..., None]
    from_lamp = np.array([0.2, 0.5, 0.8]) * 40.0 * np.array([1.0, 0.5, 0.25]) / (4 * np.pi * distance2)
    from_sun = 0.25 * 0.7 * 3.0 / np.pi * np.array([0.2, 0.4, 1.0])
    expected = albedo * (ambient + (from_lamp + from_sun) / 4) * (density > 0)[..., None]
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_smoke_shadows_itself_and_other_smoke():
    """Cells get what traced rays let through of both domains; with the upper one gone, the lower one is brighter."""
    scene = plume(resolution=32, grids=("density", "light"), extinction=6.0)
    sun = ws.DistantLight(path="/Sun", transform=shining((0.1, -1, 0.05)), smoke_shadow_layer=1)
    scene = replace(scene, surfaces=(), lights=[sun])
    (lower,), (source,) = scene.domains, scene.emitters
    upper = replace(lower, path="/World/Above", transform=at(0, 4, 0), grids=("density",), extinction=3.0)
    above = replace(source, path="/World/SourceAbove", transform=at(-0.36, 4, -0.18))
    both = replace(scene, domains=[lower, upper], emitters=[source, above])
    frame, simulation = _run(both, 1)
    lit = frame.smoke[lower.path].light
    smoky = frame.smoke[lower.path].density > 0.5
    alone = _run(scene, 1)[0].smoke[lower.path].light
    assert alone[smoky].mean() > 1.3 * lit[smoky].mean()

    lattice = place_lattice(both, lower)
    cells = np.argwhere(smoky) + 0.5
    points = cells @ lattice.cells_to_world()[:3, :3] + lattice.to_world[3, :3]
    points = wp.array(points, dtype=wp.vec3, device=simulation.launcher.device)
    share = wp.full((1, len(cells)), 1.0, dtype=float, device=simulation.launcher.device)
    for domain in (lower, upper):
        where = place_lattice(both, domain)
        truth = RayTracedSmokeShadow(
            simulation.launcher, where, both.lights[0], np.zeros(3), domain.extinction, step=0.1
        )
        truth.update(simulation.solver(domain.path).state.density, 1.0)
        truth.transmittance(points, share)
    expected = share.numpy()[0] / np.pi / 4
    error = np.abs(lit[smoky][:, 0] - expected)
    # Texels of a cell, over a ball with a hard edge eight cells in radius; a cell dims light by a third.
    assert error.mean() < 0.05 * expected.max()
    assert np.corrcoef(lit[smoky][:, 0], expected)[0, 1] > 0.97


@pytest.mark.parametrize("name", ["hard", "pcss", "exact"])
@pytest.mark.parametrize("kind", ["sun", "lamp"])
def test_surfaces_shadow_smoke(kind, name):
    """A roof over half of the domain leaves the smoke below it dark, and the other half as it is without the roof."""
    sun = ws.DistantLight(path="/Light", transform=shining((0, -1, 0)), shadow_filter=name)
    lamp = ws.PointLight(path="/Light", transform=at(0, 30, 0), intensity=1000.0, shadow_filter=name)
    scene = plume(grids=("density", "light"), resolution=24)
    roof = ws.Surface(path="/Roof", mesh=ws.Mesh.grid((-2, 2.5, 2), (2, 0, 0), (0, 0, -4)))
    scene = replace(scene, surfaces=[roof], lights=[sun if kind == "sun" else lamp])
    plan = ws.make_plan(scene)
    assert ("surface_visibility", ("/World/Smoke", "/Light")) in {(each.name, each.subjects) for each in plan.passes}
    smoke = _run(plan, 1)[0].smoke["/World/Smoke"]
    alone = _run(replace(scene, surfaces=()), 1)[0].smoke["/World/Smoke"].light
    unlinked = replace(scene, lights=[replace(scene.lights[0], shadowed_by=("/World/Smoke",))])
    np.testing.assert_array_equal(_run(unlinked, 1)[0].smoke["/World/Smoke"].light, alone)
    smoky = smoke.density > 0
    covered = np.arange(24)[:, None, None] < 11
    assert (smoky & covered).sum() > 50
    np.testing.assert_array_equal(smoke.light[smoky & covered], 0.0)
    free = smoky & (np.arange(24)[:, None, None] > 12)
    np.testing.assert_array_equal(smoke.light[free], alone[free])


def test_coloured_smoke_colours_its_own_light():
    """Smoke that takes blue light is redder on the side away from the sun."""
    scene = plume(grids=("density", "light"), extinction=8.0, extinction_color=(0.3, 0.6, 1.0))
    scene = replace(scene, surfaces=(), lights=[ws.DistantLight(path="/Sun", transform=shining((0, -1, 0)))])
    smoke = _run(scene, 1)[0].smoke["/World/Smoke"]
    where = np.argwhere(smoke.density > 0.5)
    top, bottom = (smoke.light[tuple(where[where[:, 1] == y].T)] for y in (where[:, 1].max(), where[:, 1].min()))
    assert bottom[:, 0].mean() / bottom[:, 2].mean() > 1.5 * top[:, 0].mean() / top[:, 2].mean()


def test_not_asked_for_not_computed():
    """Without the grid, or without any light, nothing is launched or allocated for it, and the plan says why."""
    _, simulation = _run(plume())
    assert "volume_light" not in simulation.launcher.allocated
    assert not simulation.plan.volumes
    dark = ws.make_plan(replace(plume(grids=("density", "light")), lights=()))
    assert dark.domains[0].grids == ("density",)
    assert [out.why for out in dark.left_out if out.name == "write light"] == ["no light shines"]


def test_written_to_the_volume_file(tmp_path):
    """A run writes the grid, and the stage says what it is."""
    result = ws.run(plume(grids=("density", "light"), resolution=12, frames=2), tmp_path / "out", threads=1)
    grids = read_vdb(tmp_path / "out/volumes/Smoke.0002.vdb")
    assert grids["light"].values.shape[3:] == (3,)
    assert grids["light"].values.max() > 0
    stage = Usd.Stage.Open(str(result.stage))
    (field,) = (prim for prim in stage.Traverse() if prim.GetName() == "light")
    assert field.GetAttribute("vectorDataRoleHint").Get() == "Color"
