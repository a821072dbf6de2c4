import numpy as np
import pytest
from PIL import Image
from pxr import UsdLux, UsdUtils
from stage_text import scene_of, write_stage

from warp_smoke.geometry import Mesh
from warp_smoke.record import Samples
from warp_smoke.scene import DistantLight, PointLight, Scene, SpotLight, Surface
from warp_smoke.shading.light_source import light_source
from warp_smoke.usd.author import author_scene

# The values that UsdLux itself falls back to.
LUX = {"normalize": False, "intensity": 1.0}


def light_of(folder, prim):
    """The only light, and the warnings."""
    scene = scene_of(folder, prim)
    (light,) = scene.lights
    return light, scene.warnings


def test_sphere_light(tmp_path):
    """A sphere light is a point light; what is not authored is as UsdLux says."""
    assert light_of(tmp_path, 'def SphereLight "L" { }') == (PointLight(path="/World/L", radius=0.5, **LUX), ())
    light, _ = light_of(
        tmp_path,
        """def SphereLight "L" {
        color3f inputs:color = (1, 0.5, 0.1)
        float inputs:intensity = 30.1
        bool inputs:normalize = true
        float inputs:radius = 0.2
        double3 xformOp:translate = (1, 2, 3)
        token[] xformOpOrder = ["xformOp:translate"] }""",
    )
    place = np.eye(4)
    place[3, :3] = 1, 2, 3
    assert light == PointLight(
        path="/World/L", transform=place, color=(1.0, 0.5, 0.1), intensity=30.1, normalize=True, radius=0.2
    )


def test_distant_light(tmp_path):
    """A distant light shines along its −Z axis."""
    light, _ = light_of(
        tmp_path,
        """def DistantLight "L" {
        float inputs:angle = 1
        float inputs:intensity = 2
        float xformOp:rotateX = -90
        token[] xformOpOrder = ["xformOp:rotateX"] }""",
    )
    assert isinstance(light, DistantLight)
    assert (light.angle, light.intensity, light.normalize, light.shadow_map_size) == (1.0, 2.0, False, 1024)
    assert np.allclose(light.direction_at(1), (0, -1, 0))


def test_shaping_makes_a_spot_light(tmp_path):
    """ShapingAPI on a sphere light gives cone and focus."""
    light, _ = light_of(
        tmp_path,
        """def SphereLight "L" ( apiSchemas = ["ShapingAPI"] ) {
        float inputs:shaping:cone:angle = 30
        float inputs:shaping:cone:softness = 0.1
        float inputs:shaping:focus = 4 }""",
    )
    assert light == SpotLight(path="/World/L", cone_angle=30.0, cone_softness=0.1, focus=4.0, **LUX)


def test_shadow_and_smoke_schemas(tmp_path):
    """ShadowAPI switches the shadow off, SmokeLightAPI fills the rest."""
    light, warnings = light_of(
        tmp_path,
        """def SphereLight "L" ( apiSchemas = ["ShadowAPI", "SmokeLightAPI"] ) {
        bool inputs:shadow:enable = false
        token smoke:falloffModel = "linear"
        float smoke:falloffStart = 0.5
        float smoke:falloffEnd = 8
        float3 smoke:attenuation = (0, 0, 1)
        token smoke:shadowFilter = "exact"
        int smoke:shadowMapSize = 256
        float smoke:shadowBias = 0.01
        token smoke:smokeShadow = "dpd" }""",
    )
    assert warnings == ()
    assert light == PointLight(
        path="/World/L",
        shadow_enable=False,
        falloff_model="linear",
        falloff_start=0.5,
        falloff_end=8.0,
        attenuation=(0.0, 0.0, 1.0),
        shadow_filter="exact",
        shadow_map_size=256,
        shadow_bias=0.01,
        smoke_shadow="dpd",
        **LUX,
    )


def test_exposure_doubles_the_intensity(tmp_path):
    """Intensity and exposure are one number, sampled where either changes."""
    light, _ = light_of(tmp_path, 'def SphereLight "L" { float inputs:intensity = 3\nfloat inputs:exposure = 2 }')
    assert light.intensity == 12.0
    light, _ = light_of(
        tmp_path,
        """def SphereLight "L" {
        float inputs:intensity.timeSamples = { 1: 1, 3: 3 }
        float inputs:exposure.timeSamples = { 1: 0, 2: 1 } }""",
    )
    assert light.intensity == Samples([1, 2, 3], [1.0, 4.0, 6.0])


def test_color_temperature_tints(tmp_path):
    """The colour of a black body multiplies the light's own, only if it is switched on."""
    kelvin = "float inputs:colorTemperature = 3000\ncolor3f inputs:color = (0.5, 1, 1)"
    light, _ = light_of(tmp_path, f'def SphereLight "L" {{ {kelvin} }}')
    assert light.color == (0.5, 1.0, 1.0)
    light, _ = light_of(tmp_path, f'def SphereLight "L" {{ {kelvin}\nbool inputs:enableColorTemperature = true }}')
    assert np.allclose(light.color, np.array(UsdLux.BlackbodyTemperatureAsRgb(3000.0)) * (0.5, 1, 1), rtol=1e-6)


def test_cylinder_lights_become_spheres_of_the_same_area(tmp_path):
    """The sphere's surface equals that of the cylinder's side; a warning says so."""
    light, warnings = light_of(tmp_path, 'def CylinderLight "L" { float inputs:radius = 0.5\nfloat inputs:length = 4 }')
    assert isinstance(light, PointLight)
    assert np.isclose(4 * np.pi * light.radius**2, 4 * np.pi, rtol=1e-6)
    assert warnings == ("/World/L: a CylinderLight is used as a sphere of the same area",)


@pytest.mark.parametrize("normalize", [True, False])
@pytest.mark.parametrize(
    ("prim", "area"),
    [
        ('RectLight "L" { float inputs:width = 2\nfloat inputs:height = 3\n%s }', 6.0),
        ('DiskLight "L" { float inputs:radius = 2\n%s }', 4.0 * np.pi),
    ],
)
def test_flat_lights_shine_to_their_front(tmp_path, prim, area, normalize):
    """From afar, B = radiance · A cos θ/(π d²) to the front and nothing to the back; a warning tells of shadows."""
    given = f"float inputs:intensity = 5\nbool inputs:normalize = {int(normalize)}"
    light, warnings = light_of(tmp_path, f"def {prim % given}")
    kind = prim.split()[0]
    text = "shines from its centre only, to the front; its shadows are those of a disk"
    assert warnings == (f"/World/L: a {kind} {text}",)
    assert isinstance(light, SpotLight)
    assert np.isclose(np.pi * light.radius**2, area, rtol=1e-6)
    assert (light.cone_angle, light.cone_softness, light.focus) == (90.0, 0.0, 1.0)
    radiance = 5.0 / area if normalize else 5.0
    strength = light_source(light, np.zeros(3), 1.0).strength
    assert np.allclose(strength, radiance * area / np.pi, rtol=1e-6)


def test_flat_lights_keep_their_shaping_and_samples(tmp_path):
    """A cone narrower than the front stays, focus adds to the cosine, and intensity may change."""
    light, _ = light_of(
        tmp_path,
        """def RectLight "L" ( apiSchemas = ["ShapingAPI"] ) {
        float inputs:intensity.timeSamples = { 1: 1, 3: 3 }
        bool inputs:normalize = true
        float inputs:shaping:cone:angle = 40
        float inputs:shaping:cone:softness = 0.5
        float inputs:shaping:focus = 2 }""",
    )
    assert (light.cone_angle, light.cone_softness, light.focus) == (40.0, 0.5, 3.0)
    assert light.intensity == Samples([1, 3], [4.0, 12.0])


def test_dome_lights_are_ambient(tmp_path):
    """The colours of all visible dome lights add up."""
    scene = scene_of(
        tmp_path,
        """
    def DomeLight "A" { color3f inputs:color = (0.1, 0.2, 0.3)\nfloat inputs:intensity = 2 }
    def DomeLight "B" { color3f inputs:color = (0.5, 0, 0) }
    def DomeLight "C" { token visibility = "invisible" }""",
    )
    assert np.allclose(scene.ambient, (0.7, 0.4, 0.6))
    assert scene.lights == ()
    assert scene.warnings == ()


DOME = 'def DomeLight "L" { color3f inputs:color = (1, 1, 0.5)\nfloat inputs:intensity = %s\n%s }'
PICTURE = "asset inputs:texture:file = @./sky.png@"


@pytest.mark.parametrize("package", [False, True])
def test_pictures_of_dome_lights_tint_the_ambient_light(tmp_path, package):
    """The picture's mean multiplies the colour; an even one, as Blender writes, is no cause for a warning."""
    Image.new("RGB", (1, 1), (255, 0, 255)).save(tmp_path / "sky.png")
    stage = write_stage(tmp_path, DOME % (2, PICTURE))
    if package:
        stage = tmp_path / "scene.usdz"
        UsdUtils.CreateNewUsdzPackage(str(tmp_path / "scene.usda"), str(stage))
    scene = Scene.open(stage)
    assert np.allclose(scene.ambient, (2, 0, 1))
    assert scene.warnings == ()


def test_uneven_pictures_of_dome_lights_are_told(tmp_path):
    """Half a white sky is half the light, from everywhere."""
    sky = np.zeros((2, 1, 3), np.uint8)
    sky[0] = 255
    Image.fromarray(sky).save(tmp_path / "sky.png")
    scene = scene_of(tmp_path, DOME % (2, PICTURE))
    assert np.allclose(scene.ambient, (1, 1, 0.5))
    assert scene.warnings == ("/World/L: the mean colour of inputs:texture:file is used, as light from all directions",)


@pytest.mark.parametrize(
    ("content", "more", "warning"),
    [
        (b"no picture", "", "inputs:texture:file is neither OpenEXR nor Radiance nor what Pillow reads, which is not"),
        (b"", 'token inputs:texture:format = "angular"', "inputs:texture:format angular is not supported; the picture"),
    ],
)
def test_pictures_of_dome_lights_that_are_not_read(tmp_path, content, more, warning):
    """The colour stays, with a warning."""
    (tmp_path / "sky.png").write_bytes(content)
    scene = scene_of(tmp_path, DOME % (2, f"{PICTURE}\n{more}"))
    assert np.allclose(scene.ambient, (2, 2, 1))
    assert len(scene.warnings) == 1
    assert scene.warnings[0].startswith(f"/World/L: {warning}")


def test_dome_lights_that_are_off_need_no_picture(tmp_path):
    """Of a black world Blender exports a picture with no intensity."""
    scene = scene_of(tmp_path, DOME % (0, PICTURE))
    assert scene.ambient == (0.0, 0.0, 0.0)
    assert scene.warnings == ()


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (None, "inputs:texture:file is @./sky.png@; allowed: a file that exists"),
        (b"\x76\x2f\x31\x01\2\0\0\0", "inputs:texture:file is ./sky.png (damaged: index out of range); allowed: a "),
    ],
)
def test_missing_and_damaged_pictures_of_dome_lights(tmp_path, content, line):
    """One line names the prim and the file."""
    if content is not None:
        (tmp_path / "sky.png").write_bytes(content)
    with pytest.raises(ValueError, match="allowed") as error:
        scene_of(tmp_path, DOME % (2, PICTURE))
    assert str(error.value).startswith(f"{tmp_path / 'scene.usda'}: /World/L: {line}")


def test_invisible_lights_are_off(tmp_path):
    """Visibility switches a light, in time too."""
    light, _ = light_of(tmp_path, 'def SphereLight "L" { token visibility = "invisible" }')
    assert light.enabled is False
    assert not light.shines
    light, _ = light_of(
        tmp_path, 'def SphereLight "L" { token visibility.timeSamples = { 1: "invisible", 3: "inherited" } }'
    )
    assert light.enabled == Samples([1, 3], [False, True])


LINKED = """def Xform "Group" {
    def Cube "A" { }
    def Cube "B" { }
}
def Cube "C" { }
def Cube "Smoke" ( apiSchemas = ["SmokeDomainAPI"] ) { token purpose = "guide" }
def PointInstancer "P" {
    rel prototypes = </World/P/D>
    int[] protoIndices = [0]
    point3f[] positions = [(0, 0, 0)]
    def Cube "D" { }
}
def SphereLight "L" { %s }"""
A, B, C, D = "/World/Group/A", "/World/Group/B", "/World/C", "/World/P/Instance0/D"


@pytest.mark.parametrize(
    ("collection", "members"),
    [
        ("", None),
        ("rel %s:excludes = </World/Group/A>", (B, C, D, "/World/Smoke")),
        ("rel %s:excludes = </World/Elsewhere>", None),
        ("uniform bool %s:includeRoot = 0\nrel %s:includes = [</World/Group>, </World/P>]", (A, B, D)),
        (
            "uniform bool %s:includeRoot = 0\nrel %s:includes = </World/Group>\nrel %s:excludes = </World/Group/B>",
            (A,),
        ),
        ('uniform token %s:expansionRule = "explicitOnly"\nrel %s:includes = </World/C>', (C,)),
        ("uniform bool %s:includeRoot = 0", ()),
    ],
)
@pytest.mark.parametrize(("name", "field"), [("lightLink", "illuminates"), ("shadowLink", "shadowed_by")])
def test_light_linking(tmp_path, collection, members, name, field):
    """What the collections include, by group and by instancer too, is what the light reaches or is shadowed by."""
    scene = scene_of(tmp_path, LINKED % collection.replace("%s", f"collection:{name}"))
    (light,) = scene.lights
    assert scene.warnings == ()
    assert getattr(light, field) == members
    assert {light.illuminates, light.shadowed_by} == {None, members}


def test_linked_lights_are_written_again(tmp_path):
    """Light linking survives the way to a file and back."""
    ball = Mesh.sphere(segments=8)
    surfaces = [Surface(path=f"/World/{name}", mesh=ball) for name in "AB"]
    lights = [
        PointLight(path="/World/L", illuminates=("/World/B",), shadowed_by=()),
        PointLight(path="/World/M"),
    ]
    author_scene(Scene(surfaces=surfaces, lights=lights), tmp_path / "linked.usda")
    assert list(Scene.open(tmp_path / "linked.usda").lights) == lights


@pytest.mark.parametrize(
    ("prim", "warning"),
    [
        ('def SphereLight "L" { float inputs:diffuse = 0.5 }', "inputs:diffuse is not supported; it has no effect"),
        ('def SphereLight "L" { float inputs:diffuse = 1 }', None),
        ('def SphereLight "L" { rel light:filters = </World> }', "light:filters is not supported; it has no effect"),
        (
            'def SphereLight "L" ( apiSchemas = ["ShadowAPI"] ) { color3f inputs:shadow:color = (1, 0, 0) }',
            "inputs:shadow:color is not supported; it has no effect",
        ),
        (
            'def DistantLight "L" ( apiSchemas = ["ShapingAPI"] ) { }',
            "shaping of a distant light is not supported; it shines everywhere",
        ),
        (
            'def DistantLight "L" ( apiSchemas = ["SmokeLightAPI"] ) { float smoke:falloffEnd = 3 }',
            "smoke:falloffEnd is 3.0, which is not supported",
        ),
        (
            'def SphereLight "L" { asset inputs:texture:file = @glow.png@ }',
            "inputs:texture:file is not supported; it has no effect",
        ),
        (
            'def PortalLight "L" { }',
            "a light of type PortalLight is not supported; it is left out",
        ),
        (
            'def SphereLight "L" { color3f inputs:color.timeSamples = { 1: (1, 0, 0), 2: (0, 1, 0) } }',
            "inputs:color changes in time, which is not supported; its first value is used",
        ),
    ],
)
def test_what_lights_are_read_without_is_warned_of(tmp_path, prim, warning):
    """Each input that has no effect is named, unless it says nothing."""
    warnings = scene_of(tmp_path, prim).warnings
    assert warnings == (() if warning is None else (f"/World/L: {warning}",))


@pytest.mark.parametrize(
    ("prim", "line"),
    [
        (
            """def DistantLight "L" {
            float3 xformOp:scale = (0, 0, 0)
            token[] xformOpOrder = ["xformOp:scale"] }""",
            "xformOp:* is [0.0, 0.0, 0.0]; allowed: a direction that is not zero",
        ),
        ('def SphereLight "L" { float inputs:intensity = -1 }', "inputs:intensity is -1.0; allowed: ≥ 0"),
        ('def SphereLight "L" { float inputs:radius = -0.1 }', "inputs:radius is -0.1; allowed: ≥ 0"),
        ('def RectLight "L" { float inputs:width = nan }', "inputs:width is nan; allowed: a finite number"),
        (
            'def SphereLight "L" { color3f inputs:color = (0, -1, 0) }',
            "inputs:color is (0.0, -1.0, 0.0); allowed: ≥ 0",
        ),
        (
            'def SphereLight "L" ( apiSchemas = ["ShapingAPI"] ) { float inputs:shaping:cone:angle = 0 }',
            "inputs:shaping:cone:angle is 0.0; allowed: > 0",
        ),
        (
            'def DomeLight "L" { color3f inputs:color = (nan, 0, 0) }',
            "inputs:color is (nan, 0.0, 0.0); allowed: 3 finite numbers",
        ),
        (
            'def SphereLight "L" ( apiSchemas = ["SmokeLightAPI"] ) { token smoke:falloffModel = "cubic" }',
            "smoke:falloffModel is cubic; allowed: inverseSquare, linear, polynomial",
        ),
        (
            'def SphereLight "L" ( apiSchemas = ["SmokeLightAPI"] ) { token smoke:falloffModel = "linear" }',
            "smoke:falloffEnd is None; allowed: a distance, since falloff_model is linear",
        ),
    ],
)
def test_bad_lights_are_named_in_one_line(tmp_path, prim, line):
    """Each bad light raises one line with file, prim, attribute, value and what is allowed."""
    with pytest.raises(ValueError, match="allowed") as error:
        scene_of(tmp_path, prim)
    assert str(error.value) == f"{tmp_path / 'scene.usda'}: /World/L: {line}"
