"""Meshes with holes, without area, with points or triangles too many, or with nothing, in every role."""

from dataclasses import replace

import numpy as np
import pytest
from hard_cases import BALL, CUBE, check_finite, simulate, small_plume
from scenes import at

import warp_smoke as ws

_BOX = ws.Mesh.box(0.6)
_POINTS, _TRIANGLES = _BOX.points, _BOX.triangles
MESHES = {
    "a hole": ws.Mesh(_POINTS, _TRIANGLES[1:]),
    "inside out": ws.Mesh(_POINTS, _TRIANGLES[:, ::-1]),
    "one triangle turned": ws.Mesh(_POINTS, np.concatenate([_TRIANGLES[:1, ::-1], _TRIANGLES[1:]])),
    "triangles twice": ws.Mesh(_POINTS, np.concatenate([_TRIANGLES, _TRIANGLES])),
    "triangles on a line": ws.Mesh(_POINTS, np.concatenate([_TRIANGLES, [[0, 1, 1], [2, 2, 2]]])),
    "all without area": ws.Mesh(_POINTS, np.repeat(_TRIANGLES[:, :1], 3, axis=1)),
    "all points in one": ws.Mesh(np.zeros_like(_POINTS), _TRIANGLES),
    "points of no triangle": ws.Mesh(np.concatenate([_POINTS, [[9.0, 9.0, 9.0]]]), _TRIANGLES),
    "one triangle": ws.Mesh(_POINTS, _TRIANGLES[:1]),
    "no triangles": ws.Mesh(_POINTS, _TRIANGLES[:0]),
    "nothing": ws.Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)),
    "crossing itself": ws.Mesh(_POINTS * np.where(np.arange(24) % 2, 1.0, -1.0)[:, None], _TRIANGLES),
}
ROLES = ("emitter", "collider", "caster", "receiver")


def play(mesh: ws.Mesh, role: str) -> ws.Scene:
    """A plume's scene with a mesh in one role."""
    scene = small_plume(8)
    if role == "emitter":
        return replace(scene, emitters=[replace(scene.emitters[0], mesh=mesh, transform=at(0.05, 1.1, 0.0))])
    if role == "collider":
        return replace(scene, colliders=[replace(BALL, mesh=mesh)])
    if role == "caster":
        return replace(scene, surfaces=[scene.surfaces[0], replace(CUBE, mesh=mesh)])
    receiver = replace(scene.surfaces[0].receiver, path=CUBE.path)
    return replace(scene, surfaces=[replace(CUBE, mesh=mesh, receiver=receiver)])


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("name", MESHES)
def test_bad_meshes(name, role):
    """Whatever a mesh is like, and whatever it is used for: no NaN anywhere, and density in its range."""
    _, frames = simulate(play(MESHES[name], role))
    check_finite(frames)
    assert all(smoke.density.max() <= 1.0 + 1e-6 for frame in frames for smoke in frame.smoke.values())


@pytest.mark.parametrize("name", ["a hole", "one triangle turned", "one triangle"])
@pytest.mark.parametrize("role", ["emitter", "collider"])
def test_holes_are_named(name, role):
    """The plan names an emitter or collider that is not closed by its path."""
    scene = play(MESHES[name], role)
    path = (scene.colliders or scene.emitters)[0].path
    assert f"{path}: its mesh is not closed; what counts as inside it is estimated" in ws.make_plan(scene).warnings


@pytest.mark.parametrize("name", ["triangles twice", "inside out", "points of no triangle", "triangles on a line"])
def test_what_a_mesh_has_too_much_does_not_count(name):
    """Triangles that are there twice, without area or turned, and stray points: the smoke of the box without them."""
    _, plain = simulate(play(_BOX, "collider"))
    _, other = simulate(play(MESHES[name], "collider"))
    for one, two in zip(plain, other, strict=True):
        for path, smoke in one.smoke.items():
            np.testing.assert_allclose(two.smoke[path].density, smoke.density, atol=1e-5)
