"""What is behind a see-through surface, as drawn: VTK mixes codes of sRGB, a · front + (1 − a) · behind."""

import numpy as np
import pytest
from PIL import Image

import warp_smoke as ws
from warp_smoke.preview.surfaces import SurfaceActor

SQUARE = ws.Mesh.grid((-1, -1, 0), (2, 0, 0), (0, 2, 0))
WALL = ws.Surface(
    path="/Wall",
    mesh=ws.Mesh.grid((-1, -1, -1), (2, 0, 0), (0, 2, 0)),
    material=ws.Material(path="/White", diffuse_color=(1, 1, 1)),
)
RED, GREEN, WHITE = np.array((255, 0, 0)), np.array((0, 255, 0)), np.array((255, 255, 255))
LIGHT = np.ones(3)  # ambient: a material shows its diffuse colour


def _seen(open_plotter, material, show=lambda actor: None):
    """Colours in the middle of each quarter of a square before a white wall, [2, 2, 3], top row first."""
    plotter = open_plotter((64, 64))
    front = SurfaceActor(ws.Surface(path="/Glass", mesh=SQUARE, material=material), LIGHT, 1.0)
    show(front)
    for actor in (front, SurfaceActor(WALL, LIGHT, 1.0)):
        actor.place(1.0)
        plotter.add_actor(actor.actor)
    plotter.camera.parallel_projection = True
    plotter.camera_position = [(0, 0, 5), (0, 0, 0), (0, 1, 0)]
    plotter.camera.parallel_scale = 1.0
    return plotter.screenshot(None, return_img=True).astype(int)[16::32, 16::32]


def _saved(path, pixels):
    """A picture of 2 × 2 texels, each a quarter of 16 × 16, as a texture."""
    pixels = np.asarray(pixels, np.uint8)
    Image.fromarray(np.kron(pixels, np.ones((16, 16, *[1] * (pixels.ndim - 2)), np.uint8))).save(path)
    return str(path)


def _red(**look):
    return ws.Material(path="/Red", diffuse_color=(1, 0, 0), **look)


@pytest.mark.parametrize("opacity", [0.0, 0.25, 0.7, 1.0])
def test_plain_opacity(open_plotter, opacity):
    """One number for all of it; 0 is not there, 1 hides all."""
    seen = _seen(open_plotter, _red(opacity=opacity))
    np.testing.assert_allclose(seen, np.full((2, 2, 3), opacity * RED + (1 - opacity) * WHITE), atol=1)


@pytest.mark.parametrize(("opacity", "expected"), [(0.4, WHITE), (0.6, RED)])
def test_plain_opacity_with_a_threshold(open_plotter, opacity, expected):
    """Below the threshold the whole surface is a hole, from it on it hides all."""
    seen = _seen(open_plotter, _red(opacity=opacity, opacity_threshold=0.5))
    np.testing.assert_array_equal(seen, np.full((2, 2, 3), expected))


def test_holes_of_a_colour_texture(open_plotter, tmp_path):
    """A texture whose own alpha says where its holes are: what is behind is seen whole there."""
    file = _saved(tmp_path / "leaf.png", [[(*GREEN, 255), (*GREEN, 40)], [(*GREEN, 100), (*GREEN, 200)]])
    color, alpha = ws.Texture(file=file, color_space="sRGB"), ws.Texture(file=file, channel="a")
    leaf = ws.Material(path="/Leaf", diffuse_texture=color, opacity_texture=alpha, opacity_threshold=0.5)
    np.testing.assert_array_equal(_seen(open_plotter, leaf), [[GREEN, WHITE], [WHITE, GREEN]])


def test_an_opacity_texture_over_a_plain_colour(open_plotter, tmp_path):
    """Grey of another file, scaled and moved by the texture, and turned as its coordinates are."""
    file = _saved(tmp_path / "mask.png", [[0, 51], [102, 255]])
    texture = ws.Texture(file=file, channel="r", scale=(0.5,) * 4, bias=(0.5, 0, 0, 0), uv_scale=(-1, -1))
    shares = np.array([[1.0, 0.7], [0.6, 0.5]])[..., None]  # turned by 180°
    expected = shares * RED + (1 - shares) * WHITE
    np.testing.assert_allclose(_seen(open_plotter, _red(opacity_texture=texture)), expected, atol=1)


def test_an_opacity_texture_that_lies_otherwise(open_plotter, tmp_path):
    """VTK lays colours and opacity in one way: where the material does not, the texture's mean is taken."""
    file = _saved(tmp_path / "mask.png", [[0, 51], [102, 255]])
    checker = ws.Procedural(kind="checker", color1=(1.0, 0.0, 0.0), color2=(0.0, 1.0, 0.0), repeats=2)
    texture = ws.Texture(file=file, channel="r", uv_scale=(2, 2))
    seen = _seen(open_plotter, ws.Material(path="/Tiles", procedural=checker, opacity_texture=texture))
    tiles = np.array([[GREEN, RED], [RED, GREEN]])
    np.testing.assert_allclose(seen, 0.4 * tiles + 0.6 * WHITE, atol=2)  # 0, 0.2, 0.4 and 1 on average


@pytest.mark.parametrize("stops", [0.0, 1.0])
def test_baked_pictures_keep_their_alpha(open_plotter, stops):
    """A bake holds the opacity of its surface as alpha, which an exposure leaves alone."""
    pixels = np.full((8, 8, 4), (40, 80, 60, 64), np.uint8)
    plain = _seen(open_plotter, _red(), lambda actor: actor.show_picture(pixels[..., :3], stops))
    seen = _seen(open_plotter, _red(), lambda actor: actor.show_picture(pixels, stops))
    share = 64 / 255
    np.testing.assert_allclose(seen, share * plain + (1 - share) * WHITE, atol=1)


def test_baked_colors_keep_the_opacity(open_plotter):
    """Colours at the points are as opaque as the material."""
    colors = np.array([(0.0, 1.0, 0.0)] * 4, np.float32)
    seen = _seen(open_plotter, _red(opacity=0.25), lambda actor: actor.show_colors(colors))
    np.testing.assert_allclose(seen, np.full((2, 2, 3), 0.25 * GREEN + 0.75 * WHITE), atol=1)


def test_an_opaque_material_follows_a_see_through_one(open_plotter):
    """The opacity of what was shown before is forgotten."""
    seen = _seen(open_plotter, _red(opacity=0.25), lambda actor: actor.show_material(_red(), LIGHT))
    np.testing.assert_array_equal(seen, np.full((2, 2, 3), RED))
