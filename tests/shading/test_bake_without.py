"""What stands in for a camera, a material or texture coordinates that a bake has to do without."""

from dataclasses import replace

import numpy as np
import pytest
from lit_floor import LAMP, ORIGIN, SIZE, SUN, floor, lamp_terms, srgb
from PIL import Image

from warp_smoke.geometry import Mesh
from warp_smoke.scene import Material, Texture
from warp_smoke.shading.bake import ReceiverBake
from warp_smoke.shading.texels import TexelMap
from warp_smoke.shading.vertices import VertexMap


def test_no_camera(launcher):
    """Without a camera highlights are left out, with a note, even for a mirror."""
    shiny = Material(path="/M", diffuse_color=(0.5, 0.5, 0.5), fresnel_r0=(1, 1, 1), roughness=0.5)
    bake = ReceiverBake(launcher, floor(material=shiny), [SUN], ORIGIN, bakes=["lit"])
    bake.update(1.0)
    np.testing.assert_array_equal(bake.picture("lit")[0, 0], np.round(srgb(0.75 / np.pi * np.array([0.3, 0.5, 1.0]))))
    assert bake.warnings == ("/Floor: no camera to see highlights from; the bake has diffuse light only",)


def test_default_material(launcher):
    """A surface without a material reflects 18 %."""
    bake = ReceiverBake(launcher, floor(), [], ORIGIN, bakes=["lit"], ambient=(1, 1, 1))
    bake.update(1.0)
    np.testing.assert_array_equal(bake.picture("lit"), 118)


PLAIN = Mesh.grid((-2, 0, 2), (4, 0, 0), (0, 0, -4), 4)


@pytest.mark.parametrize(
    ("uvs", "message"),
    [
        (None, "/Floor: no texture coordinates; colours at its 25 points are baked instead of a texture"),
        (
            PLAIN.uvs % 0.75 * 8,
            "/Floor: texture coordinates reach over 0…4 and overlap in 1024 of 1024 texels; "
            "colours at its 25 points are baked instead of a texture",
        ),
        (PLAIN.uvs * np.float32(np.nan), "/Floor: texture coordinates are not finite"),
        (PLAIN.uvs * 0, "/Floor: texture coordinates cover no area"),
    ],
)
def test_points_instead_of_texels(launcher, uvs, message):
    """Without texture coordinates that can hold a picture, linear colours at the points, and a warning."""
    surface = floor(mesh=Mesh(PLAIN.points, PLAIN.triangles, uvs=uvs))
    bake = ReceiverBake(launcher, surface, [LAMP], ORIGIN, bakes=["lit", "smokeShadow"], smoke_shadowed=["/Lamp"])
    assert isinstance(bake.map, VertexMap)
    assert bake.warnings[0].startswith(message)
    bake.update(1.0)
    bake.transmittance["/Lamp"].fill_(0.25)
    np.testing.assert_allclose(bake.picture("lit"), 0.25 * 0.18 * lamp_terms(PLAIN.points)[1], rtol=1e-5)
    np.testing.assert_allclose(bake.picture("smokeShadow"), 0.25)


def test_texture_without_coordinates(launcher):
    """A textured material on a mesh without texture coordinates shows its plain colour, and says so."""
    material = Material(path="/M", diffuse_color=(0.5, 0.25, 1.0), diffuse_texture=Texture(file="/nowhere.png"))
    surface = floor(mesh=Mesh(PLAIN.points, PLAIN.triangles), material=material)
    bake = ReceiverBake(launcher, surface, [], ORIGIN, bakes=["lit"], ambient=(1, 1, 1))
    bake.update(1.0)
    np.testing.assert_allclose(bake.picture("lit"), np.tile([0.5, 0.25, 1.0], (25, 1)))
    assert "/Floor: the textures of /M have no coordinates; its colours are used" in bake.warnings


@pytest.mark.parametrize(("scale", "moved"), [((8, 8), (0, 0)), ((3, 1), (-1, 0)), ((1, 1), (4, 2)), ((-2, 2), (1, 0))])
def test_coordinates_outside_the_unit_square(launcher, tmp_path, scale, moved):
    """Repeated, tiled, moved or mirrored coordinates give the picture of those in the square; textures keep theirs."""
    codes = np.random.default_rng(2).integers(0, 256, (8, 8, 3)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "noise.png")
    texture = Texture(file=str(tmp_path / "noise.png"))
    uvs = (PLAIN.uvs * scale + moved).astype(np.float32)
    pictures = []
    for mesh, look in (
        (Mesh(PLAIN.points, PLAIN.triangles, uvs=uvs), texture),
        (PLAIN, replace(texture, uv_scale=scale, uv_translation=moved)),
    ):
        bake = ReceiverBake(
            launcher, floor(mesh=mesh, material=Material(diffuse_texture=look)), [LAMP], ORIGIN, bakes=["lit"]
        )
        assert isinstance(bake.map, TexelMap)
        bake.update(1.0)
        pictures.append(bake.picture("lit").astype(int))
        assert any("primvars:st_bake" in warning for warning in bake.warnings) == (mesh is not PLAIN)
    mirrored = np.flip(pictures[1], axis=1) if scale[0] < 0 else pictures[1]
    # Float32 coordinates far from the origin move samples of a noisy texture by 1e-5 of a texel.
    assert np.abs(pictures[0] - mirrored).max() <= 1


def test_round_off_outside_the_unit_square(launcher):
    """Coordinates that miss [0, 1] by less than half a texel are baked all the same."""
    grid = Mesh.grid((-2, 0, 2), (4, 0, 0), (0, 0, -4))
    surface = floor(mesh=Mesh(grid.points, grid.triangles, uvs=grid.uvs * np.float32(1.004) - np.float32(0.002)))
    bake = ReceiverBake(launcher, surface, [SUN], ORIGIN, bakes=["lit"])
    assert isinstance(bake.map, TexelMap)
    assert bake.map.count == SIZE * SIZE


def test_overlap_is_reported(launcher):
    """A box whose six sides share one square is baked, with a warning that counts the texels."""
    bake = ReceiverBake(launcher, floor(mesh=Mesh.box()), [SUN], ORIGIN, bakes=["lit"])
    assert bake.warnings[0] == (
        "/Floor: texture coordinates overlap in 1024 of 1024 texels; these show only the first of the triangles there"
    )


def test_mesh_without_triangles(launcher):
    """A mesh of nothing gives no colours and no failure."""
    surface = floor(mesh=Mesh(np.zeros((0, 3)), np.zeros((0, 3)), uvs=np.zeros((0, 3, 2))))
    bake = ReceiverBake(launcher, surface, [SUN], ORIGIN, bakes=["lit", "visibility"])
    bake.update(1.0)
    assert bake.picture("lit").shape == (0, 3)
    assert bake.picture("visibility").shape == (0,)
