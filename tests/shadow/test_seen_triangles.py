"""Triangles as a light sees them: the hierarchy's depths without the hierarchy, and no ray slips through."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import shining
from scipy.spatial import ConvexHull

from warp_smoke.geometry import Mesh
from warp_smoke.launch import Launcher
from warp_smoke.scene import SpotLight
from warp_smoke.shadow import coverage
from warp_smoke.shadow.cube import CubeShadow
from warp_smoke.shadow.directional import DirectionalShadow
from warp_smoke.shadow.spot import SpotShadow

BOUNDS = [[-9, -9, -9], [9, 9, 9]]
KINDS = {"point": CubeShadow, "spot": SpotShadow, "distant": DirectionalShadow}


@pytest.fixture
def lights(point_light, distant_light):
    """A light of each kind, in the middle of BOUNDS or shining through it."""
    spot = shining((0.3, -1, 0.2))
    spot[3, :3] = 0.1, 0.2, -0.3
    fields = {"shadow_map_size": 156, "shadow_filter": "hard"}
    return {
        "point": point_light((0.1, 0.2, -0.3), **fields),
        "spot": SpotLight(path="/light", transform=spot, cone_angle=50.0, **fields),
        "distant": distant_light((0.3, -1, 0.2), **fields),
    }


def _traced(launcher, light, kind, casters):
    shadow = KINDS[kind](launcher, light, casters, BOUNDS)
    shadow.update(1.0)
    return shadow


def _soup(rng, count, size):
    """Triangles at all places and angles."""
    corners = rng.uniform(-5, 5, (count, 1, 3)) + rng.uniform(-size, size, (count, 3, 3))
    return Mesh(points=corners.reshape(-1, 3), triangles=np.arange(3 * count).reshape(-1, 3))


@pytest.mark.parametrize("cull", [False, True])
@pytest.mark.parametrize(("count", "size"), [(40, 3.0), (1000, 0.6)])
@pytest.mark.parametrize("kind", KINDS)
def test_as_the_hierarchy(launcher, cast, lights, monkeypatch, kind, count, size, cull):
    """Of any triangles each texel has the hierarchy's depth, but for the odd ray within rounding of a silhouette.

    Of many small ones some tiles hold more than are listed, and are left to the hierarchy.
    """
    light = replace(lights[kind], shadow_cull_front=cull)
    casters = cast((_soup(np.random.default_rng(1), count, size), (0, 0, 0)))
    shadow = _traced(launcher, light, kind, casters)
    listed = shadow._depths._listed.numpy()[: shadow.rays // coverage.TILE**2, 0]
    assert listed.max() > 3
    assert cull or (listed.min() == -1) == (count == 1000)
    monkeypatch.setattr(coverage, "TRIANGLES_IN_LISTS", 0)
    expected = _traced(launcher, light, kind, casters)
    assert not expected._depths.lists_triangles
    found, expected = (each._depths.depth.numpy() for each in (shadow, expected))
    assert np.mean(found < 1.0) > 0.1
    # Along a ray that grazes a triangle, rounding of the ray moves the hit by more than itself.
    assert np.mean(np.abs(found - expected) > 1e-5) < 1e-3


def test_nothing_slips_through(launcher, cast, point_light):
    """Rays from inside a closed mesh at its very corners, and all others, meet it: at corners at their distance."""
    size, rng = 48, np.random.default_rng(0)
    texels = np.column_stack([rng.integers(0, 6, 150), rng.integers(0, size, (150, 2))])
    texels = np.unique(np.vstack([texels, [(face, size // 2, size // 2) for face in range(6)]]), axis=0)
    face, row, column = texels.T
    st = (texels[:, :0:-1] + 0.5) / size * 2 - 1
    place = np.einsum("nij,ni->nj", coverage.CUBE_FRAMES[face], np.column_stack([st, np.ones(len(st))]))
    corners = 2.0 * place / np.linalg.norm(place, axis=1, keepdims=True)
    hull = ConvexHull(corners)
    mesh = Mesh(points=corners, triangles=hull.simplices)
    shadow = _traced(launcher, point_light((0, 0, 0), shadow_map_size=size), "point", cast((mesh, (0, 0, 0))))
    assert shadow._depths.lists_triangles
    depth = shadow.map.depth.numpy()
    assert depth.max() < 1.0
    np.testing.assert_allclose(depth[face, row, column] * shadow.map.far, 2.0, rtol=1e-6)


@pytest.mark.parametrize("place", [(0, 0, 0), (0.5, 0, 0.25), (1, 0, 1)])
def test_light_on_a_triangle(launcher, cast, point_light, place):
    """A light on a surface, on its edge or corner does not see it, whichever way rays go; it sees the others."""
    sheet = Mesh.grid((0, 0, 0), (1, 0, 0), (0, 0, 1))
    # Middle texels of an odd number lie in the sheet's plane.
    light = point_light(place, shadow_map_size=65)
    shadow = _traced(launcher, light, "point", cast((sheet, (0, 0, 0)), (sheet, (0, -1, 0))))
    depth = shadow.map.depth.numpy()
    assert np.all(depth[[0, 1, 4, 5], 32] == 1.0)
    np.testing.assert_array_equal(depth[2], 1.0)
    assert 0.5 / shadow.map.far < depth[3].min() < 1.0


@pytest.mark.usefixtures("divided_launches")
@pytest.mark.parametrize("kind", KINDS)
def test_same_bits_for_any_number_of_threads(cast, lights, kind):
    """1, 2 and 7 threads list and trace bit-equal maps."""
    light, casters = (
        replace(lights[kind], shadow_map_size=67),
        cast((Mesh.box(8.0), (0, 1, 0)), (Mesh.box(1), (1, -2, 0))),
    )
    maps = [_traced(Launcher("cpu", n), light, kind, casters)._depths.depth.numpy().copy() for n in (1, 2, 7)]
    np.testing.assert_array_equal(maps[1], maps[0])
    np.testing.assert_array_equal(maps[2], maps[0])
    assert maps[0].min() < 1.0
