"""Pictures in tiles (UDIM): read as one, laid tile by tile, and shown alike by bakes, pictures and the preview."""

from zipfile import ZipFile

import numpy as np
import pytest
from PIL import Image
from scenes import at

import warp_smoke as ws
from warp_smoke.deep_png import encode_deep_png
from warp_smoke.fingerprint import fingerprint, first_difference
from warp_smoke.geometry import Mesh
from warp_smoke.picture_file import tile_files
from warp_smoke.plan import make_plan
from warp_smoke.preview import preview
from warp_smoke.shading import textures
from warp_smoke.shading.textures import Picture

RED, GREEN, BLUE, BLACK = (250, 20, 10), (30, 240, 20), (10, 40, 230), (0, 0, 0)
TILES = {1001: RED, 1002: GREEN, 1011: BLUE}  # right of the first, and above it


@pytest.fixture
def wood(tmp_path):
    """Three tiles of different sizes, one colour each, among other files; their common path."""
    for size, (number, color) in enumerate(TILES.items(), 2):
        Image.fromarray(np.full((size, 2 * size, 3), color, np.uint8)).save(tmp_path / f"wood.{number}.png")
    for other in ("wood.1003.png.bak", "wood.999.png", "wood.0999.png", "wood.png", "oak.1004.png"):
        (tmp_path / other).write_bytes(b"something else")
    return str(tmp_path / "wood.<UDIM>.png")


def _floor(material):
    """A floor of 6 × 6 units whose coordinates cover four tiles."""
    mesh = Mesh.grid((-3, 0, 3), (6, 0, 0), (0, 0, -6))
    mesh = Mesh(mesh.points, mesh.triangles, mesh.normals, 2 * mesh.uvs)
    receiver = ws.Receiver(path="/World/Floor", bake=("lit",), texture_size=64)
    return ws.Surface(path="/World/Floor", mesh=mesh, material=material, receiver=receiver)


def _scene(file):
    """The floor in light from everywhere, which shows its colours, before a camera that sees just the floor."""
    texture = ws.Texture(file=file, wrap_s="clamp", wrap_t="clamp")
    down = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]) @ at(0, 8, 0)
    lens = {"focal_length": 8.0, "horizontal_aperture": 6.0, "vertical_aperture": 6.0, "near": 0.01}
    return ws.Scene(
        surfaces=[_floor(ws.Material(path="/World/Wood", diffuse_texture=texture))],
        camera=ws.Camera(path="/World/Eye", transform=down, **lens),
        ambient=(1, 1, 1),
    )


def test_files_of_tiles(wood, tmp_path):
    """Files by column and row; other names are not tiles; a path without the mark is one tile."""
    assert tile_files(wood) == {
        (0, 0): str(tmp_path / "wood.1001.png"),
        (0, 1): str(tmp_path / "wood.1011.png"),
        (1, 0): str(tmp_path / "wood.1002.png"),
    }
    assert tile_files("wood.png") == {(0, 0): "wood.png"}
    with pytest.raises(FileNotFoundError):
        tile_files(str(tmp_path / "elm.<UDIM>.png"))


def test_files_of_tiles_in_a_package(tmp_path):
    """Within a package the tiles are those of the same folder."""
    with ZipFile(tmp_path / "set.usdz", "w") as package:
        for name in ("set.usdc", "0/wood.1002.png", "1/wood.1003.png"):
            package.writestr(name, b"")
    packed = f"{tmp_path}/set.usdz[0/wood."
    assert tile_files(packed + "<UDIM>.png]") == {(1, 0): packed + "1002.png]"}


def test_tiles_are_one_picture(wood):
    """The first at the bottom left, all stretched to the size of the largest; black where there is none."""
    picture = Picture.read(wood, "auto")
    assert picture.tiles == (2, 2)
    expected = np.kron(np.array([[BLUE, BLACK], [RED, GREEN]]), np.ones((4, 8, 1)))
    np.testing.assert_array_equal(picture.codes, expected)
    assert picture.alpha is None


def test_alpha_of_tiles(tmp_path):
    """A tile without alpha is opaque beside one with it."""
    Image.fromarray(np.full((2, 2, 4), 80, np.uint8)).save(tmp_path / "a.1001.png")
    Image.fromarray(np.full((2, 2), 50, np.uint8)).save(tmp_path / "a.1002.png")
    picture = Picture.read(str(tmp_path / "a.<UDIM>.png"), "raw")
    np.testing.assert_array_equal(picture.alpha, [[80, 80, 255, 255]] * 2)
    np.testing.assert_array_equal(picture.codes[..., 0], [[80, 80, 50, 50]] * 2)


def test_bakes_pictures_and_the_preview_show_tiles(wood, tmp_path):
    """Each quarter of the floor has the colour of its tile, everywhere; the stage names the tiles as it did."""
    _scene(wood).save(tmp_path / "floor.usda")
    result = ws.run(tmp_path / "floor.usda", tmp_path / "out")
    assert ws.Scene.open(tmp_path / "floor.usda").surfaces[0].material.diffuse_texture.file == wood
    ws.render(tmp_path / "out", tmp_path / "seen.png", size=(64, 64), samples=1)
    preview(tmp_path / "floor.usda", screenshot=tmp_path / "preview.png", size=(64, 64))
    files = (*result.folder.glob("textures/Floor.lit*"), tmp_path / "seen.png", tmp_path / "preview.png")
    assert len(files) == 3
    for file in files:
        quarters = np.asarray(Image.open(file))[16::32, 16::32, :3].astype(int)
        assert np.abs(quarters - [[BLUE, BLACK], [RED, GREEN]]).max() <= 1, file  # VTK rounds once more


def test_another_tile_is_another_scene(wood, tmp_path):
    """What results depend on tells a changed, a moved and a new tile from before."""
    before = fingerprint(_scene(wood), "cpu")
    assert first_difference(before, fingerprint(_scene(wood), "cpu")) is None
    (tmp_path / "wood.1002.png").rename(tmp_path / "wood.1003.png")
    assert "diffuse_texture.content" in first_difference(before, fingerprint(_scene(wood), "cpu"))


def test_memory_of_tiles(wood):
    """The plan counts the joined picture: 16 × 8 texels of 16 bytes, where one tile has 2 × 4."""
    one = wood.replace("<UDIM>", "1001")
    needed = [make_plan(_scene(file)).bytes["/World/Floor"] for file in (wood, one)]
    assert needed[0] - needed[1] == 16 * (16 * 8 - 2 * 4)


@pytest.mark.parametrize("fault", ["bits", "damaged", "many"])
def test_tiles_that_cannot_be_joined(wood, tmp_path, monkeypatch, fault):
    """One line names the material's field and what is wrong with the tiles."""
    said = {
        "bits": r"some of its tiles have 8 bits and others 16",
        "damaged": r"cannot identify",
        "many": r"up to column 2 and row 2, make 16 × 8 texels; allowed: 100",
    }
    if fault == "bits":
        deep = encode_deep_png(np.zeros((2, 2, 3), np.uint16), 1)
        (tmp_path / "wood.1002.png").write_bytes(deep)
    elif fault == "damaged":
        (tmp_path / "wood.1002.png").write_bytes(b"no picture")
    else:
        monkeypatch.setattr(textures, "_MOST_TEXELS", 100)
    with pytest.raises(ValueError, match=rf"^/World/Wood: diffuse_texture is .*{said[fault]}"):
        ws.Simulation(_scene(wood))
