"""Texture coordinates and pictures that are missing or odd: a fallback that is said, or one clear line."""

from dataclasses import replace

import numpy as np
import pytest
from hard_cases import check_finite, simulate, small_plume
from PIL import Image

import warp_smoke as ws
from warp_smoke.record import FieldError

_FLOOR = small_plume(16).surfaces[0]
_UVS = _FLOOR.mesh.uvs
# Texture coordinates, and a word of the warning; none where nothing is left out.
UVS = {
    "none": (None, "points are baked"),
    "without area": (np.zeros_like(_UVS), "points are baked"),
    "on a line": (_UVS * [1.0, 0.0], "points are baked"),
    "mirrored": (_UVS * [-1.0, 1.0] + [1.0, 0.0], None),
    "outside": (_UVS * 3.0 - 1.0, "[0, 1]"),
    "overlapping": (_UVS[[0, 0]], "overlap"),
    "huge": (_UVS * 1e30, "[0, 1]"),
}


def bake(uvs: np.ndarray | None, material: ws.Material | None = None) -> tuple[list[ws.Frame], list[str]]:
    """Frames with the floor under some texture coordinates, and what was said of them."""
    mesh = ws.Mesh(_FLOOR.mesh.points, _FLOOR.mesh.triangles, _FLOOR.mesh.normals, uvs)
    scene = replace(small_plume(16), surfaces=[replace(_FLOOR, mesh=mesh, material=material)], end=2)
    simulation, frames = simulate(scene)
    return frames, [text for text in simulation.warnings if "no camera" not in text]


@pytest.mark.parametrize("kind", UVS)
def test_uvs(kind):
    """Bakes are finite and not black; what could not be done as asked is said once, with the prim's path."""
    uvs, said = UVS[kind]
    frames, warnings = bake(uvs)
    check_finite(frames)
    assert np.any(frames[0].pictures["/World/Floor", "lit"])
    assert [said in text for text in warnings] == [True] * (said is not None)
    assert all(text.startswith("/World/Floor: ") for text in warnings)


PICTURES = {
    "1 × 1": np.full((1, 1, 3), 200, np.uint8),
    "grey": np.full((4, 4), 100, np.uint8),
    "grey of 16 bits": np.full((4, 4), 30000, np.uint16),
    "RGBA": np.full((4, 4, 4), 50, np.uint8),
    "a row": np.full((1, 300, 3), 20, np.uint8),
}


@pytest.mark.parametrize("kind", PICTURES)
@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror", "black"])
def test_pictures(kind, wrap, tmp_path):
    """Pictures of any size and kind, wrapped in any way: a finite bake that is not black."""
    file = tmp_path / "picture.png"
    Image.fromarray(PICTURES[kind]).save(file)
    texture = ws.Texture(file=str(file), wrap_s=wrap, wrap_t=wrap)
    frames, warnings = bake(_UVS, ws.Material(path="/Look", diffuse_texture=texture))
    check_finite(frames)
    assert warnings == []
    assert np.any(frames[0].pictures["/World/Floor", "lit"])


@pytest.mark.parametrize("content", [None, b"", b"no picture", b"\x89PNG\r\n\x1a\n" + bytes(50)])
def test_unreadable_pictures(content, tmp_path):
    """A picture that is missing, empty or something else: one line with the material and the file."""
    file = tmp_path / "picture.png"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(FieldError) as error:
        bake(_UVS, ws.Material(path="/Look", diffuse_texture=ws.Texture(file=str(file))))
    assert str(error.value).startswith(f"/Look: diffuse_texture is {file} (")
    assert "\n" not in str(error.value)
