import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pxr import Usd
from stage_text import HEADER, QUAD, scene_of, write_stage

from warp_smoke.geometry import Mesh
from warp_smoke.record import Samples
from warp_smoke.scene import Collider, Emitter, Receiver, Scene, SmokeDomain, Surface
from warp_smoke.usd.read import read_stage

DOMAIN = """def Cube "Box" ( prepend apiSchemas = ["SmokeDomainAPI"] ) { double size = 4
%s }"""
EMITTER = """def Sphere "Source" ( prepend apiSchemas = ["SmokeEmitterAPI"] ) { token purpose = "guide"
%s }"""


def line_of(folder, prims, header=HEADER):
    """What is said of a bad stage, without its file."""
    with pytest.raises(ValueError, match="allowed") as error:
        scene_of(folder, prims, header)
    text = str(error.value)
    assert "\n" not in text
    assert text.startswith(f"{folder / 'scene.usda'}: ")
    return text.removeprefix(f"{folder / 'scene.usda'}: ")


def test_stage_settings(tmp_path):
    """Times, unit and axis are the stage's."""
    header = """#usda 1.0
(
    defaultPrim = "World"
    startTimeCode = -3
    endTimeCode = 12
    timeCodesPerSecond = 30
    metersPerUnit = 0.001
    upAxis = "Z"
)"""
    scene = scene_of(tmp_path, "", header)
    expected = Scene(start=-3, end=12, time_codes_per_second=30.0, meters_per_unit=0.001, up_axis="Z")
    assert scene == expected
    assert scene.source == tmp_path / "scene.usda"
    assert scene.warnings == ()


def test_unset_stage_settings(tmp_path):
    """What a stage leaves open is as in USD: centimetres, Y up, 24 a second; frames 1 to 48, said if there is smoke."""
    header = '#usda 1.0\n( defaultPrim = "World" )'
    scene = scene_of(tmp_path, "", header)
    assert scene == Scene(start=1, end=48, time_codes_per_second=24.0, meters_per_unit=0.01, up_axis="Y")
    assert scene.warnings == ()
    smoky = scene_of(tmp_path, DOMAIN % "", header)
    assert smoky.warnings == (
        "/: metersPerUnit is unset, which in USD makes a unit a centimetre: /World/Box is 0.04 × 0.04 × 0.04 m",
        "/: no start and end time codes; 1 to 48 are used",
    )


def test_smoke_records(tmp_path):
    """A domain, an emitter, a collider and a receiver with all kinds of values: equal to the records in Python."""
    scene = scene_of(
        tmp_path,
        """
    def Cube "Box" ( prepend apiSchemas = ["SmokeDomainAPI"] ) {
        double size = 4
        double3 xformOp:translate = (0, 2, 0)
        token[] xformOpOrder = ["xformOp:translate"]
        int smoke:resolution = 12
        token[] smoke:boundary = ["open", "closed", "open", "closed", "open", "closed"]
        float smoke:buoyancyTemperature = 0.1
        token smoke:advection = "maccormack"
        float smoke:pressureTolerance = 0.001 }
    def Sphere "Source" ( prepend apiSchemas = ["SmokeEmitterAPI"] ) {
        token purpose = "guide"
        double radius = 0.5
        float smoke:rate = 3
        float smoke:density.timeSamples = { 1: 0.5, 3: 1.5 }
        bool smoke:enabled.timeSamples = { 1: true, 4: false }
        vector3f smoke:velocity = (0, 0.2, 0) }
    def Cylinder "Pole" ( prepend apiSchemas = ["SmokeColliderAPI", "SmokeEmitterAPI"] ) {
        token axis = "Y"
        float smoke:thickness = 1.5
        float smoke:temperature = 0 }
    def Mesh "Floor" ( prepend apiSchemas = ["SmokeReceiverAPI"] ) {
        token[] smoke:bake = ["lit", "smokeShadow"]
        int smoke:textureSize = 64
        bool smoke:receiveShadow = false"""
        + QUAD
        + "}",
    )
    pole, floor = Mesh.cylinder(axis="Y"), Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    moved = np.eye(4)
    moved[3, 1] = 2
    assert scene.domains == (
        SmokeDomain(
            path="/World/Box",
            transform=moved,
            lower=(-2, -2, -2),
            upper=(2, 2, 2),
            resolution=12,
            boundary=("open", "closed") * 3,
            buoyancy_temperature=0.1,
            advection="maccormack",
            pressure_tolerance=0.001,
        ),
    )
    assert scene.emitters == (
        Emitter(
            path="/World/Source",
            mesh=Mesh.sphere(0.5),
            rate=3.0,
            density=Samples([1, 3], [0.5, 1.5]),
            enabled=Samples([1, 4], [True, False]),
            velocity=(0.0, 0.2, 0.0),
        ),
        Emitter(path="/World/Pole", mesh=pole, temperature=0.0),
    )
    assert scene.colliders == (Collider(path="/World/Pole", mesh=pole, thickness=1.5),)
    receiver = Receiver(path="/World/Floor", bake=("lit", "smokeShadow"), texture_size=64, receive_shadow=False)
    assert scene.surfaces == (
        Surface(path="/World/Pole", mesh=pole),
        Surface(path="/World/Floor", mesh=floor, receiver=receiver),
    )
    assert scene.warnings == ()


@pytest.mark.parametrize(
    ("prim", "lower", "upper"),
    [
        ('def Cube "B" ( apiSchemas = ["SmokeDomainAPI"] ) { double size = 3 }', (-1.5,) * 3, (1.5,) * 3),
        (
            'def Volume "B" ( apiSchemas = ["SmokeDomainAPI"] ) { float3[] extent = [(0, 0, 0), (1, 2, 0.1)] }',
            (0, 0, 0),
            (1, 2, 0.1),
        ),
        (
            'def Xform "B" ( apiSchemas = ["SmokeDomainAPI"] ) { float3[] extent = [(-1, 0, 0), (1, 2, 3)] }',
            (-1, 0, 0),
            (1, 2, 3),
        ),
        (
            """def Mesh "B" ( apiSchemas = ["SmokeDomainAPI"] ) {
            int[] faceVertexCounts = [3]
            int[] faceVertexIndices = [0, 1, 2]
            point3f[] points = [(0, 0, 0), (1, 0, 2), (0, 3, 0)] }""",
            (0, 0, 0),
            (1, 3, 2),
        ),
    ],
)
def test_boxes_of_domains(tmp_path, prim, lower, upper):
    """A domain's box is the cube's size, the authored extent, or the extent of the shape; it is not part of the set."""
    scene = scene_of(tmp_path, prim)
    assert scene.domains == (SmokeDomain(path="/World/B", lower=lower, upper=upper),)
    assert scene.surfaces == ()


def test_linear_motion_is_sampled_where_it_is_authored(tmp_path):
    """A transform that is linear between samples keeps exactly these, and nested still transforms are multiplied in."""
    scene = scene_of(
        tmp_path,
        """def Xform "Group" {
        float3 xformOp:scale = (2, 2, 2)
        token[] xformOpOrder = ["xformOp:scale"]
        def Cube "A" {
            double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 2.5: (3, 0, 0) }
            token[] xformOpOrder = ["xformOp:translate"] } }""",
    )
    transform = scene.surfaces[0].transform
    assert np.array_equal(transform.times, [1, 2.5])
    assert np.array_equal(transform.at(1.75), [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [3, 0, 0, 1]])


def test_other_motion_is_sampled_on_every_frame_too(tmp_path):
    """A turning prim under a sliding group: samples where either has one and on all frames, equal to USD's matrices."""
    path = write_stage(
        tmp_path,
        """def Xform "Group" {
        double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 3.5: (5, 0, 0) }
        token[] xformOpOrder = ["xformOp:translate"]
        def Cube "A" {
            float xformOp:rotateY.timeSamples = { 2: 0, 6: 90 }
            token[] xformOpOrder = ["xformOp:rotateY"] } }""",
    )
    transform = Scene.open(path).surfaces[0].transform
    assert np.array_equal(transform.times, [1, 2, 3, 3.5, 4, 5, 6])
    c = np.sqrt(0.5)
    assert np.allclose(transform.at(4), [[c, 0, -c, 0], [0, 1, 0, 0], [c, 0, c, 0], [5, 0, 0, 1]], atol=1e-7)
    assert np.allclose(transform.at(2)[3], (2, 0, 0, 1))


def test_samples_without_change_are_a_plain_value(tmp_path):
    """Time samples that all say the same make nothing move."""
    scene = scene_of(
        tmp_path,
        """def Cube "A" {
        float xformOp:rotateY.timeSamples = { 1: 30, 4: 30 }
        token[] xformOpOrder = ["xformOp:rotateY"]
        token visibility.timeSamples = { 1: "inherited", 2: "inherited" } }""",
    )
    assert isinstance(scene.surfaces[0].transform, np.ndarray)
    assert scene.surfaces[0].visible is True


def test_reset_xform_stack(tmp_path):
    """A prim that resets its transform stack does not follow its parent."""
    scene = scene_of(
        tmp_path,
        """def Xform "Group" {
        double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 3: (5, 0, 0) }
        token[] xformOpOrder = ["xformOp:translate"]
        def Cube "A" { token[] xformOpOrder = ["!resetXformStack!"] } }""",
    )
    assert np.array_equal(scene.surfaces[0].transform, np.eye(4))


def test_splines_are_sampled_on_every_frame(tmp_path):
    """A transform driven by a spline is sampled at its knots and the whole times between."""
    scene = scene_of(
        tmp_path,
        """def Cube "A" {
        double xformOp:translateX.spline = { bezier, 1: 0; post curve (0, 0), 4: 3; post curve (0, 0) }
        token[] xformOpOrder = ["xformOp:translateX"] }""",
    )
    assert np.array_equal(scene.surfaces[0].transform.times, [1, 2, 3, 4])
    assert np.allclose(scene.surfaces[0].transform.values[[0, 3], 3, 0], [0, 3])


@pytest.mark.parametrize(
    ("attributes", "part_of_the_set"),
    [
        ("", True),
        ('token purpose = "render"', True),
        ('token purpose = "guide"', False),
        ('token purpose = "proxy"', False),
        ('token visibility = "invisible"', False),
        ('token visibility.timeSamples = { 1: "invisible", 3: "inherited" }', True),
    ],
)
def test_guides_and_hidden_prims_are_no_part_of_the_set(tmp_path, attributes, part_of_the_set):
    """Guides, proxies and what is never visible cast no shadow, but emit and collide."""
    scene = scene_of(
        tmp_path, f'def Cube "A" ( apiSchemas = ["SmokeEmitterAPI", "SmokeColliderAPI"] ) {{ {attributes} }}'
    )
    assert len(scene.surfaces) == part_of_the_set
    assert len(scene.emitters) == len(scene.colliders) == 1


def test_visibility_comes_from_above_and_is_held(tmp_path):
    """An invisible parent hides its children until the sample at which it appears."""
    scene = scene_of(
        tmp_path,
        """def Xform "Group" {
        token visibility.timeSamples = { 1: "invisible", 3: "inherited" }
        def Cube "A" { } }""",
    )
    visible = scene.surfaces[0].visible
    assert [bool(visible.at(time)) for time in (1, 2, 2.9, 3, 4)] == [False, False, False, True, True]


def test_instances_and_references_are_followed(tmp_path):
    """Two native instances of a referenced file are two surfaces in two places, with the one's shape."""
    (tmp_path / "ball.usda").write_text(
        '#usda 1.0\n( defaultPrim = "Ball" )\ndef Xform "Ball" {\n def Sphere "Shape" {\n double radius = 2\n}\n}\n'
    )
    scene = scene_of(
        tmp_path,
        "".join(
            f"""def "I{x}" ( instanceable = true\n references = @./ball.usda@ ) {{
            double3 xformOp:translate = ({x}, 0, 0)
            token[] xformOpOrder = ["xformOp:translate"] }}\n"""
            for x in (1, 5)
        ),
    )
    assert [surface.path for surface in scene.surfaces] == ["/World/I1/Shape", "/World/I5/Shape"]
    assert [surface.transform[3, 0] for surface in scene.surfaces] == [1, 5]
    assert scene.surfaces[0].mesh is scene.surfaces[1].mesh
    assert scene.surfaces[0].mesh == Mesh.sphere(2.0)


def test_first_camera_under_the_default_prim(tmp_path):
    """The camera is the default prim's first, which is said; one elsewhere is taken only if there is no other."""
    other = '\ndef Camera "Aside" { float focalLength = 10 }\n'.replace(" }", "\n}")
    inside = 'def Camera "One" { float focalLength = 35\nfloat2 clippingRange = (0.1, 20) }\ndef Camera "Two" { }'
    path = write_stage(tmp_path, inside, HEADER + other)
    scene = Scene.open(path)
    camera = scene.camera
    assert (camera.path, camera.focal_length, camera.near, camera.far) == ("/World/One", 35.0, 0.1, 20.0)
    used = "/World/One: of 3 cameras it is used: the first under the default prim, or else the first"
    assert scene.warnings == (used,)
    path = write_stage(tmp_path, "", HEADER + other)
    assert Scene.open(path).camera.path == "/Aside"
    assert Scene.open(path).warnings == ()


def test_a_domain_stands_still(tmp_path):
    """A domain whose transform changes in time stays where it is at the start, which is said."""
    moving = """double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 2: (0, 4, 0) }
        token[] xformOpOrder = ["xformOp:translate"]"""
    scene = scene_of(tmp_path, DOMAIN % moving)
    assert scene.domains[0].transform[3, 1] == 2.0
    text = "/World/Box: its transform changes in time, which is not supported; it stays as it is at the start"
    assert scene.warnings == (text,)


@pytest.mark.parametrize(
    ("prims", "warning"),
    [
        (DOMAIN % "float smoke:viscosity = 0.5", None),
        (DOMAIN % "vector3f smoke:wind = (0, 0, 3)", None),
        (EMITTER % "float smoke:noiseScale = 1", None),
        (EMITTER % 'token smoke:source = "volume"', None),
        (EMITTER % "float smoke:densty = 1", "/World/Source: smoke:densty is not an attribute of any smoke schema"),
        (
            'def Cube "A" ( apiSchemas = ["SmokeEmiterAPI"] ) { }',
            "/World/A: apiSchemas has SmokeEmiterAPI, which is unknown; did you mean SmokeEmitterAPI?",
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


def test_prototypes_of_a_point_instancer_are_not_read(tmp_path):
    """What lies below a PointInstancer is not part of the set by itself: without instances there is none."""
    assert scene_of(tmp_path, 'def PointInstancer "P" { def Cube "Prototype" { } }').surfaces == ()


@pytest.mark.parametrize(
    ("prims", "line"),
    [
        (
            DOMAIN % "int smoke:resolution = 0",
            "/World/Box: smoke:resolution is 0; allowed: whole numbers from 1 to 4096",
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
        (EMITTER % 'string smoke:rate = "high"', "/World/Source: smoke:rate is high; allowed: a finite number"),
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
            "/World/F: smoke:bake is shadow; allowed: lit, irradiance, visibility, smokeShadow, normal",
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
            "/World/Box: smoke:grids is density; allowed: a list of density, temperature, velocity, light",
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


def test_missing_file():
    """A stage that is not there."""
    with pytest.raises(ValueError, match=r"^nowhere/none\.usda: no such file$"):
        Scene.open("nowhere/none.usda")


def test_folder_instead_of_a_file(tmp_path):
    """A folder is no stage."""
    with pytest.raises(ValueError, match="is a folder; allowed: the file of a stage"):
        Scene.open(tmp_path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("broken.usda", b'#usda 1.0\ndef Xform "A" {\n  int x =\n}\n'),
        ("noise.usd", bytes(range(256)) * 8),
        ("noise.usdc", bytes(range(256)) * 8),
        ("noise.usdz", bytes(range(256)) * 8),
        ("empty.usda", b""),
        ("picture.png", b"\x89PNG"),
    ],
)
def test_files_that_do_not_parse(tmp_path, capfd, name, content):
    """What is not USD is said in one line naming the file, and USD prints nothing."""
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match="not a USD stage") as error:
        Scene.open(path)
    assert str(error.value).startswith(f"{path}: not a USD stage: ")
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_syntax_errors_say_where(tmp_path):
    """The line number of a syntax error reaches the user."""
    path = tmp_path / "broken.usda"
    path.write_text('#usda 1.0\ndef Xform "A"\n{\n  int x =\n}\n')
    with pytest.raises(ValueError, match=r"broken\.usda:4:3"):
        Scene.open(path)


@given(st.binary(min_size=1, max_size=400), st.integers(0, 60))
@settings(max_examples=60, deadline=None)
def test_noise_never_crashes(tmp_path_factory, noise, keep):
    """A stage's first bytes with noise after them: refused in one line, without a crash."""
    path = tmp_path_factory.mktemp("noise") / "noise.usda"
    path.write_bytes(HEADER.encode()[:keep] + noise)
    with pytest.raises(ValueError, match=r"not a USD stage|defaultPrim is unset") as error:
        Scene.open(path)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("prim", "asset", "place"),
    [
        ('def "A" ( references = @./gone.usd@ ) { }', "gone.usd@", "/World/A"),
        ('def "A" ( payload = @gone.usd@ ) { }', "@gone.usd@", "/World/A"),
        ('def "A" ( references = </Nowhere> ) { }', "</Nowhere>", "/World/A"),
    ],
)
def test_missing_references(tmp_path, capfd, prim, asset, place):
    """A reference or payload that is not there is said in one line naming file, prim and asset; USD prints nothing."""
    path = write_stage(tmp_path, prim)
    with pytest.raises(ValueError, match=r"gone|Nowhere") as error:
        Scene.open(path)
    assert str(error.value).startswith(f"{path}: {place}: ")
    assert asset in str(error.value)
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_what_else_usd_finds_wrong_is_a_warning(tmp_path):
    """A prim that refers to itself is left as USD leaves it; USD's words become one warning on one line."""
    scene = scene_of(tmp_path, 'def Cube "A" ( references = </World/A> ) { }')
    assert len(scene.surfaces) == 1
    (warning,) = scene.warnings
    assert warning.startswith("/World/A: Cycle detected")
    assert "\n" not in warning


def test_missing_sublayer(tmp_path):
    """A sublayer that is not there is said in one line naming it."""
    with pytest.raises(ValueError, match=r"^[^\n]*Could not load sublayer @[^\n]*gone\.usda@[^\n]*$"):
        scene_of(tmp_path, "", HEADER.replace("upAxis", "subLayers = [@./gone.usda@]\n    upAxis"))


def test_stage_in_memory():
    """A stage that was made in this process is read without a file."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetDefaultPrim(stage.DefinePrim("/World", "Xform"))
    ball = stage.DefinePrim("/World/Ball", "Sphere")
    scene = read_stage(stage, "memory")
    assert scene.surfaces == (Surface(path="/World/Ball", mesh=Mesh.sphere()),)
    assert scene.source is None
    ball.GetAttribute("radius").Set(0.0)
    with pytest.raises(ValueError, match=r"^memory: /World/Ball: radius is 0\.0; allowed: > 0$"):
        read_stage(stage, "memory")
