"""A stage with every kind of prim that is read, and strategies that set its attributes to anything."""

from collections.abc import Callable
from functools import cache

from hypothesis import strategies as st
from pxr import Gf, Sdf, Usd

from warp_smoke.usd.schema import register_schema

STAGE = """#usda 1.0
(
    defaultPrim = "World"
    startTimeCode = 1
    endTimeCode = 2
    timeCodesPerSecond = 24
    metersPerUnit = 1
    upAxis = "Y"
)
def Xform "World"
{
    double3 xformOp:translate = (0, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Cube "Smoke" ( prepend apiSchemas = ["SmokeDomainAPI"] ) {
        double size = 2
        int smoke:resolution = 5
        double3 xformOp:translate = (0, 1, 0)
        float xformOp:rotateY = 0
        float3 xformOp:scale = (1, 1, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY", "xformOp:scale"]
    }
    def Sphere "Source" ( prepend apiSchemas = ["SmokeEmitterAPI"] ) {
        double radius = 0.4
        double3 xformOp:translate.timeSamples = { 1: (0, 0.5, 0), 2: (0.1, 0.5, 0) }
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Points "Sparks" ( prepend apiSchemas = ["SmokeEmitterAPI"] ) {
        point3f[] points = [(0, 0.5, 0.3), (0, 0.6, 0.3)]
        float[] widths = [0.2, 0.1]
    }
    def Capsule "Pole" ( prepend apiSchemas = ["SmokeColliderAPI"] ) {
        double radius = 0.2
        double height = 0.3
        token axis = "Y"
        matrix4d xformOp:transform = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 1.3, 0, 1) )
        uniform token[] xformOpOrder = ["xformOp:transform"]
    }
    def Mesh "Floor" ( prepend apiSchemas = ["SmokeReceiverAPI", "MaterialBindingAPI"] ) {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        int[] holeIndices = []
        point3f[] points = [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)]
        normal3f[] normals = [(0, 1, 0)] ( interpolation = "uniform" )
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] ( interpolation = "vertex" )
        int[] primvars:st:indices = [0, 1, 2, 3]
        uniform token subdivisionScheme = "none"
        int smoke:textureSize = 8
        rel material:binding = </World/Look>
    }
    def Plane "Wall" {
        token axis = "Z"
    }
    def Cone "Hat" {
        double3 xformOp:translate = (1, 2, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def PointInstancer "Many" {
        int[] protoIndices = [0, 0]
        point3f[] positions = [(1, 0, 0), (-1, 0, 0)]
        quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0)]
        float3[] scales = [(0.1, 0.1, 0.1), (0.2, 0.2, 0.2)]
        int64[] ids = [3, 5]
        int64[] invisibleIds = []
        vector3f[] velocities = [(0, 0, 0), (0, 1, 0)]
        vector3f[] angularVelocities = [(0, 0, 0), (0, 1, 0)]
        rel prototypes = [</World/Many/Box>]
        def Cube "Box" { }
    }
    def Material "Look" ( prepend apiSchemas = ["SmokeMaterialAPI"] ) {
        token outputs:surface.connect = </World/Look/Surface.outputs:surface>
        def Shader "Surface" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0.5, 0.5, 0.5)
            color3f inputs:emissiveColor = (0, 0, 0)
            color3f inputs:specularColor = (0, 0, 0)
            int inputs:useSpecularWorkflow = 0
            float inputs:metallic = 0
            float inputs:roughness = 0.5
            float inputs:ior = 1.5
            float inputs:opacity = 1
            token outputs:surface
        }
    }
    def SphereLight "Lamp" ( prepend apiSchemas = ["SmokeLightAPI", "ShadowAPI", "ShapingAPI"] ) {
        double3 xformOp:translate = (1.5, 3.5, 1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        int smoke:shadowMapSize = 8
    }
    def SphereLight "Bulb" ( prepend apiSchemas = ["SmokeLightAPI"] ) {
        float inputs:exposure = 2
        bool inputs:enableColorTemperature = 1
        float inputs:colorTemperature = 6500
        double3 xformOp:translate = (-1.5, 3.5, 1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        int smoke:shadowMapSize = 8
    }
    def DistantLight "Sun" ( prepend apiSchemas = ["SmokeLightAPI"] ) {
        float3 xformOp:rotateXYZ = (-60, 20, 0)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
        int smoke:shadowMapSize = 8
    }
    def RectLight "Window" ( prepend apiSchemas = ["SmokeLightAPI"] ) {
        int smoke:shadowMapSize = 8
    }
    def DomeLight "Sky" { }
    def Camera "Eye" {
        double3 xformOp:translate = (0, 1, 6)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""

_Types = Sdf.ValueTypeNames
_OTHER_TYPES = (
    *(_Types.String, _Types.Int, _Types.Float, _Types.Double, _Types.Bool, _Types.Token, _Types.Asset, _Types.Half),
    *(_Types.TokenArray, _Types.FloatArray, _Types.IntArray, _Types.Point3fArray, _Types.StringArray),
    *(_Types.Float2, _Types.Float3, _Types.Color3f, _Types.Matrix4d),
)
_EXTREMES = (0.0, -0.0, 1.0, -1.0, 1e-300, 1e-30, 1e-6, 1e6, 1e30, -1e30, 3e38, 1e300, float("inf"), float("nan"))
_numbers = st.sampled_from(_EXTREMES) | st.floats() | st.floats(-10.0, 10.0)
_whole = st.sampled_from((0, 1, -1, 2, 3, 2**31 - 1, -(2**31))) | st.integers(-10, 10)
_WORDS = (
    *(
        "",
        "none",
        "X",
        "Y",
        "Z",
        "constant",
        "vertex",
        "faceVarying",
        "uniform",
        "leftHanded",
        "invisible",
        "inherited",
    ),
    *("guide", "proxy", "closed", "open", "lit", "normal", "hard", "area", "exact", "ray_traced", "dpd", "surface"),
    *("checker", "mandelbrot", "linear", "polynomial", "catmullClark", "orthographic", "é", "missing.png"),
)
_words = st.sampled_from(_WORDS) | st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), max_size=5)
_SCALARS = {bool: st.booleans(), int: _whole, float: _numbers, str: _words}


@cache
def values_of(kind: Sdf.ValueTypeName) -> st.SearchStrategy | None:
    """Values of a type of attribute; None for types without values."""
    one = kind.scalarType.defaultValue
    if type(one) in _SCALARS:
        values = _SCALARS[type(one)]
    elif isinstance(one, Sdf.AssetPath):
        values = _words.map(Sdf.AssetPath)
    elif isinstance(one, Gf.Matrix4d | Gf.Quath | Gf.Quatf | Gf.Quatd):
        count = 16 if isinstance(one, Gf.Matrix4d) else 4
        values = st.lists(_numbers, min_size=count, max_size=count).map(lambda numbers: type(one)(*numbers))
    elif hasattr(one, "__len__"):
        values = st.lists(_numbers, min_size=len(one), max_size=len(one)).map(type(one))
    else:
        return None
    return st.lists(values, max_size=6) if kind.isArray else values


def open_stage() -> Usd.Stage:
    """The stage, in memory."""
    register_schema()
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(STAGE)
    return Usd.Stage.Open(layer)


def _attributes() -> list[Usd.Attribute]:
    """The attributes that its prims have by their types and schemas, set or not."""
    every = (attribute for prim in _ORIGINAL.Traverse() for attribute in prim.GetAttributes())
    return [each for each in every if values_of(each.GetTypeName()) is not None]


def _set(path: Sdf.Path, value: object, time: float | None) -> Callable[[Usd.Stage], None]:
    return lambda stage: stage.GetAttributeAtPath(path).Set(value, Usd.TimeCode.Default() if time is None else time)


def _block(path: Sdf.Path) -> Callable[[Usd.Stage], None]:
    return lambda stage: stage.GetAttributeAtPath(path).Block()


def _retype(path: Sdf.Path, kind: Sdf.ValueTypeName, value: object) -> Callable[[Usd.Stage], None]:
    def change(stage: Usd.Stage) -> None:
        prim = stage.GetRootLayer().GetPrimAtPath(path.GetPrimPath())
        if path.name in prim.properties:
            prim.RemoveProperty(prim.properties[path.name])
        Sdf.AttributeSpec(prim, path.name, kind).default = value

    return change


def _changes_of(attribute: Usd.Attribute) -> st.SearchStrategy:
    path, values = attribute.GetPath(), values_of(attribute.GetTypeName())
    times = st.sampled_from((None, None, None, 1.0, 2.0))
    usual = st.builds(_set, st.just(path), values, times)
    other = st.sampled_from(_OTHER_TYPES).flatmap(
        lambda kind: st.builds(_retype, st.just(path), st.just(kind), values_of(kind))
    )
    return usual | usual | usual | other | st.just(_block(path))


_ORIGINAL = open_stage()
# What to do to the stage: set attributes to any value, block them, or give them another type.
changes = st.lists(st.sampled_from(_attributes()).flatmap(_changes_of), min_size=1, max_size=4)
