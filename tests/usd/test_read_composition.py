"""Composed stages are read as what they compose to."""

import re

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from stage_text import QUAD, write_stage

from warp_smoke.geometry import transform_points, winding_flips
from warp_smoke.scene import Scene

KIT = """#usda 1.0
( defaultPrim = "Kit" )
def Xform "Kit" ( variants = {
    string shape = "ball"
}
 prepend variantSets = "shape" )
{
    def Mesh "Tile" (
        prepend apiSchemas = ["SmokeReceiverAPI"]
    )
    {
        int[] faceVertexCounts = [5, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 4, 0, 4, 5]
        point3f[] points = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 0.2, 0), (0, 1, 0), (-1, 0, 0)]
        uniform token orientation = "leftHanded"
    }
    variantSet "shape" = {
        "ball" {
            def Sphere "Shape" {
                double radius = 0.5
            }
        }
        "box" {
            def Cube "Shape" {
                double size = 0.5
            }
        }
    }
}
"""


@pytest.mark.parametrize("arc", ["references", "payload"])
@pytest.mark.parametrize("instanceable", [False, True])
@pytest.mark.parametrize("shape", ["ball", "box"])
def test_as_if_flattened(tmp_path, arc, instanceable, shape):
    """References, payloads, variants, overrides, instances and a mirroring transform: as the flattened stage reads."""
    (tmp_path / "kit.usda").write_text(KIT)
    prims = f"""def "Placed" (
        instanceable = {str(instanceable).lower()}
        prepend {arc} = @./kit.usda@
        variants = {{ string shape = "{shape}"\n}}
    )
    {{
        float3 xformOp:scale = (-1, 2, 1)
        double3 xformOp:translate.timeSamples = {{ 1: (0, 0, 0), 3: (4, 0, 0)\n}}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"] }}"""
    path = write_stage(tmp_path, prims)
    flat = tmp_path / "flat.usda"
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        prim.SetInstanceable(False)
    stage.Flatten().Export(str(flat))
    scene = Scene.open(path)
    assert scene == Scene.open(flat)
    assert {s.path for s in scene.surfaces} == {"/World/Placed/Tile", "/World/Placed/Shape"}
    assert scene.warnings == ()


def test_a_mirror_and_a_left_hand_together_face_outwards(tmp_path):
    """A left-handed quad under a mirror, turned by hand: its normal points where a plain quad's does."""
    plain = write_stage(tmp_path, f'def Mesh "A" {{ {QUAD} }}')
    (one,) = Scene.open(plain).surfaces
    mirrored = f"""def Mesh "A" {{ {QUAD}
        uniform token orientation = "leftHanded"
        float3 xformOp:scale = (-1, 1, 1)
        double3 xformOp:translate = (1, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"] }}"""
    (two,) = Scene.open(write_stage(tmp_path, mirrored)).surfaces

    def normals(surface):
        world = transform_points(surface.transform, surface.mesh.points)
        a, b, c = world[surface.mesh.triangles].transpose(1, 0, 2)
        flip = -1 if winding_flips(surface.transform) else 1
        return flip * np.cross(b - a, c - a)

    np.testing.assert_allclose(normals(one), [[0, 0, 1]] * 2)
    # Left-handed in its own space means that the mesh faces −z there; a mirror along x does not change z.
    np.testing.assert_allclose(normals(two), [[0, 0, -1]] * 2)


ROOM = """#usda 1.0
( defaultPrim = "Room" )
class "_class_Warm" { color3f inputs:color = (1, 0.5, 0.25) }
def Xform "Room" {
    def Mesh "Floor" ( prepend apiSchemas = ["SmokeReceiverAPI", "MaterialBindingAPI"] ) {
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
        point3f[] points.timeSamples = {
            1: [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 0, 1), (1, 0, 1), (2, 0, 1)],
            5: [(0, 1, 0), (1, 0, 0), (2, 0, 0), (0, 0, 1), (1, 0, 1), (2, 2, 1)],
        }
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (0, 1), (1, 1)] ( interpolation = "faceVarying" )
        int[] primvars:st:indices = [0, 1, 3, 2, 0, 1, 3, 2]
        uniform token subsetFamily:materialBind:familyType = "nonOverlapping"
        rel material:binding = </Room/Looks/Red>
        def GeomSubset "Half" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1]
            rel material:binding = </Room/Looks/Blue>
        }
    }
    def Xform "Props" {
        token visibility.timeSamples = { 1: "inherited", 3: "invisible" }
        def Capsule "Source" ( prepend apiSchemas = ["SmokeEmitterAPI"] ) {
            float smoke:density.timeSamples = { 1: 1, 4: 0.5 } }
        def Cone "Wall" ( prepend apiSchemas = ["SmokeColliderAPI"] ) {}
        def Cube "Proxy" { uniform token purpose = "proxy" }
        def Cube "Fine" { uniform token purpose = "render" }
        def Cube "Off" ( active = false ) {}
    }
    def PointInstancer "Stones" {
        rel prototypes = [</Room/Stones/A>, </Room/Stones/B>]
        int[] protoIndices = [0, 1, 0]
        point3f[] positions = [(0, 0, 0), (3, 0, 0), (0, 3, 0)]
        float3[] scales = [(1, 1, 1), (-1, 1, 1), (2, 2, 2)]
        def Sphere "A" {}
        def Xform "B" { def Cylinder "Post" ( prepend apiSchemas = ["SmokeColliderAPI"] ) {} }
    }
    def SphereLight "Spot" ( prepend apiSchemas = ["ShapingAPI", "ShadowAPI"]
        prepend inherits = </_class_Warm> ) {
        float inputs:intensity.timeSamples = { 1: 3, 5: 7 }
        float inputs:shaping:cone:angle = 30
        bool inputs:shadow:enable = false
        rel collection:lightLink:includes = [</Room/Floor>, </Room/Props>]
        uniform bool collection:lightLink:includeRoot = 0
    }
    def DistantLight "Sun" ( prepend specializes = </_class_Warm> ) {
        double xformOp:rotateX.timeSamples = { 1: -90, 5: -30 }
        uniform token[] xformOpOrder = ["xformOp:rotateX"]
    }
    def Camera "Eye" { float focalLength = 35 }
    def Scope "Looks" {
        def Material "Red" ( prepend references = </Room/Looks/Base> ) {
            over "S" { color3f inputs:diffuseColor = (1, 0, 0) } }
        def Material "Blue" ( prepend references = </Room/Looks/Base> ) {
            over "S" { color3f inputs:diffuseColor = (0, 0, 1) } }
        def Material "Base" {
            token outputs:surface.connect = </Room/Looks/Base/S.outputs:surface>
            def Shader "S" { uniform token info:id = "UsdPreviewSurface"
                token outputs:surface }
        }
    }
}
"""


@pytest.mark.parametrize("instanceable", [False, True])
def test_a_whole_room_as_if_flattened(tmp_path, instanceable):
    """Every kind of prim, two sublayers and two references deep with times stretched and shifted, and mirrored."""
    (tmp_path / "room.usda").write_text(ROOM.replace(" }", "\n}\n"))
    (tmp_path / "shot.usda").write_text(
        f"""#usda 1.0
        def Xform "World" {{
            def "One" (
                prepend references = @./room.usda@ (offset = 2; scale = 3)
                instanceable = {str(instanceable).lower()}
            )
            {{
                float3 xformOp:scale = (1, -1, 2)
                uniform token[] xformOpOrder = ["xformOp:scale"]
            }}
            def "Two" (
                prepend payload = @./room.usda@
                instanceable = {str(instanceable).lower()}
            )
            {{
                double3 xformOp:translate = (10, 0, 0)
                uniform token[] xformOpOrder = ["xformOp:translate"]
            }}
        }}"""
    )
    path = tmp_path / "stage.usda"
    path.write_text("""#usda 1.0
        (
            defaultPrim = "World"
            metersPerUnit = 1
            startTimeCode = 1
            endTimeCode = 20
            subLayers = [@./shot.usda@ (offset = 1; scale = 0.5)]
        )
        over "World" {}""")
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        prim.SetInstanceable(False)
    flat = tmp_path / "flat.usda"
    stage.Flatten().Export(str(flat))
    scene, flattened = Scene.open(path), Scene.open(flat)
    for name in ("emitters", "colliders", "surfaces", "lights", "camera", "ambient"):
        assert getattr(scene, name) == getattr(flattened, name), name
    assert len(scene.emitters) == 2
    assert len(scene.colliders) == 4
    assert len(scene.lights) == 4
    assert [len(each.materials) for each in scene.surfaces if each.path.endswith("Floor")] == [2, 2]
    floor = next(each for each in scene.surfaces if each.path == "/World/One/Floor")
    # 1 and 5 in the room: · 3 + 2 in the shot, · 0.5 + 1 on the stage.
    np.testing.assert_array_equal(floor.mesh.points.times, [3.5, 9.5])
    spot = next(each for each in scene.lights if each.path == "/World/One/Spot")
    assert spot.illuminates is not None
    assert "/World/One/Floor" in spot.illuminates
    assert "/World/Two/Floor" not in spot.illuminates
    assert not [path for path in spot.illuminates if "Stones" in path]


@pytest.mark.parametrize(("name", "meant"), [("ids", "int64[]"), ("protoIndices", "int[]"), ("positions", "point3f[]")])
def test_instancers_of_another_type(tmp_path, name, meant):
    """A layer that gives an instancer's attribute another type is refused in one line."""
    layer = Sdf.Layer.CreateNew(str(tmp_path / "many.usda"))
    prim = UsdGeom.PointInstancer.Define(Usd.Stage.Open(layer), "/Many").GetPrim()
    Sdf.AttributeSpec(layer.GetPrimAtPath(prim.GetPath()), name, Sdf.ValueTypeNames.Bool).default = True
    layer.defaultPrim = "Many"
    layer.Save()
    with pytest.raises(ValueError, match=rf"/Many: {name} is of type bool; allowed: {re.escape(meant)}$"):
        Scene.open(tmp_path / "many.usda")


BELOW = """#usda 1.0
(
    defaultPrim = "root"
    upAxis = "Z"
    metersPerUnit = 0.5
    startTimeCode = 101
    endTimeCode = 148
    timeCodesPerSecond = 24
)
def Xform "root" { }
"""


def test_metadata_of_sublayers_has_no_effect(tmp_path):
    """USD reads units, axis and times from the opened layer alone; what differs from its fallback below is told."""
    (tmp_path / "set.usda").write_text(BELOW.replace(" }", "\n}"))
    shot = tmp_path / "shot.usda"
    shot.write_text(
        '#usda 1.0\n(\n    defaultPrim = "root"\n    endTimeCode = 130\n    subLayers = [@./set.usda@]\n)\n'
    )
    scene = Scene.open(shot)
    assert (scene.up_axis, scene.meters_per_unit) == ("Y", 0.01)
    assert scene.warnings == (
        "/: upAxis is unset; that of the sublayer set.usda, Z, has no effect",
        "/: metersPerUnit is unset; that of the sublayer set.usda, 0.5, has no effect",
        "/: startTimeCode is unset; that of the sublayer set.usda, 101.0, has no effect",
    )


def test_the_default_prim_of_a_sublayer_is_named(tmp_path):
    """A layer over an export that has no default prim is refused, and told which one it could have."""
    (tmp_path / "set.usda").write_text(BELOW.replace(" }", "\n}"))
    shot = tmp_path / "shot.usda"
    shot.write_text("#usda 1.0\n(\n    subLayers = [@./set.usda@]\n)\n")
    line = (
        f"{shot}: /: defaultPrim is unset; allowed: the name of a root prim; that of the sublayer set.usda, root, has "
    )
    with pytest.raises(ValueError, match=re.escape(line)):
        Scene.open(shot)
