"""Meshes as drawn: baked pictures byte for byte and the right way up, materials under lights as the formulas say."""

import numpy as np
import pytest
from PIL import Image
from scenes import at, shining

import warp_smoke as ws
from warp_smoke.preview.color import linear_to_srgb
from warp_smoke.preview.lights import set_lights
from warp_smoke.preview.surfaces import SurfaceActor

# A square of 2 units in the plane z = 0 that faces +z, with u to the right and v up.
SQUARE = ws.Mesh.grid((-1, -1, 0), (2, 0, 0), (0, 2, 0))
CORNERS = np.array([[(250, 10, 20), (30, 240, 40)], [(50, 60, 230), (200, 190, 70)]], np.uint8)


def _draw(open_plotter, surface, lights=(), ambient=(0, 0, 0), show=lambda actor: None, size=(64, 64)):
    """The square seen from the front, filling the picture."""
    plotter = open_plotter(size)
    actor = SurfaceActor(surface, np.asarray(ambient, float), 1.0)
    actor.place(1.0)
    show(actor)
    plotter.add_actor(actor.actor)
    set_lights(plotter, lights, 1.0)
    plotter.camera.parallel_projection = True
    plotter.camera_position = [(0, 0, 5), (0, 0, 0), (0, 1, 0)]
    plotter.camera.parallel_scale = 1.0
    return plotter.screenshot(None, return_img=True).astype(int)


def _quarters(picture):
    """The colours in the middle of each quarter, [2, 2, 3]."""
    h, w = picture.shape[:2]
    return picture[h // 4 :: h // 2, w // 4 :: w // 2]


def test_baked_picture_is_the_right_way_up_and_unchanged(open_plotter):
    """The picture's first row is at v = 1, its first column at u = 0, and its bytes reach the screen as they are."""
    pixels = np.kron(CORNERS, np.ones((16, 16, 1), np.uint8))
    surface = ws.Surface(path="/Square", mesh=SQUARE)
    lamp = ws.DistantLight(path="/Sun", intensity=5.0)
    seen = _draw(open_plotter, surface, [lamp], (1, 1, 1), lambda actor: actor.show_picture(pixels))
    np.testing.assert_array_equal(_quarters(seen), CORNERS)


@pytest.mark.parametrize("stops", [0.0, 1.0])
def test_pictures_of_16_bits_and_with_alpha(open_plotter, stops):
    """They are drawn as those of 8 bits without alpha, whatever the exposure, where alpha hides all."""
    pixels = np.kron(CORNERS, np.ones((16, 16, 1), np.uint8))
    opaque = np.dstack([pixels, np.full(pixels.shape[:2], 255, np.uint8)])
    surface = ws.Surface(path="/Square", mesh=SQUARE)
    seen = [
        _draw(open_plotter, surface, show=lambda actor, each=each: actor.show_picture(each, stops))
        for each in (pixels, pixels * np.uint16(257), opaque)
    ]
    np.testing.assert_array_equal(seen[0], seen[1])
    np.testing.assert_array_equal(seen[0], seen[2])


def test_pictures_lie_over_the_coordinates_of_the_bake(open_plotter):
    """On a mesh whose coordinates repeat, a baked picture covers it once; its own texture goes on repeating."""
    pixels = np.kron(CORNERS, np.ones((16, 16, 1), np.uint8))
    mesh = ws.Mesh(SQUARE.points, SQUARE.triangles, SQUARE.normals, 3 * SQUARE.uvs - 1)
    surface = ws.Surface(path="/Square", mesh=mesh, receiver=ws.Receiver(path="/Square"))
    seen = _draw(open_plotter, surface, show=lambda actor: actor.show_picture(pixels))
    np.testing.assert_array_equal(_quarters(seen), CORNERS)


def test_next_picture_replaces_the_last(open_plotter):
    """The picture shown last is the one drawn."""
    first, second = (np.full((4, 4, 3), grey, np.uint8) for grey in (40, 90))
    surface = ws.Surface(path="/Square", mesh=SQUARE)
    seen = _draw(open_plotter, surface, show=lambda actor: (actor.show_picture(first), actor.show_picture(second)))
    assert np.unique(seen).tolist() == [90]


def test_baked_colors_at_points(open_plotter):
    """Linear colours at the points are drawn in sRGB, unlit, and mixed between the points."""
    colors = np.array([[0.2, 0.4, 0.8]] * 4, np.float32)
    surface = ws.Surface(path="/Square", mesh=SQUARE)
    seen = _draw(open_plotter, surface, show=lambda actor: actor.show_colors(colors))
    np.testing.assert_array_equal(seen[32, 32], linear_to_srgb(colors[0]))


def test_texture_is_the_right_way_up_and_lit_in_linear_light(open_plotter, tmp_path):
    """A diffuse texture is decoded, lit and encoded: under ambient light ½ each quarter shows half its linear value."""
    Image.fromarray(np.kron(CORNERS, np.ones((16, 16, 1), np.uint8))).save(tmp_path / "corners.png")
    texture = ws.Texture(file=str(tmp_path / "corners.png"), color_space="sRGB")
    surface = ws.Surface(path="/Square", mesh=SQUARE, material=ws.Material(diffuse_texture=texture))
    seen = _draw(open_plotter, surface, ambient=(0.5, 0.5, 0.5))
    encoded = CORNERS / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(_quarters(seen), linear_to_srgb(0.5 * linear).astype(int), atol=1)


def test_textures_are_scaled_turned_and_moved(open_plotter, tmp_path):
    """Scaled by −1, turned by 90° and moved by 1 along v, (u, v) reads (v, 1 − u): turned by a quarter."""
    Image.fromarray(np.kron(CORNERS, np.ones((16, 16, 1), np.uint8))).save(tmp_path / "corners.png")
    place = {"uv_scale": (-1.0, -1.0), "uv_rotation": 90.0, "uv_translation": (0.0, 1.0)}
    texture = ws.Texture(file=str(tmp_path / "corners.png"), color_space="sRGB", **place)
    surface = ws.Surface(path="/Square", mesh=SQUARE, material=ws.Material(diffuse_texture=texture))
    seen = _quarters(_draw(open_plotter, surface, ambient=(1, 1, 1)))
    np.testing.assert_allclose(seen, np.rot90(CORNERS.astype(int)), atol=1)


def test_computed_pictures(open_plotter):
    """A checker of two squares along a side is drawn in its two colours, the first where u and v are 0."""
    checker = ws.Procedural(kind="checker", color1=(1.0, 0.0, 0.0), color2=(0.0, 0.0, 1.0), repeats=2, size=8192)
    surface = ws.Surface(path="/Square", mesh=SQUARE, material=ws.Material(procedural=checker))
    seen = _quarters(_draw(open_plotter, surface, ambient=(1, 1, 1)))
    red, blue = (255, 0, 0), (0, 0, 255)
    np.testing.assert_array_equal(seen, [[blue, red], [red, blue]])


def test_matte_surface_under_a_distant_light(open_plotter):
    """Intensity I at 60° from the normal gives albedo · I/π · ½, emission is added, and the sum is encoded in sRGB."""
    material = ws.Material(diffuse_color=(0.5, 0.25, 0.8), emissive_color=(0.0, 0.1, 0.0))
    surface = ws.Surface(path="/Square", mesh=SQUARE, material=material)
    sun = ws.DistantLight(path="/Sun", transform=shining((np.sqrt(3), 0, -1)), intensity=2.0)
    seen = _draw(open_plotter, surface, [sun])
    expected = linear_to_srgb(np.array([0.5, 0.25, 0.8]) * 2 / np.pi / 2 + [0, 0.1, 0])
    np.testing.assert_allclose(seen[32, 32], expected.astype(int), atol=1)


@pytest.mark.parametrize("falloff", [{}, {"falloff_model": "polynomial", "attenuation": (0.5, 0.25, 0.125)}])
def test_matte_surface_under_a_point_light(open_plotter, falloff):
    """Each pixel shows albedo · I/(4π) · falloff(d) · cos θ, whatever the mesh: one quad is enough."""
    material = ws.Material(diffuse_color=(0.5, 0.5, 0.5))
    surface = ws.Surface(path="/Square", mesh=SQUARE, material=material)
    lamp = ws.PointLight(path="/Lamp", transform=at(0.5, 0.25, 1.0), intensity=10.0, **falloff)
    seen = _draw(open_plotter, surface, [lamp])
    y, x = (np.indices((64, 64)) + 0.5) / 32 - 1
    d = np.sqrt((x - 0.5) ** 2 + (-y - 0.25) ** 2 + 1)
    share = 1 / d**2 if not falloff else 1 / (0.5 + 0.25 * d + 0.125 * d**2)
    expected = linear_to_srgb(0.5 * 10 / (4 * np.pi) * share / d)
    np.testing.assert_allclose(seen[..., 0], expected.astype(int), atol=1)


def test_moved_and_hidden(open_plotter):
    """A mesh is drawn where its transform puts it at a time code, and not where it is invisible."""
    times = np.array([1.0, 2.0])
    moved = ws.Samples(times, np.array([at(0, 0, 0), at(1, 0, 0)]))
    hidden = ws.Samples(np.array([1.0, 3.0]), np.array([True, False]))
    surface = ws.Surface(path="/Square", mesh=SQUARE, transform=moved, visible=hidden)
    middle = []
    for time in (1.0, 2.0, 3.0):
        seen = _draw(open_plotter, surface, ambient=(1, 1, 1), show=lambda actor, time=time: actor.place(time))
        middle.append((seen[32, 16, 0] > 0, seen[32, 48, 0] > 0))
    assert middle == [(True, True), (False, True), (False, False)]
