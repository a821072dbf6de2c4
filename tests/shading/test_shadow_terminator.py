"""Shadows on smooth-shaded meshes: neither facets nor specks on what the light faces, and all shadows of others."""

import numpy as np
import pytest
from scenes import at, shining

import warp_smoke as ws
from warp_smoke.geometry import corner_normals
from warp_smoke.picture import render_picture
from warp_smoke.scene import DistantLight, PointLight, Receiver, Surface
from warp_smoke.shading.texels import TexelMap
from warp_smoke.shadow.casters import Casters
from warp_smoke.shadow.methods import SURFACE_SHADOWS

BALL = ws.Mesh.sphere(1.0, 24)
SUN = (-0.5, -0.8, -0.4)
BOUNDS = np.array([[-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]])
# What looks shadows up: a filter, and the light and the map that it is of; fixed patterns are wider than a penumbra.
LOOKS = [("exact", "exact"), ("area", "area"), ("pcss", "directional"), ("hard", "directional"), ("pcss", "cube")]
FIXED = [(name, method) for name in ("pcf_grid", "pcf_disk") for method in ("directional", "cube")]


def texels_of(launcher, mesh, size=128):
    """The texels of a mesh where it lies."""
    texels = TexelMap(launcher, Surface(path="/S", mesh=mesh, receiver=Receiver(path="/S", texture_size=size)), 0.0)
    texels.update(1.0)
    return texels


def look(launcher, texels, method, shadow_filter, *meshes):
    """Visibility of the texels past some meshes, and the cosine between normal and light, [n] each."""
    fields = {"path": "/L", "shadow_filter": shadow_filter, "shadow_map_size": 512}
    if method == "cube":
        light = PointLight(transform=at(*(-4.0 * np.array(SUN))), radius=0.02, **fields)
        to_light = light.position_at(1.0) - texels.points.numpy()
    else:
        light = DistantLight(transform=shining(SUN), angle=0.5, **fields)
        to_light = -light.direction_at(1.0)
    casters = Casters(launcher, [Surface(path=f"/{n}", mesh=mesh) for n, mesh in enumerate(meshes)], np.zeros(3))
    casters.update(1.0)
    shadow = SURFACE_SHADOWS[method](launcher, light, casters, BOUNDS)
    shadow.update(1.0)
    visibility = launcher.zeros(texels.count, "test")
    shadow.visibility(texels.shadow_points, texels.normals, visibility, texels.facets)
    cosine = np.sum(to_light * texels.normals.numpy(), axis=1) / np.linalg.norm(np.atleast_2d(to_light), axis=1)
    return visibility.numpy(), cosine


@pytest.mark.parametrize("segments", [8, 24, 96])
def test_lifted_points_of_a_sphere(launcher, segments):
    """On a unit sphere Σ wᵢ |dᵢ| = 1 − |p|²: points come to lie above it by no more than facets lie below it, O(h²)."""
    texels = texels_of(launcher, ws.Mesh.sphere(1.0, segments))
    below = 1.0 - np.linalg.norm(texels.points.numpy(), axis=1)
    above = np.linalg.norm(texels.shadow_points.numpy(), axis=1) - 1.0
    h = 2 * np.pi / segments
    assert 0.2 * h**2 < below.max() < h**2
    assert above.min() > -1e-6
    assert np.all(above <= below + 1e-6)


@pytest.mark.parametrize(("shadow_filter", "method"), LOOKS + FIXED)
def test_a_ball_does_not_shadow_itself(launcher, shadow_filter, method):
    """No texel of a ball of 24 × 12 facets that the light faces is in shadow; from the facets' points many are."""
    texels = texels_of(launcher, BALL)
    visibility, cosine = look(launcher, texels, method, shadow_filter, BALL)
    np.testing.assert_array_equal(visibility[cosine > 0.1], 1.0)
    np.testing.assert_array_equal(visibility[cosine < -0.005], 0.0)  # the sun is 0.0044 to each side
    texels.shadow_points, texels.facets = texels.points, texels.normals
    unlifted, _ = look(launcher, texels, method, shadow_filter, BALL)
    assert np.count_nonzero(unlifted[cosine > 0.1] < 1.0) >= 10


@pytest.mark.parametrize(("shadow_filter", "method"), LOOKS)
def test_a_ball_in_the_shadow_of_a_plate(launcher, shadow_filter, method):
    """Half of a ball is dark behind a plate across the light, and the rest lit, but for the width of a penumbra."""
    towards = -np.array(SUN) / np.linalg.norm(SUN)
    right = np.cross(towards, (0, 1, 0)) / np.linalg.norm(np.cross(towards, (0, 1, 0)))
    plate = ws.Mesh.grid(1.2 * towards - 2 * np.cross(towards, right), 2 * right, 4 * np.cross(towards, right))
    texels = texels_of(launcher, BALL)
    visibility, cosine = look(launcher, texels, method, shadow_filter, BALL, plate)
    side, faced = texels.shadow_points.numpy() @ right, cosine > 0.1
    np.testing.assert_array_equal(visibility[faced & (side > 0.04)], 0.0)
    np.testing.assert_array_equal(visibility[faced & (side < -0.04)], 1.0)


def _bowl():
    """A hollow y = (x² + z²) / 4 over a square of 12 × 12 cells, with smooth normals."""
    grid = ws.Mesh.grid((-1, 0, 1), (2, 0, 0), (0, 0, -2), 12)
    points = np.array(grid.points_at(1.0), float)
    points[:, 1] = 0.25 * (points[:, 0] ** 2 + points[:, 2] ** 2)
    return ws.Mesh(points, grid.triangles, corner_normals(points, grid.triangles, smooth=True), grid.uvs)


@pytest.mark.parametrize(("shadow_filter", "method"), LOOKS)
def test_a_bowl_stays_in_place(launcher, shadow_filter, method):
    """Points of a hollow are not lifted, and those of one too shallow to shadow itself are lit."""
    bowl = _bowl()
    texels = texels_of(launcher, bowl)
    np.testing.assert_allclose(texels.shadow_points.numpy(), texels.points.numpy(), atol=1e-6)
    visibility, _ = look(launcher, texels, method, shadow_filter, bowl)
    if method in ("exact", "area"):
        np.testing.assert_array_equal(visibility, 1.0)
    # Facets next to a point's rise above its plane: a map's texel or two at creases may count for it.
    assert np.mean(visibility) > 0.9999


def test_flat_meshes_are_looked_up_where_they_are(launcher):
    """Points of boxes, patches and faceted balls are themselves, to the bit; so they are where normals are equal."""
    tilted = ws.Mesh.grid((0, 0, 0), (1, 0.3, 0), (0, 0.2, -1), 4)
    faceted = ws.Mesh(BALL.points, BALL.triangles, uvs=BALL.uvs)
    equal = ws.Mesh(tilted.points, tilted.triangles, corner_normals(tilted.points, tilted.triangles, True), tilted.uvs)
    for mesh in (tilted, ws.Mesh.box(), faceted, equal):
        texels = texels_of(launcher, mesh, 16)
        assert texels.shadow_points is texels.points
        assert texels.facets is texels.normals


def test_the_picture_of_a_ball():
    """A ball alone casts no shadow that can be seen: its picture is that without shadows, to one step of 8 bits."""
    pictures = []
    for shadow in (True, False):
        light = DistantLight(path="/L", transform=shining(SUN), intensity=2.0, shadow_enable=shadow)
        camera = ws.Camera(path="/C", transform=at(0, 0, 5))
        scene = ws.Scene(surfaces=[Surface(path="/S", mesh=BALL)], lights=[light], camera=camera)
        pictures.append(render_picture(scene, 1.0, size=(160, 120)).astype(int))
    assert pictures[0].max() > 100
    assert np.abs(pictures[0] - pictures[1]).max() <= 1
