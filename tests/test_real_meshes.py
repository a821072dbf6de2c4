"""Meshes that nobody here made (they come with Warp) as emitter, collider, caster and receiver of whole runs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp.examples
from scenes import at, floor

import warp_smoke as ws
from warp_smoke.geometry import transform_points
from warp_smoke.simulation import Simulation
from warp_smoke.usd.validate import validate_stage

ASSETS = Path(warp.examples.get_asset_directory())


def fitted(name):
    """The first mesh of an asset, with a transform that fits it into a cube of side 0.8 around (0, 1, 0)."""
    from pxr import Usd, UsdGeom

    from warp_smoke.usd.read import read_stage

    stage = Usd.Stage.Open(str(ASSETS / f"{name}.usd"))
    if not stage.GetDefaultPrim():
        stage.GetRootLayer().defaultPrim = next(iter(stage.GetPseudoRoot().GetChildren())).GetName()
    assert any(prim.IsA(UsdGeom.Mesh) for prim in stage.Traverse())
    surface = max(read_stage(stage, name).surfaces, key=lambda s: len(s.mesh.triangles))
    points = transform_points(surface.transform_at(0), surface.mesh.points_at(0))
    scale = 0.8 / np.ptp(points, axis=0).max()
    place = np.diag([scale] * 3 + [1.0])
    place[3, :3] = (0, 1, 0) - scale * (points.min(axis=0) + points.max(axis=0)) / 2
    return surface.mesh, surface.transform_at(0) @ place


def scene_with(**records):
    """A domain of side 2 over a floor under a lamp and a sun."""
    return ws.Scene(
        domains=[ws.SmokeDomain(path="/World/Smoke", transform=at(0, 1, 0), resolution=32, buoyancy_temperature=6.0)],
        lights=[ws.PointLight(path="/World/Lamp", transform=at(1.5, 3, 1), intensity=60.0)],
        **({"surfaces": [floor()]} | records),
        end=4,
    )


@pytest.fixture(params=["bunny", "bear", "rocks"])
def real(request):
    """Mesh and transform of each asset."""
    return fitted(request.param)


def test_emitter(real):
    """Smoke of the mesh's shape: its mass at the first frame is about the mesh's volume in cells, and rises."""
    mesh, transform = real
    simulation = Simulation(scene_with(emitters=[ws.Emitter(path="/World/It", mesh=mesh, transform=transform)]))
    first = simulation.step().smoke["/World/Smoke"].density
    p = transform_points(transform, mesh.points_at(0))[mesh.triangles]
    volume = abs(np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum()) / 6
    # At 13 cells across, surface cells are the larger part of the bear's and the rocks' error.
    assert first.sum() * (2 / 32) ** 3 == pytest.approx(volume, rel=0.15)
    for _ in range(3):
        last = simulation.step().smoke["/World/Smoke"].density
    assert np.isfinite(last).all()
    height = np.arange(32)[None, :, None]
    assert (last * height).sum() / last.sum() > (first * height).sum() / first.sum()


def test_collider_and_caster(real):
    """Smoke from below flows around the mesh and never stands in it; the mesh throws a shadow on the floor."""
    mesh, transform = real
    source = ws.Emitter(path="/World/Source", mesh=ws.Mesh.sphere(0.25, 16), transform=at(0, 0.35, 0))
    solid = ws.Collider(path="/World/It", mesh=mesh, transform=transform)
    seen = ws.Surface(path="/World/It", mesh=mesh, transform=transform)
    scene = scene_with(emitters=[source], colliders=[solid], surfaces=[floor(), seen])
    simulation = Simulation(scene)
    for _ in range(4):
        frame = simulation.step()
        if frame.number == scene.start:
            visibility = frame.pictures["/World/Floor", "visibility"]
    density = frame.smoke["/World/Smoke"].density
    fluid = simulation.solver().solids.fluid.numpy()
    assert 0 < (fluid == 0).sum() < fluid.size / 4
    assert np.all(density[fluid == 0] == 0.0)
    assert density.max() > 0.5
    assert 0.01 < (visibility < 128).mean() < 0.5


def test_receiver_without_texture_coordinates(real, tmp_path):
    """A real mesh without texture coordinates is baked at its points; the stage is valid and a warning says so."""
    mesh, transform = real
    mesh = replace(mesh, uvs=None)
    source = ws.Emitter(path="/World/Source", mesh=ws.Mesh.sphere(0.25, 16), transform=at(0.6, 1.8, 0.5))
    receiver = ws.Receiver(path="/World/It", bake=("lit", "smokeShadow"))
    seen = ws.Surface(path="/World/It", mesh=mesh, transform=transform, receiver=receiver)
    result = ws.run(scene_with(emitters=[source], surfaces=[seen]), tmp_path / "out")
    assert any("no texture coordinates" in warning for warning in result.report["warnings"])
    assert not [problem for problem in validate_stage(result.stage) if problem.severity == "error"]
