"""What is read of a stage: its settings, the smoke's records, and which prims are part of the set."""

import numpy as np
import pytest
from pxr import Usd
from stage_text import DOMAIN, HEADER, QUAD, scene_of, write_stage

from warp_smoke.geometry import Mesh
from warp_smoke.record import Samples
from warp_smoke.scene import Collider, Emitter, Receiver, Scene, SmokeDomain, Surface
from warp_smoke.usd.read import read_stage


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


def test_zoom_and_shift_of_a_camera(tmp_path):
    """Each number of the lens may change in time, as by a zoom that is keyframed."""
    scene = scene_of(
        tmp_path,
        """def Camera "Eye" {
        float focalLength.timeSamples = { 1: 20, 3: 40 }
        float horizontalAperture = 20
        float verticalAperture = 10
        float horizontalApertureOffset.timeSamples = { 1: 0, 3: 4 } }""",
    )
    assert scene.warnings == ()
    assert scene.camera.focal_length == Samples([1, 3], [20.0, 40.0])
    assert scene.camera.lens_at(1) == (1.0, 0.5, 0.0, 0.0)
    assert scene.camera.lens_at(2) == pytest.approx((20 / 30, 10 / 30, 2 / 30, 0.0))


def test_first_camera_under_the_default_prim(tmp_path):
    """The camera is the default prim's first, which is said; one elsewhere is taken only if there is no other."""
    other = '\ndef Camera "Aside" { float focalLength = 10 }\n'.replace(" }", "\n}")
    inside = 'def Camera "One" { float focalLength = 35\nfloat2 clippingRange = (0.1, 20) }\ndef Camera "Two" { }'
    path = write_stage(tmp_path, inside, HEADER + other)
    scene = Scene.open(path)
    camera = scene.camera
    assert (camera.path, camera.focal_length, camera.near, camera.far) == ("/World/One", 35.0, 0.1, 20.0)
    used = "/World/One: this one of 3 cameras is used; choose another by --camera or by the stage's render settings"
    assert scene.warnings == (used,)
    path = write_stage(tmp_path, "", HEADER + other)
    assert Scene.open(path).camera.path == "/Aside"
    assert Scene.open(path).warnings == ()


CAMERAS = 'def Camera "One" { }\ndef Camera "Two" { }\ndef Xform "Rig" { def Camera "Three" { } }'


def test_the_camera_of_the_render_settings(tmp_path):
    """A stage says with its render settings which of several cameras it is seen through."""
    settings = 'def RenderSettings "Settings" { rel camera = </World/Rig/Three> }'
    header = HEADER.replace("(", '(\n    renderSettingsPrimPath = "/World/Settings"', 1)
    scene = Scene.open(write_stage(tmp_path, CAMERAS + settings, header))
    assert (scene.camera.path, scene.warnings) == ("/World/Rig/Three", ())
    gone = settings.replace("/World/Rig/Three", "/World/Gone")
    assert Scene.open(write_stage(tmp_path, CAMERAS + gone, header)).camera.path == "/World/One"


def test_a_camera_that_is_asked_for(tmp_path):
    """A path chooses among cameras without a warning; one where no camera is, is refused with those that are there."""
    path = write_stage(tmp_path, CAMERAS)
    scene = Scene.open(path, "/World/Two")
    assert (scene.camera.path, scene.warnings) == ("/World/Two", ())
    with pytest.raises(ValueError, match=r"camera is /World/Tow; allowed: /World/One, /World/Two, /World/Rig/Three$"):
        Scene.open(path, "/World/Tow")
    with pytest.raises(ValueError, match=r"camera is /World/One; allowed: none, for the stage has no camera$"):
        Scene.open(write_stage(tmp_path, ""), "/World/One")


def test_prototypes_of_a_point_instancer_are_not_read(tmp_path):
    """What lies below a PointInstancer is not part of the set by itself: without instances there is none."""
    assert scene_of(tmp_path, 'def PointInstancer "P" { def Cube "Prototype" { } }').surfaces == ()


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
