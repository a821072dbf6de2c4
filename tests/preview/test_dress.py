"""Meshes whose faces have materials of their own, as drawn: each in its own, or all of it in its baked light."""

import numpy as np
from PIL import Image

import warp_smoke as ws
from warp_smoke.preview.dress import DressedSurface

# A square of 2 units in the plane z = 0 that faces +z; its triangles 0…3 are the left half.
SQUARE = ws.Mesh.grid((-1, -1, 0), (2, 0, 0), (0, 2, 0), 2)
GREY = ws.Material(path="/Grey", diffuse_color=(0.2, 0.2, 0.2))
LIGHT = np.ones(3)  # ambient: a material shows its diffuse colour
RED, GREEN, BLUE = 255 * np.eye(3, dtype=int)


def _halves(plotter):
    """Colours in the middle of the square's halves, seen from the front."""
    plotter.camera.parallel_projection = True
    plotter.camera_position = [(0, 0, 5), (0, 0, 0), (0, 1, 0)]
    plotter.camera.parallel_scale = 1.0
    plotter.render()
    picture = plotter.screenshot(None, return_img=True).astype(int)
    return picture[32, [16, 48]]


def _dressed(open_plotter, surface):
    plotter = open_plotter((64, 64))
    dressed = DressedSurface(surface, LIGHT, 1.0)
    for actor in dressed.actors:
        plotter.add_actor(actor)
    dressed.place(1.0)
    return plotter, dressed


def test_faces_have_their_own_materials(open_plotter, tmp_path):
    """Where the mesh has no material, its subsets show theirs, a colour or a texture, and other faces the default."""
    Image.fromarray(np.full((2, 2, 3), GREEN, np.uint8)).save(tmp_path / "green.png")
    texture = ws.Texture(file=str(tmp_path / "green.png"), color_space="sRGB")
    red = ws.Material(path="/Red", diffuse_color=(1, 0, 0))
    green = ws.Material(path="/Green", diffuse_texture=texture)
    for materials, expected in (((red, green), (RED, GREEN)), ((red,), (RED, None))):
        triangles = [0, 1, 2, 3], [4, 5, 6, 7]
        subsets = [
            ws.MaterialSubset(path=f"/Square/S{n}", triangles=which, material=material)
            for n, (which, material) in enumerate(zip(triangles, materials, strict=False))
        ]
        plotter, dressed = _dressed(open_plotter, ws.Surface(path="/Square", mesh=SQUARE, subsets=subsets))
        dressed.show_own(GREY, LIGHT, 0.0)
        left, right = _halves(plotter)
        np.testing.assert_array_equal(left, expected[0])
        if expected[1] is None:
            assert right.min() == right.max() > 0  # the default grey
        else:
            np.testing.assert_array_equal(right, expected[1])


def test_baked_light_is_in_one_piece(open_plotter):
    """A baked picture covers all of it in one piece, and materials come back after it; nothing is drawn twice."""
    blue = ws.Material(path="/Blue", diffuse_color=(0, 0, 1))
    subset = ws.MaterialSubset(path="/Square/Left", triangles=[0, 1, 2, 3], material=blue)
    red = ws.Material(path="/Red", diffuse_color=(1, 0, 0))
    plotter, dressed = _dressed(open_plotter, ws.Surface(path="/Square", mesh=SQUARE, material=red, subsets=[subset]))
    pixels = np.repeat([[GREEN, RED]], 2, axis=0).repeat(8, axis=0).repeat(8, axis=1).astype(np.uint8)
    for _ in range(2):
        dressed.place(1.0)
        dressed.show_own(GREY, LIGHT, 0.0)
        np.testing.assert_array_equal(_halves(plotter), [BLUE, RED])
        dressed.place(1.0)
        dressed.show_picture(pixels, 0.0)
        np.testing.assert_array_equal(_halves(plotter), [GREEN, RED])
        dressed.place(1.0)
        dressed.show_material(GREY, LIGHT, 0.0)
        left, right = _halves(plotter)
        np.testing.assert_array_equal(left, right)
    assert sum(bool(actor.visibility) for actor in dressed.actors) == 1
