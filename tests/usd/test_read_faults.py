"""Values that are not allowed or not supported: named in one line, with prim and attribute."""

import pytest
from stage_text import DOMAIN, EMITTER, HEADER, QUAD, line_of, scene_of


@pytest.mark.parametrize(
    ("prims", "warning"),
    [
        (DOMAIN % "float smoke:viscosity = 0.5", None),
        (DOMAIN % "vector3f smoke:wind = (0, 0, 3)", None),
        (EMITTER % "float smoke:noiseScale = 1", None),
        (EMITTER % 'token smoke:source = "volume"', None),
        (
            EMITTER % "float smoke:densty = 1",
            "/World/Source: smoke:densty is not an attribute of any smoke schema; did you mean smoke:density?",
        ),
        (EMITTER % "float smoke:zzz = 1", "/World/Source: smoke:zzz is not an attribute of any smoke schema"),
        (
            'def Cube "A" { int smoke:resoluton = 64 }',
            "/World/A: smoke:resoluton is not an attribute of any smoke schema; did you mean smoke:resolution?",
        ),
        (
            'def Cube "A" ( apiSchemas = ["SmokeEmiterAPI"] ) { }',
            "/World/A: apiSchemas has SmokeEmiterAPI, which is unknown; did you mean SmokeEmitterAPI?",
        ),
        (
            'def Cube "A" ( apiSchemas = ["smokeEmitterAPI"] ) { }',
            "/World/A: apiSchemas has smokeEmitterAPI, which is unknown; did you mean SmokeEmitterAPI?",
        ),
        (
            'def Cube "A" { float smoke:thickness = 2 }',
            "/World/A: smoke:thickness has no effect, since SmokeColliderAPI is not applied",
        ),
        (
            DOMAIN % "float smoke:vorticity.timeSamples = { 1: 0.5, 2: 1 }",
            "/World/Box: smoke:vorticity changes in time, which is not supported; its first value is used",
        ),
        (
            'def Cube "A" ( apiSchemas = ["SmokeReceiverAPI"] ) { }',
            "/World/A: SmokeReceiverAPI on a Cube has no effect: only a Mesh has texture coordinates",
        ),
        (
            f'def Mesh "A" ( apiSchemas = ["SmokeReceiverAPI"] ) {{ {QUAD} token purpose = "proxy" }}',
            "/World/A: SmokeReceiverAPI has no effect, since the mesh is invisible or a guide or proxy",
        ),
        ('def BasisCurves "C" { }', "/World/C: a BasisCurves is not supported; it is left out"),
        ('def BasisCurves "C" { token purpose = "guide" }', None),
        ('def Volume "V" { }', "/World/V: a Volume is not supported; it is left out"),
        ('def Volume "V" { rel smokeVolume:domain = </World/Box> }', None),
        ('def SkelRoot "S" { }', "/World/S: skinning is not supported; meshes keep their points"),
        (
            'def Camera "C" { token projection = "orthographic" }',
            "/World/C: orthographic cameras are not supported; it is used as a perspective one",
        ),
    ],
)
def test_what_is_not_supported_is_named_once(tmp_path, prims, warning):
    """Each unsupported thing gives one warning with prim and attribute; at its default value it gives none."""
    assert scene_of(tmp_path, prims).warnings == (() if warning is None else (warning,))


@pytest.mark.parametrize(
    ("prims", "line"),
    [
        (
            DOMAIN % "int smoke:resolution = 0",
            "/World/Box: smoke:resolution is 0; allowed: whole numbers from 1 to 4096",
        ),
        (
            DOMAIN % 'string smoke:resolution = "64"',
            '/World/Box: smoke:resolution is "64"; allowed: whole numbers from 1 to 4096',
        ),
        (
            EMITTER % 'string smoke:enabled = "true"',
            '/World/Source: smoke:enabled is "true"; allowed: true or false',
        ),
        (DOMAIN % "float smoke:extinction = -0.1", "/World/Box: smoke:extinction is -0.1; allowed: ≥ 0"),
        (DOMAIN % "float smoke:timeScale = nan", "/World/Box: smoke:timeScale is nan; allowed: a finite number"),
        (
            DOMAIN % 'token smoke:advection = "upwind"',
            "/World/Box: smoke:advection is upwind; allowed: semi_lagrangian, semi_lagrangian_cubic, maccormack, bfecc",
        ),
        (
            DOMAIN % 'token[] smoke:grids = ["heat"]',
            "/World/Box: smoke:grids is heat; allowed: density, temperature, velocity, light",
        ),
        (
            DOMAIN % 'token[] smoke:boundary = ["open"]',
            "/World/Box: smoke:boundary is ('open',); allowed: six tokens, one for each of -x +x -y +y -z +z",
        ),
        (
            'def Cube "Box" ( apiSchemas = ["SmokeDomainAPI"] ) { double size = -2 }',
            "/World/Box: size is -2.0; allowed: > 0",
        ),
        (
            'def Xform "Box" ( apiSchemas = ["SmokeDomainAPI"] ) { }',
            "/World/Box: extent is None; allowed: the two corners of the domain's box",
        ),
        (
            'def Volume "Box" ( apiSchemas = ["SmokeDomainAPI"] ) { float3[] extent = [(0, 0, 0), (1, -1, 1)] }',
            "/World/Box: extent is (1.0, -1.0, 1.0); allowed: greater than lower (0.0, 0.0, 0.0) on each axis",
        ),
        (
            DOMAIN % 'float3 xformOp:scale = (1, 0, 1)\ntoken[] xformOpOrder = ["xformOp:scale"]',
            "/World/Box: xformOp:* is [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]; "
            "allowed: axes of non-zero length at right angles",
        ),
        (EMITTER % "float smoke:density = -1", "/World/Source: smoke:density is -1.0; allowed: ≥ 0"),
        (
            EMITTER % "float smoke:density.timeSamples = { 1: 1, 2: -3 }",
            "/World/Source: smoke:density is [1.0, -3.0]; allowed: ≥ 0",
        ),
        (
            EMITTER % "vector3f smoke:velocity = (0, inf, 0)",
            "/World/Source: smoke:velocity is (0.0, inf, 0.0); allowed: 3 finite numbers",
        ),
        (EMITTER % "int smoke:enabled = 1", "/World/Source: smoke:enabled is 1; allowed: true or false"),
        (EMITTER % 'string smoke:rate = "high"', '/World/Source: smoke:rate is "high"; allowed: a finite number'),
        (
            'def Xform "G" ( apiSchemas = ["SmokeEmitterAPI"] ) { }',
            "/World/G: apiSchemas is SmokeEmitterAPI on Xform; "
            "allowed: that schema on a Mesh, Sphere, Cube, Cylinder, Cone, Capsule or Plane; SmokeEmitterAPI on Points",
        ),
        (
            'def Cube "C" ( apiSchemas = ["SmokeColliderAPI"] ) { float smoke:thickness = -1 }',
            "/World/C: smoke:thickness is -1.0; allowed: ≥ 0",
        ),
        (
            f'def Mesh "F" ( apiSchemas = ["SmokeReceiverAPI"] ) {{ {QUAD} token[] smoke:bake = ["shadow"] }}',
            "/World/F: smoke:bake is shadow; allowed: lit, irradiance, visibility, smokeShadow, normal, depth",
        ),
        (
            f'def Mesh "F" ( apiSchemas = ["SmokeReceiverAPI"] ) {{ {QUAD} int smoke:textureSize = -1 }}',
            "/World/F: smoke:textureSize is -1; allowed: whole numbers from 1 to 16384",
        ),
        (
            'def Cube "C" { double3 xformOp:translate = (nan, 0, 0)\ntoken[] xformOpOrder = ["xformOp:translate"] }',
            "/World/C: xformOp:* is [[nan nan nan nan] [nan nan nan nan] [nan nan nan nan] [nan nan nan nan]]; "
            "allowed: 4 × 4 finite numbers",
        ),
        ('def Camera "C" { float focalLength = 0 }', "/World/C: focalLength is 0.0; allowed: > 0"),
        (
            DOMAIN % 'string smoke:grids = "density"',
            '/World/Box: smoke:grids is "density"; allowed: a list of density, temperature, velocity, light',
        ),
        (
            'def SphereLight "L" { float inputs:exposure = 1e30 }',
            "/World/L: inputs:exposure is 1e+30; allowed: −100 to 100",
        ),
        (
            'def SphereLight "L" { bool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = -5 }',
            "/World/L: inputs:colorTemperature is -5.0; allowed: > 0",
        ),
        (
            'def Mesh "M" { float[] points = [1, 2, 3] }',
            "/World/M: points is [1, 2, 3]; allowed: an array of numbers, 3 each",
        ),
        (
            'def Mesh "M" { point3f[] points = [(0, 0, 0)]\nfloat[] faceVertexIndices = [0.5] }',
            "/World/M: faceVertexIndices is [0.5]; allowed: an array of whole numbers",
        ),
    ],
)
def test_bad_values_are_named_in_one_line(tmp_path, prims, line):
    """Each bad value raises one line with file, prim, attribute, value and what is allowed."""
    assert line_of(tmp_path, prims) == line


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ('defaultPrim = "World"', "", "/: defaultPrim is unset; allowed: the name of a root prim"),
        ('defaultPrim = "World"', 'defaultPrim = "Else"', "/: defaultPrim is unset; allowed: the name of a root prim"),
        ("endTimeCode = 4", "endTimeCode = -2", "/: endTimeCode is -2; allowed: whole numbers from 1 to 1000000000"),
        (
            "startTimeCode = 1",
            "startTimeCode = 0.5",
            "/: startTimeCode is 0.5; allowed: whole numbers from -1000000000 to 1000000000",
        ),
        ("metersPerUnit = 1", "metersPerUnit = -1", "/: metersPerUnit is -1.0; allowed: > 0"),
        ("timeCodesPerSecond = 24", "timeCodesPerSecond = 0", "/: timeCodesPerSecond is 0.0; allowed: > 0"),
        ('upAxis = "Y"', 'upAxis = "W"', "/: upAxis is W; allowed: X, Y, Z"),
    ],
)
def test_bad_settings_are_named_in_one_line(tmp_path, old, new, line):
    """Bad stage metadata raises one line with file, metadata name, value and what is allowed."""
    assert line_of(tmp_path, "", HEADER.replace(old, new)) == line


def test_frames_that_are_not_time_codes_are_warned_of(tmp_path):
    """A frame is a time code, whatever framesPerSecond says."""
    scene = scene_of(tmp_path, "", HEADER.replace("upAxis", "framesPerSecond = 12\n    upAxis"))
    assert scene.warnings == (
        "/: framesPerSecond differs from timeCodesPerSecond, which is not supported; each time code is a frame",
    )
