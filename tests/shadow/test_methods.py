"""The tables of shadow methods: what the scene may ask for, behind one signature each."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from warp_smoke import scene
from warp_smoke.geometry import Mesh
from warp_smoke.scene import DistantLight, SpotLight
from warp_smoke.shadow.methods import SMOKE_SHADOWS, SURFACE_SHADOWS


def test_every_method_of_the_scene_is_there():
    """The scene's tokens for smoke shadows are the table's."""
    assert set(SMOKE_SHADOWS) == set(scene.SMOKE_SHADOWS)


@pytest.mark.parametrize("method", SMOKE_SHADOWS)
def test_smoke_shadows_share_a_signature(launcher, lattice_at, distant_light, transmittance, method):
    """Each is made, updated and looked up alike, and darkens a point straight behind thin smoke by the same amount."""
    lattice = lattice_at((8, 8, 8))
    light = replace(distant_light((0, -1, 0)), smoke_shadow=method)
    shadow = SMOKE_SHADOWS[method](launcher, lattice, light, np.zeros(3), 0.001)
    shadow.update(wp.full((8, 8, 8), 1.0, dtype=float, device=launcher.device), 1.0)
    # e^(−0.008), of which the paper's opacity is the first two terms.
    np.testing.assert_allclose(transmittance(shadow, points=[[0.1, -6, 0.2]]), np.exp(-0.008), atol=4e-5)


@pytest.mark.parametrize("method", SMOKE_SHADOWS)
def test_coloured_smoke(launcher, lattice_at, distant_light, transmittance, device, method):
    """Each channel is that of grey smoke with σ times the colour; one channel takes the first."""
    lattice, color = lattice_at((8, 8, 8)), (0.2, 1.0, 1.7)
    density = wp.array(np.random.default_rng(0).random((8, 8, 8)), dtype=float, device=device)
    points = np.random.default_rng(1).uniform((-6, -9, -6), (6, -5, 6), (300, 3))
    light = replace(distant_light((0.2, -1, 0.1)), smoke_shadow=method)

    def made(extinction, *color):
        shadow = SMOKE_SHADOWS[method](launcher, lattice, light, np.zeros(3), extinction, *color)
        shadow.update(density, 1.0)
        return shadow

    out = wp.full((3, 300), 1.0, dtype=float, device=device)
    made(0.2, color).transmittance(wp.array(points, dtype=wp.vec3, device=device), out)
    for channel, share in zip(out.numpy(), color, strict=True):
        np.testing.assert_allclose(channel, transmittance(made(0.2 * share), points=points), rtol=1e-5)
    assert np.ptp(out.numpy()) > 0.5


@pytest.mark.parametrize("method", SURFACE_SHADOWS)
def test_surface_shadows_share_a_signature(launcher, cast, point_light, distant_light, visibility, method):
    """Each is made, updated and looked up alike; a sky far around the set takes nothing from a millimetre's shadow."""
    table = (Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2)), (0, 0, 0))
    crumb = (Mesh.grid((-0.1, 0, 0.1), (0.2, 0, 0), (0, 0, -0.2)), (0, 1e-3, 0))
    light = distant_light((0, -1, 0)) if method == "directional" else point_light((0, 3, 0))
    if method == "spot":
        down = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 3, 0, 1]]
        light = SpotLight(path="/light", transform=down, cone_angle=30.0, shadow_filter="hard")
    sky = (Mesh.sphere(1e4), (0, 0, 0))
    for around in ((), (sky,)):
        if around and isinstance(light, DistantLight):
            continue  # the sky stands between the set and a distant light
        casters = cast(table, crumb, *around)
        shadow = SURFACE_SHADOWS[method](launcher, light, casters, [[-1, 0, -1], [1, 0, 1]])
        shadow.update(1.0)
        lit = visibility(shadow, [[0, 0, 0], [0.05, 0, -0.05], [0.5, 0, 0.5]], (0, 1, 0))
        np.testing.assert_array_equal(lit, [0, 0, 1])
