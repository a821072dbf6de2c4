import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt
from stage_text import QUAD, scene_of, write_stage

from warp_smoke.geometry import transform_points
from warp_smoke.record import each_value, value_at
from warp_smoke.scene import Scene

INSTANCER = """def PointInstancer "Trees" {
    rel prototypes = [</World/Trees/Tree>, </World/Trees/Rock>]
    int[] protoIndices = [0, 1, 0]
    point3f[] positions = [(1, 0, 0), (2, 0, 0), (3, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (0.7071, 0, 0.7071, 0), (0, 0, 1, 0)]
    float3[] scales = [(1, 1, 1), (2, 1, 1), (-1, 1, 1)]
    %s
    double3 xformOp:translate = (0, 5, 0)
    token[] xformOpOrder = ["xformOp:translate"]
    def Xform "Tree" {
        double3 xformOp:translate = (0, 0, 7)
        token[] xformOpOrder = ["xformOp:translate"]
        def Mesh "Leaf" { %s
            double3 xformOp:translate = (0.5, 0, 0)
            token[] xformOpOrder = ["xformOp:translate"]
        }
    }
    def Cube "Rock" { }
}"""


def surface_at(scene, path, time=1):
    """World points of the one surface at a path."""
    (surface,) = [each for each in scene.surfaces if each.path == path]
    return transform_points(surface.transform_at(time), surface.mesh.points_at(time))


def test_instances_stand_where_usd_puts_them(tmp_path):
    """Every instance has its prototype's mesh, shared, at UsdGeomPointInstancer's transform of it."""
    path = write_stage(tmp_path, INSTANCER % ("", QUAD))
    scene = Scene.open(path)
    leaves = ["/World/Trees/Instance0/Tree/Leaf", "/World/Trees/Instance2/Tree/Leaf"]
    assert {s.path for s in scene.surfaces} == {*leaves, "/World/Trees/Instance1/Rock"}
    assert {s.instancer for s in scene.surfaces} == {"/World/Trees"}
    assert scene.warnings == ()
    stage = Usd.Stage.Open(str(path))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/World/Trees"))
    places = instancer.ComputeInstanceTransformsAtTime(1, 1)
    quad = np.array([[0.5, 0, 0], [1.5, 0, 0], [1.5, 1, 0], [0.5, 1, 0]])
    for leaf, index in zip(leaves, (0, 2), strict=True):
        expected = transform_points(np.array(places[index]), quad) + np.array([0, 5, 0])
        np.testing.assert_allclose(surface_at(scene, leaf), expected, atol=1e-6)  # points are single precision
    # By hand: the first stands at (1, 5, 7), its leaf half a unit further; the last is mirrored and turned around.
    np.testing.assert_allclose(surface_at(scene, leaves[0])[0], [1.5, 5, 7], atol=1e-6)
    by_path = {s.path: s.mesh for s in scene.surfaces}
    assert by_path[leaves[0]] is by_path[leaves[1]]


def test_hidden_and_inactive_instances_are_left_out(tmp_path):
    """`invisibleIds` hides by id, also over time; ids name the instances."""
    more = "int64[] ids = [10, 20, 30]\nint64[] invisibleIds.timeSamples = { 1: [10, 30], 3: [30] }"
    scene = scene_of(tmp_path, INSTANCER % (more, QUAD))
    assert {s.path: [bool(value_at(s.visible, t)) for t in (1, 2, 3)] for s in scene.surfaces} == {
        "/World/Trees/Instance10/Tree/Leaf": [False, False, True],
        "/World/Trees/Instance20/Rock": [True, True, True],
    }


def test_moving_instances(tmp_path):
    """Positions with samples move the instances, those of a moving instancer on top of it; the count may change."""
    scene = scene_of(
        tmp_path,
        """def PointInstancer "P" {
        rel prototypes = </World/P/Ball>
        int[] protoIndices.timeSamples = { 1: [0], 3: [0, 0] }
        point3f[] positions.timeSamples = { 1: [(0, 0, 0)], 3: [(2, 0, 0), (9, 0, 0)] }
        double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 4: (0, 3, 0) }
        token[] xformOpOrder = ["xformOp:translate"]
        def Sphere "Ball" ( prepend apiSchemas = ["SmokeEmitterAPI"] ) { }
        }""",
    )
    first, second = scene.surfaces
    np.testing.assert_allclose(first.transform_at(3)[3, :3], [2, 2, 0], atol=1e-6)
    np.testing.assert_allclose(second.transform_at(3)[3, :3], [9, 2, 0], atol=1e-6)
    assert [bool(value_at(second.visible, t)) for t in (1, 2, 3, 4)] == [False, False, True, True]
    assert first.visible is True
    assert [each.path for each in scene.emitters] == ["/World/P/Instance0/Ball", "/World/P/Instance1/Ball"]
    np.testing.assert_array_equal(scene.emitters[0].transform_at(3), first.transform_at(3))


def test_nested_instancers(tmp_path):
    """An instancer as the prototype of another: 2 × 2 instances, each at the sum of both places."""
    scene = scene_of(
        tmp_path,
        """def PointInstancer "Outer" {
        rel prototypes = </World/Outer/Inner>
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (10, 0, 0)]
        def PointInstancer "Inner" {
            rel prototypes = </World/Outer/Inner/Box>
            int[] protoIndices = [0, 0]
            point3f[] positions = [(0, 1, 0), (0, 2, 0)]
            def Cube "Box" { }
        }
        }""",
    )
    places = {s.path: tuple(s.transform[3, :3]) for s in scene.surfaces}
    assert places == {
        f"/World/Outer/Instance{i}/Inner/Instance{k}/Box": (10.0 * i, 1.0 + k, 0.0) for i in (0, 1) for k in (0, 1)
    }


def test_prototypes_elsewhere(tmp_path):
    """A prototype below a class is drawn by the instancer alone, and a light in it shines from each instance."""
    scene = scene_of(
        tmp_path,
        """class "Kit" {
        def Xform "Lamp" {
            def Mesh "Shade" ( prepend apiSchemas = ["SmokeReceiverAPI"] ) { """
        + QUAD
        + """ }
            def SphereLight "Bulb" { double3 xformOp:translate = (0, 1, 0)
            token[] xformOpOrder = ["xformOp:translate"] }
        }
        }
        def PointInstancer "P" {
        rel prototypes = </World/Kit/Lamp>
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (3, 0, 0)]
        }""",
    )
    assert [s.path for s in scene.surfaces] == ["/World/P/Instance0/Lamp/Shade", "/World/P/Instance1/Lamp/Shade"]
    assert [light.position_at(1).tolist() for light in scene.lights] == [[0, 1, 0], [3, 1, 0]]
    assert all(s.receiver is None for s in scene.surfaces)
    (warning,) = scene.warnings
    assert warning.startswith("/World/Kit/Lamp/Shade: SmokeReceiverAPI has no effect: instances")


@pytest.mark.parametrize(
    ("arrays", "line"),
    [
        ("int[] protoIndices = [3]\npoint3f[] positions = [(0, 0, 0)]", "protoIndices is 3; allowed: 0…0, the"),
        (
            "int[] protoIndices = [0, 0]\npoint3f[] positions = [(0, 0, 0)]",
            "positions is 1 in number; allowed: 2, one for each instance",
        ),
    ],
)
def test_bad_instancers_are_named_in_one_line(tmp_path, arrays, line):
    """Arrays that do not fit each other are refused with the instancer's path."""
    rel = "rel prototypes = </World/P/Box>"
    with pytest.raises(ValueError, match=f"/World/P: {line}"):
        scene_of(tmp_path, f'def PointInstancer "P" {{ {rel}\n{arrays}\ndef Cube "Box" {{ }}\n}}')


def test_as_if_flattened(tmp_path):
    """Turned, scaled and moving instances equal the same cubes written out one by one with USD's matrices."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "instanced.usda"))
    stage.SetDefaultPrim(stage.DefinePrim("/World", "Xform"))
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(3)
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/P")
    UsdGeom.Cube.Define(stage, "/World/P/Box").AddRotateXYZOp().Set((10, 20, 30))
    instancer.CreatePrototypesRel().AddTarget("/World/P/Box")
    rng = np.random.default_rng(7)
    instancer.CreateProtoIndicesAttr([0] * 5)
    for time in (1, 3):
        instancer.CreatePositionsAttr().Set(Vt.Vec3fArray.FromNumpy(rng.normal(size=(5, 3)).astype(np.float32)), time)
    instancer.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(rng.uniform(-2, 2, (5, 3)).astype(np.float32)))
    stage.Save()
    scene = Scene.open(tmp_path / "instanced.usda")
    assert len(scene.surfaces) == 5
    for time in (1.0, 2.0, 3.0):
        places = instancer.ComputeInstanceTransformsAtTime(time, time)
        for surface, matrix in zip(scene.surfaces, places, strict=True):
            np.testing.assert_allclose(surface.transform_at(time), np.array(matrix), atol=1e-12)
    assert each_value(scene.surfaces[0].transform).shape == (3, 4, 4)
