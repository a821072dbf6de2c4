"""Shadows at the limits: maps that do not fit, lights in awkward places, options that do not exist."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import at, floor, plume

import warp_smoke as ws
from warp_smoke.launch import Launcher
from warp_smoke.record import FieldError

BALL = ws.Surface(path="/World/Ball", mesh=ws.Mesh.sphere(0.5, 16), transform=at(0, 1.5, 0))


def _shaded(lamp, **fields):
    """A ball above a baked floor under one light, without smoke."""
    return ws.Scene(surfaces=[floor(), BALL], lights=[replace(lamp, **fields)], end=1)


def test_a_map_that_does_not_fit_is_refused(monkeypatch):
    """A cube map larger than the memory that is free is refused in one line, before anything is allocated."""
    scene = _shaded(ws.PointLight(path="/World/Lamp", transform=at(0, 4, 0)), shadow_map_size=4096)
    assert ws.make_plan(scene).bytes["/World/Lamp"] >= 6 * 4096**2 * 4

    def never(*_args, **_named):
        raise AssertionError("memory was allocated")

    for name in ("zeros", "array"):
        monkeypatch.setattr(Launcher, name, never)
    monkeypatch.setattr(Launcher, "available_bytes", lambda _: 2**28)
    with pytest.raises(MemoryError, match=r"^the plan needs \d+ MiB of memory and 256 MiB are free[^\n]*$"):
        ws.Simulation(scene)


@pytest.mark.parametrize("kind", [ws.PointLight, ws.SpotLight, ws.DistantLight])
@pytest.mark.parametrize("field", ["shadow_filter", "smoke_shadow"])
def test_unknown_methods_are_named(kind, field):
    """One line with the light, the field, the value and every method that there is."""
    allowed = {"shadow_filter": ws.scene.SHADOW_FILTERS, "smoke_shadow": ws.scene.SMOKE_SHADOWS}[field]
    with pytest.raises(FieldError) as caught:
        kind(path="/World/Lamp", **{field: "soft"})
    assert str(caught.value) == f"/World/Lamp: {field} is soft; allowed: {', '.join(allowed)}"


@pytest.mark.parametrize("name", ["hard", "pcf_grid", "pcf_disk", "pcf_disk_view", "pcss", "exact", "area"])
@pytest.mark.parametrize("place", [(0, 1.5, 0), (0, 2.0, 0), (0, 0, 0)])
def test_light_in_on_and_under_meshes(name, place):
    """From inside a closed ball and from its pole, whose downward rays pass through it, no light reaches the floor."""
    lamp = ws.PointLight(path="/World/Lamp", transform=at(*place), intensity=10.0, radius=0.02)
    frame = ws.Simulation(_shaded(lamp, shadow_filter=name, shadow_map_size=64), threads=1).step()
    if place == (0, 0, 0):  # no light reaches the floor, and nothing can shadow it
        assert frame.pictures["/World/Floor", "lit"].max() == 0
        return
    assert frame.pictures["/World/Floor", "visibility"].max() == 0


@pytest.mark.parametrize("kind", ["centre", "cell", "corner", "side"])
def test_light_inside_smoke(kind):
    """At the domain's centre, at a cell's, on a corner and on a side: the light grid and the floor are finite."""
    place = {"centre": (0, 1, 0), "cell": (0.0625, 1.0625, 0.0625), "corner": (1, 2, 1), "side": (1, 1, 0)}[kind]
    scene, beside = plume(grids=("density", "light")), replace(BALL, transform=at(2, 0.6, 0))
    lamp = ws.PointLight(path="/World/Lamp", transform=at(*place), intensity=10.0, radius=0.02)
    simulation = ws.Simulation(replace(scene, surfaces=[floor(), beside], lights=[lamp]), threads=1)
    for _ in range(2):
        frame = simulation.step()
    light = frame.smoke["/World/Smoke"].light
    assert np.all(np.isfinite(light))
    assert light.max() > 0
    assert frame.pictures["/World/Floor", "lit"].max() > 0
