"""Surfaces that are seen through in pictures: blended one behind the other, with smoke between them."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scenes import at

import warp_smoke as ws
from warp_smoke.lattice import place_lattice
from warp_smoke.launch import Launcher
from warp_smoke.picture import PictureRenderer, SmokeVolume, render_picture
from warp_smoke.picture.tile import MOST_LAYERS
from warp_smoke.shading.srgb import encode_srgb_codes

CAMERA = ws.Camera(path="/World/Camera", transform=at(0, 0, 1e4), focal_length=1e5, far=1e5)
RED, GREEN, BLUE = np.eye(3)


def sheet(z, color, opacity=1.0, **fields):
    """A square of 4 × 4 units across the view at a depth, which glows and reflects nothing."""
    look = {"emissive_color": tuple(color), "diffuse_color": (0, 0, 0), "opacity": opacity, "path": f"/Glow{z:g}"}
    mesh = ws.Mesh.grid((-2, -2, z), (4, 0, 0), (0, 4, 0))
    return ws.Surface(path=f"/Sheet{z:g}".replace("-", "m"), mesh=mesh, material=ws.Material(**look | fields))


def seen(surfaces, volumes=(), size=(5, 5), **options):
    """The codes of the middle pixel, over a white background."""
    scene = ws.Scene(surfaces=surfaces, camera=CAMERA, ambient=(1, 1, 1))
    width, height = size
    return render_picture(scene, 1.0, volumes, size=size, **options)[height // 2, width // 2]


@pytest.mark.parametrize("shading", ["pixel", "vertex"])
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (2, 1, 0)])
def test_layers_are_put_over_each_other(order, shading):
    """α₁ c₁ + (1 − α₁)(α₂ c₂ + (1 − α₂)(α₃ c₃ + (1 − α₃) background)), in whatever order they stand on the stage."""
    opacities = 0.5, 0.25, 0.75
    sheets = [sheet(z, c, a) for z, c, a in zip((2, 0, -2), (RED, GREEN, BLUE), opacities, strict=True)]
    expected = np.ones(3)
    for color, opacity in reversed(list(zip((RED, GREEN, BLUE), opacities, strict=True))):
        expected = opacity * color + (1 - opacity) * expected
    found = seen([sheets[n] for n in order], shading=shading)
    np.testing.assert_array_equal(found, encode_srgb_codes(expected))


def test_nothing_is_seen_behind_an_opaque_surface():
    """What an opaque sheet hides has no part in the sum, with see-through sheets before and behind it."""
    found = seen([sheet(2, RED, 0.5), sheet(0, GREEN), sheet(-1, BLUE, 0.5)])
    np.testing.assert_array_equal(found, encode_srgb_codes(0.5 * RED + 0.5 * GREEN))


def test_the_last_layer_is_opaque():
    """Beyond the bound on layers, the last one hides what lies behind it: 1 − α to that power of it is seen."""
    opacity = 0.1
    sheets = [sheet(-z / 8, RED, opacity) for z in range(MOST_LAYERS - 1)]
    sheets += [sheet(-z / 8, GREEN, opacity) for z in range(MOST_LAYERS - 1, MOST_LAYERS + 8)]
    left = (1 - opacity) ** (MOST_LAYERS - 1)
    np.testing.assert_array_equal(seen(sheets), encode_srgb_codes((1 - left) * RED + left * GREEN))


def test_a_texture_fades_to_a_hole(tmp_path):
    """The shares of an opacity texture blend; where it is 0 only what lies behind is seen, where it is 1 nothing."""
    codes = np.array([0, 51, 204, 255], np.uint8)
    Image.fromarray(np.repeat(codes, 8)[None].repeat(4, axis=0)).save(tmp_path / "fade.png")
    texture = ws.Texture(file=str(tmp_path / "fade.png"), channel="r")
    camera = replace(CAMERA, horizontal_aperture=40.0, vertical_aperture=40.0)  # which sees the whole sheet
    surfaces = [sheet(0, RED, opacity_texture=texture), sheet(-1, 2 * GREEN)]
    picture = render_picture(ws.Scene(surfaces=surfaces, camera=camera, ambient=(1, 1, 1)), 1.0, size=(16, 16))
    expected = [encode_srgb_codes(a * RED + (1 - a) * 2 * GREEN) for a in codes / 255]
    # The middle of each band, where texels on both sides are alike.
    np.testing.assert_array_equal(picture[8, 1::4], expected)
    np.testing.assert_array_equal(picture[8, 2::4], expected)


@pytest.mark.parametrize("z", [2.0, 0.25, -2.0])
def test_smoke_between_layers(z):
    """Smoke of depth 2 with a sheet before, in or behind it: each part of the ray dims what lies behind that part."""
    domain = ws.SmokeDomain(path="/World/Smoke", resolution=16, extinction=0.6, albedo=(0, 0, 0))
    lattice = place_lattice(ws.Scene(domains=[domain]), domain)
    volume = SmokeVolume(domain, lattice, np.ones(lattice.shape, np.float32))
    opacity, through = 0.4, lambda depth: np.exp(-0.6 * depth)
    before = np.clip(1 - z, 0, 2)  # of the smoke in −1…1
    expected = through(before) * (opacity * RED + (1 - opacity) * through(2 - before) * GREEN)
    found = seen([sheet(z, RED, opacity), sheet(-3, GREEN)], [volume]).astype(int)
    assert np.abs(found - encode_srgb_codes(expected)).max() <= 1  # float32 camera rays of 10⁴ units


def test_holes_in_blended_company():
    """An opacity threshold still cuts: below it nothing of the sheet is seen, above it nothing through it."""
    hole, wall = (sheet(1, RED, opacity, opacity_threshold=0.5) for opacity in (0.4, 0.6))
    np.testing.assert_array_equal(seen([hole, sheet(0, BLUE, 0.5)]), encode_srgb_codes(0.5 * BLUE + 0.5))
    np.testing.assert_array_equal(seen([wall, sheet(0, BLUE, 0.5)]), encode_srgb_codes(RED))


def test_opaque_scenes_pay_nothing():
    """Without such a material there is one layer, and nothing is blended; with one there are as many as are met."""
    for opacity, launches in ((1.0, (1, 0, 0)), (0.5, (3, 3, 2))):
        launcher = Launcher("cpu")
        scene = ws.Scene(surfaces=[sheet(1, RED, opacity), sheet(0, GREEN, opacity)], camera=CAMERA)
        PictureRenderer(launcher, scene, 5, 5).render(1.0)
        made = launcher.launches
        assert (made["_cast_rays"], made["_pass_surfaces"], made["_blend_behind"]) == launches


def test_tiles_make_one_picture(monkeypatch):
    """A picture in many tiles, the last of which reaches beyond it, is that in one; in rows from the top."""
    surfaces = [sheet(1, RED, 0.5), sheet(0, 0.5 * GREEN)]
    scene = ws.Scene(surfaces=surfaces, camera=replace(CAMERA, horizontal_aperture=60.0, vertical_offset=4.0))
    whole = render_picture(scene, 1.0, size=(23, 17), samples=2)
    monkeypatch.setattr("warp_smoke.picture.renderer._TILE_PIXELS", 50)
    np.testing.assert_array_equal(render_picture(scene, 1.0, size=(23, 17), samples=2), whole)
    assert len(np.unique(whole.reshape(-1, 3), axis=0)) > 2
