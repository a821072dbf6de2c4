from zipfile import ZipFile

import numpy as np
import pytest
from material_text import texture, with_material
from PIL import Image
from pxr import UsdUtils
from stage_text import write_stage

from warp_smoke.deep_png import encode_deep_png
from warp_smoke.picture_file import open_picture_file
from warp_smoke.scene import Scene
from warp_smoke.shading.textures import Picture


@pytest.fixture
def package(tmp_path):
    """A package with the bytes `picture` as `textures/a.png`, as its path is written."""
    with ZipFile(tmp_path / "set.usdz", "w") as archive:
        archive.writestr("textures/a.png", b"picture")
    return f"{tmp_path / 'set.usdz'}[textures/a.png]"


def test_files_alone_and_in_packages(tmp_path, package):
    """Both give their bytes, also where a folder's name has brackets."""
    folder = tmp_path / "set.usdz of [a]"
    folder.mkdir()
    (folder / "a.png").write_bytes(b"alone")
    for path, content in ((str(folder / "a.png"), b"alone"), (package, b"picture")):
        with open_picture_file(path) as opened:
            assert opened.read() == content


@pytest.mark.parametrize(
    "change", [lambda path: path.replace("a.png", "b.png"), lambda path: path.replace("set", "no")]
)
def test_files_that_are_not_there(package, change):
    """A package that is missing, or a file in it, is no file."""
    with pytest.raises(FileNotFoundError):
        open_picture_file(change(package))


def test_damaged_packages(tmp_path, package):
    """What is no package, or has other bytes than it says, is an error of input."""
    file = tmp_path / "set.usdz"
    whole = file.read_bytes()
    for damaged in (b"nothing", whole.replace(b"picture", b"fixture")):
        file.write_bytes(damaged)
        with pytest.raises(OSError, match="a damaged package"):
            open_picture_file(package)


@pytest.mark.parametrize("name", ["deep.png", "plain.png"])
def test_textures_of_a_packaged_stage(tmp_path, name):
    """A `.usdz`, as Blender exports it, has its pictures in it: of 8 bits a channel and of 16."""
    codes = np.arange(2 * 3 * 3).reshape(2, 3, 3)
    (tmp_path / "deep.png").write_bytes(encode_deep_png(codes.astype(np.uint16) * 3000, 1))
    Image.fromarray(codes.astype(np.uint8)).save(tmp_path / "plain.png")
    stage = write_stage(tmp_path, with_material(*texture(f"asset inputs:file = @./{name}@")))
    UsdUtils.CreateNewUsdzPackage(str(stage), str(tmp_path / "set.usdz"))
    scene = Scene.open(tmp_path / "set.usdz")
    assert scene.warnings == ()
    (surface,) = scene.surfaces
    file = surface.material.diffuse_texture.file
    assert file.startswith(f"{tmp_path / 'set.usdz'}[")
    read = Picture.read(file, "auto").codes
    assert np.array_equal(read, Picture.read(str(tmp_path / name), "auto").codes)
    assert np.array_equal(read, codes * (3000 if name == "deep.png" else 1))
