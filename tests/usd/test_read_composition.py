"""Composed stages are read as what they compose to."""

import numpy as np
import pytest
from pxr import Usd
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
