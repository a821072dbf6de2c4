import numpy as np
import pytest
from PIL import Image
from stage_text import QUAD, scene_of

from warp_smoke.scene import Material, Procedural, Texture

BROKEN_BINDING = "rel material:binding = </World/Gone>"


def with_material(surface, more=""):
    """A mesh bound to a material whose UsdPreviewSurface has some inputs, beside other shaders."""
    return f"""
    def Mesh "A" ( apiSchemas = ["MaterialBindingAPI"] ) {{ {QUAD} rel material:binding = </World/M> }}
    def Material "M" {{
        token outputs:surface.connect = </World/M/S.outputs:surface>
        def Shader "S" {{
            uniform token info:id = "UsdPreviewSurface"
            {surface}
            token outputs:surface }}
        {more} }}"""


def texture(inputs, output="rgb"):
    """A diffuse colour from a texture, and that texture."""
    return (
        f"color3f inputs:diffuseColor.connect = </World/M/T.outputs:{output}>",
        f"""def Shader "T" {{
        uniform token info:id = "UsdUVTexture"
        {inputs}
        float3 outputs:rgb
        float outputs:r }}""",
    )


TRANSFORMED = texture("asset inputs:file = @./picture.png@\nfloat2 inputs:st.connect = </World/M/U.outputs:result>")
BROKEN_TRANSFORM = """def Shader "U" { uniform token info:id = "UsdTransform2d"
        float2 inputs:scale = (inf, 1)
        float2 outputs:result }"""


@pytest.fixture
def picture(tmp_path):
    """A picture beside the stage."""
    path = tmp_path / "picture.png"
    Image.new("RGB", (2, 2)).save(path)
    return path


def material_of(folder, *parts):
    """The material of the only surface, and the warnings."""
    scene = scene_of(folder, with_material(*parts))
    (surface,) = scene.surfaces
    return surface.material, scene.warnings


def test_plain_colors(tmp_path):
    """Colours and roughness are the shader's; the reflectance of ior 1.5 is 0.04."""
    material, warnings = material_of(
        tmp_path,
        """color3f inputs:diffuseColor = (0.1, 0.2, 0.3)
        color3f inputs:emissiveColor = (0, 0.5, 0)
        float inputs:roughness = 0.7""",
    )
    assert warnings == ()
    assert material == Material(
        path="/World/M",
        diffuse_color=(0.1, 0.2, 0.3),
        emissive_color=(0.0, 0.5, 0.0),
        roughness=0.7,
        fresnel_r0=(0.04, 0.04, 0.04),
    )


def test_unset_inputs_are_those_of_the_specification(tmp_path):
    """An empty UsdPreviewSurface: grey 0.18, roughness 0.5, ior 1.5."""
    assert material_of(tmp_path, "")[0] == Material(path="/World/M", fresnel_r0=(0.04, 0.04, 0.04))


def test_specular_workflow(tmp_path):
    """In the specular workflow the reflectance is the specular colour."""
    inputs = (
        "int inputs:useSpecularWorkflow = 1\ncolor3f inputs:specularColor = (0.1, 0.2, 0.3)\nfloat inputs:metallic = 1"
    )
    assert material_of(tmp_path, inputs)[0].fresnel_r0 == (0.1, 0.2, 0.3)


@pytest.mark.parametrize(("ior", "r0"), [(1.0, 0.0), (2.0, 1 / 9), (1.33, 0.02006)])
def test_index_of_refraction(tmp_path, ior, r0):
    """r₀ = ((n − 1)/(n + 1))²."""
    material, _ = material_of(tmp_path, f"float inputs:ior = {ior}")
    assert np.allclose(material.fresnel_r0, r0, rtol=1e-4)


def test_metals_reflect_their_color(tmp_path):
    """Metallic moves the diffuse colour into the reflectance: all of it at 1, half and half at 0.5."""
    color = "color3f inputs:diffuseColor = (0.8, 0.4, 0.2)\nfloat inputs:metallic = "
    metal, _ = material_of(tmp_path, color + "1")
    assert (metal.diffuse_color, metal.fresnel_r0) == ((0.0, 0.0, 0.0), (0.8, 0.4, 0.2))
    half, _ = material_of(tmp_path, color + "0.5")
    assert (half.diffuse_color, half.fresnel_r0) == ((0.4, 0.2, 0.1), (0.42, 0.22, 0.12))


@pytest.mark.usefixtures("picture")
def test_metal_stays_apart_where_something_is_a_picture(tmp_path):
    """With a texture on diffuseColor, metallic cannot be mixed into the colours, and is kept."""
    parts = texture("asset inputs:file = @./picture.png@")
    material, warnings = material_of(tmp_path, "float inputs:metallic = 0.75\n" + parts[0], parts[1])
    assert warnings == ()
    assert (material.metallic, material.fresnel_r0) == (0.75, (0.04, 0.04, 0.04))


@pytest.mark.parametrize(
    ("name", "field", "output"),
    [
        ("color3f inputs:emissiveColor", "emissive_texture", "rgb"),
        ("float inputs:metallic", "metallic_texture", "r"),
        ("float inputs:roughness", "roughness_texture", "r"),
        ("float inputs:occlusion", "occlusion_texture", "r"),
        ("int inputs:useSpecularWorkflow = 1\ncolor3f inputs:specularColor", "specular_texture", "rgb"),
    ],
)
def test_textures_of_other_inputs(tmp_path, picture, name, field, output):
    """Each input that is shaded may come from a picture."""
    more = texture('asset inputs:file = @./picture.png@\ntoken inputs:sourceColorSpace = "raw"')[1]
    material, warnings = material_of(tmp_path, f"{name}.connect = </World/M/T.outputs:{output}>", more)
    assert warnings == ()
    assert getattr(material, field) == Texture(
        file=str(picture), channel=output, color_space="raw", wrap_s="black", wrap_t="black"
    )


@pytest.mark.usefixtures("picture")
@pytest.mark.parametrize(("workflow", "field"), [(0, "specular_texture"), (1, "metallic_texture")])
def test_textures_of_the_other_workflow_have_no_effect(tmp_path, workflow, field):
    """The metallic workflow knows no specularColor, and the specular one no metal."""
    parts = texture("asset inputs:file = @./picture.png@")[1]
    inputs = f"""int inputs:useSpecularWorkflow = {workflow}
        color3f inputs:specularColor.connect = </World/M/T.outputs:rgb>
        float inputs:metallic.connect = </World/M/T.outputs:r>"""
    material, _ = material_of(tmp_path, inputs, parts)
    assert getattr(material, field) is None
    assert material.has_pictures


def test_interface_inputs_are_followed(tmp_path):
    """A value that the material passes on to its shader."""
    material, _ = material_of(
        tmp_path,
        "float inputs:roughness.connect = </World/M.inputs:rough>",
        'def "Unused" { }\nfloat inputs:rough = 0.9',
    )
    assert material.roughness == 0.9


def test_texture(tmp_path, picture):
    """A texture's file is found beside the stage; wraps, colour space, scale and bias are kept."""
    parts = texture(
        """asset inputs:file = @./picture.png@
        token inputs:wrapS = "mirror"
        token inputs:wrapT = "clamp"
        token inputs:sourceColorSpace = "raw"
        float4 inputs:scale = (2, 2, 2, 1)
        float4 inputs:bias = (-0.1, 0, 0, 0)"""
    )
    material, warnings = material_of(tmp_path, *parts)
    assert warnings == ()
    assert material.diffuse_texture == Texture(
        file=str(picture),
        wrap_s="mirror",
        wrap_t="clamp",
        color_space="raw",
        scale=(2.0, 2.0, 2.0, 1.0),
        bias=(-0.1, 0.0, 0.0, 0.0),
    )


def test_textures_of_relief_and_gloss(tmp_path, picture):
    """A normal map, heights in its alpha, and a roughness that is one minus the alpha of another: packed textures."""
    material, warnings = material_of(
        tmp_path,
        """normal3f inputs:normal.connect = </World/M/N.outputs:rgb>
        float inputs:displacement.connect = </World/M/H.outputs:a>
        float inputs:roughness = 0.3
        float inputs:roughness.connect = </World/M/G.outputs:a>""",
        "".join(
            f"""def Shader "{name}" {{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @./picture.png@
            token inputs:wrapS = "repeat"
            token inputs:wrapT = "repeat"
            token inputs:sourceColorSpace = "raw"
            float4 inputs:scale = {scale}
            float4 inputs:bias = {bias}
            {output} }}\n"""
            for name, scale, bias, output in (
                ("N", "(2, 2, 2, 1)", "(-1, -1, -1, 0)", "float3 outputs:rgb"),
                ("H", "(1, 1, 1, 1)", "(0, 0, 0, 0)", "float outputs:a"),
                ("G", "(1, 1, 1, -1)", "(0, 0, 0, 1)", "float outputs:a"),
            )
        ),
    )
    assert warnings == ()
    raw = {"file": str(picture), "color_space": "raw"}
    assert material == Material(
        path="/World/M",
        fresnel_r0=(0.04, 0.04, 0.04),
        roughness=0.3,
        normal_texture=Texture(scale=(2, 2, 2, 1), bias=(-1, -1, -1, 0), **raw),
        height_texture=Texture(channel="a", **raw),
        roughness_texture=Texture(channel="a", scale=(1, 1, 1, -1), bias=(0, 0, 0, 1), **raw),
    )


@pytest.mark.usefixtures("picture")
def test_texture_transform(tmp_path):
    """What a UsdTransform2d does to the coordinates."""
    transform = """def Shader "U" { uniform token info:id = "UsdTransform2d"
        float2 inputs:scale = (4, 2)
        float inputs:rotation = 90
        float2 inputs:translation = (0.5, 0.25)
        float2 outputs:result }"""
    material, warnings = material_of(tmp_path, TRANSFORMED[0], TRANSFORMED[1] + transform)
    assert warnings == ()
    found = material.diffuse_texture
    assert (found.uv_scale, found.uv_rotation, found.uv_translation) == ((4.0, 2.0), 90.0, (0.5, 0.25))


def test_what_usd_cannot_say(tmp_path):
    """SmokeMaterialAPI sets the reflection, what gloss and heights do, and a computed picture."""
    prims = with_material("").replace(
        'def Material "M" {',
        """def Material "M" ( prepend apiSchemas = ["SmokeMaterialAPI"] ) {
        uniform token smoke:reflection = "energyConserving"
        uniform token smoke:gloss = "factor"
        uniform token smoke:parallax = "occlusion"
        uniform float smoke:parallaxScale = 0.1
        uniform float smoke:parallaxBias = -0.05
        uniform token smoke:procedural = "mandelbrot"
        uniform int smoke:proceduralMaxIterations = 99
        uniform float2 smoke:proceduralCenter = (-0.5, 0.25)""",
    )
    scene = scene_of(tmp_path, prims)
    assert scene.warnings == ()
    assert scene.surfaces[0].material == Material(
        path="/World/M",
        fresnel_r0=(0.04, 0.04, 0.04),
        reflection="energyConserving",
        gloss="factor",
        parallax="occlusion",
        parallax_scale=0.1,
        parallax_bias=-0.05,
        procedural=Procedural(kind="mandelbrot", max_iterations=99, center=(-0.5, 0.25)),
    )


def test_procedural_settings_without_a_kind_are_warned_of(tmp_path):
    """A zoom alone computes no picture."""
    prims = with_material("").replace(
        'def Material "M" {',
        'def Material "M" ( prepend apiSchemas = ["SmokeMaterialAPI"] ) {\nuniform float smoke:proceduralZoom = 3',
    )
    scene = scene_of(tmp_path, prims)
    assert scene.warnings == ("/World/M: smoke:proceduralZoom has no effect, since smoke:procedural is unset",)


def test_a_binding_to_nothing_is_warned_of(tmp_path):
    """A material that is not there is named; the mesh is grey."""
    scene = scene_of(tmp_path, with_material("").replace("rel material:binding = </World/M>", BROKEN_BINDING))
    assert scene.surfaces[0].material is None
    text = "/World/A: material:binding names /World/Gone, which is no material; it is read as grey"
    assert scene.warnings == (text,)


@pytest.mark.usefixtures("picture")
def test_texture_without_wrap_modes_is_black_outside(tmp_path):
    """As UsdPreviewSurface's specification says for useMetadata, its default, and a file that has none."""
    material, _ = material_of(tmp_path, *texture("asset inputs:file = @./picture.png@"))
    assert (material.diffuse_texture.wrap_s, material.diffuse_texture.wrap_t) == ("black", "black")


@pytest.mark.usefixtures("picture")
@pytest.mark.parametrize(
    ("parts", "warning"),
    [
        (("float inputs:clearcoat = 0.5",), "/World/M/S: inputs:clearcoat is not supported; it has no effect"),
        (
            ("float inputs:opacity = 0.5",),
            "/World/M/S: inputs:opacity: its shadow is that of an opaque surface",
        ),
        (("normal3f inputs:normal = (0, 0, 1)\nfloat inputs:opacity = 1",), None),
        (
            ("float inputs:ior.connect = </World/M/T.outputs:r>", texture("")[1]),
            "/World/M/S: a texture on inputs:ior is not supported; its default is used",
        ),
        (
            ("normal3f inputs:normal = (0, 1, 0)",),
            "/World/M/S: inputs:normal without a texture is not supported; it has no effect",
        ),
        (
            ("float inputs:displacement = 0.5",),
            "/World/M/S: inputs:displacement without a texture is not supported; it has no effect",
        ),
        (
            (
                "normal3f inputs:normal.connect = </World/M/T.outputs:rgb>",
                texture("asset inputs:file = @./picture.png@")[1],
            ),
            "/World/M/S: scale and bias of the normal map are (1.0, 1.0, 1.0) and (0.0, 0.0, 0.0); (2, 2, 2) and "
            "(-1, -1, -1) make directions of 8 bits",
        ),
        (
            (
                "normal3f inputs:normal.connect = </World/M/T.outputs:rgb>",
                texture(
                    """asset inputs:file = @./picture.png@
                    token inputs:sourceColorSpace = "sRGB"
                    float4 inputs:scale = (2, 2, 2, 1)
                    float4 inputs:bias = (-1, -1, -1, 0)"""
                )[1],
            ),
            "/World/M/S: the normal map is marked as sRGB; directions are stored raw",
        ),
        (
            texture("asset inputs:file = @./picture.png@", "r"),
            "/World/M/T: outputs:r alone is not supported as a colour; all three are used",
        ),
        (
            texture("asset inputs:file = @./picture.<UDIM>.png@"),
            "/World/M/T: inputs:file is ./picture.<UDIM>.png: tiles (UDIM) and files inside .usdz are not supported; "
            "it is left out",
        ),
        (
            (
                texture("")[0],
                texture("""asset inputs:file = @./picture.png@
                float2 inputs:st.connect = </World/M/U.outputs:result>""")[1]
                + """def Shader "U" { uniform token info:id = "UsdTransform2d"
                float2 inputs:in.connect = </World/M/V.outputs:result>
                float2 outputs:result }
                def Shader "V" { uniform token info:id = "UsdTransform2d"\nfloat2 outputs:result }""",
            ),
            "/World/M/V: a UsdTransform2d before another one is not supported; it has no effect",
        ),
        (
            (
                "color3f inputs:diffuseColor.connect = </World/M/P.outputs:result>",
                'def Shader "P" { uniform token info:id = "UsdPrimvarReader_float3"\nfloat3 outputs:result }',
            ),
            "/World/M/S: inputs:diffuseColor from UsdPrimvarReader_float3 is not supported; its default is used",
        ),
    ],
)
def test_what_materials_are_read_without_is_warned_of(tmp_path, parts, warning):
    """Each input that has no effect is named, unless it says nothing."""
    assert material_of(tmp_path, *parts)[1] == (() if warning is None else (warning,))


def test_other_shaders_are_grey(tmp_path):
    """A material of another renderer reads as none, with one warning for all that is bound to it."""
    prims = with_material("").replace("UsdPreviewSurface", "ArnoldStandard") + (
        f'\ndef Mesh "B" ( apiSchemas = ["MaterialBindingAPI"] ) {{ {QUAD} rel material:binding = </World/M> }}'
    )
    scene = scene_of(tmp_path, prims)
    assert [surface.material for surface in scene.surfaces] == [None, None]
    text = "/World/M: only UsdPreviewSurface is supported; what it is bound to is read as grey"
    assert scene.warnings == (text,)


def test_bindings_come_from_above(tmp_path):
    """A mesh takes the material bound to its group."""
    scene = scene_of(
        tmp_path,
        """def Xform "G" ( apiSchemas = ["MaterialBindingAPI"] ) { rel material:binding = </World/M>
        def Cube "A" { } }
        def Material "M" { token outputs:surface.connect = </World/M/S.outputs:surface>
        def Shader "S" { uniform token info:id = "UsdPreviewSurface"
        float inputs:roughness = 0.25
        token outputs:surface } }""",
    )
    assert scene.surfaces[0].material.roughness == 0.25


def subsets(*indices, more=""):
    """A quad and two triangles, bound to M, with a face subset bound to N for each list of faces."""
    parts = "\n".join(
        f"""def GeomSubset "F{n}" ( apiSchemas = ["MaterialBindingAPI"] ) {{
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = {list(faces)}
            {more}
            rel material:binding = </World/N> }}"""
        for n, faces in enumerate(indices)
    )
    return f"""
    def Mesh "A" ( apiSchemas = ["MaterialBindingAPI"] ) {{
        int[] faceVertexCounts = [4, 3, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4, 3, 4, 5]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 2, 0), (0, 2, 0)]
        uniform token subdivisionScheme = "none"
        rel material:binding = </World/M>
        {parts} }}
    def Material "M" {{ token outputs:surface.connect = </World/M/S.outputs:surface>
        def Shader "S" {{ uniform token info:id = "UsdPreviewSurface"\ntoken outputs:surface }} }}
    def Material "N" {{ token outputs:surface.connect = </World/N/S.outputs:surface>
        def Shader "S" {{ uniform token info:id = "UsdPreviewSurface"\ntoken outputs:surface }} }}"""


def test_materials_of_face_subsets(tmp_path):
    """Faces of a subset have its material, all triangles of a quad too; the rest keep the mesh's."""
    scene = scene_of(tmp_path, subsets([0], [2]))
    assert scene.warnings == ()
    (surface,) = scene.surfaces
    assert [each.path for each in surface.subsets] == ["/World/A/F0", "/World/A/F1"]
    assert [material.path for material in surface.materials] == ["/World/M", "/World/N", "/World/N"]
    assert surface.material_of_triangle.tolist() == [1, 1, 0, 2]


def test_face_subsets_that_overlap(tmp_path):
    """The first of two subsets holds a face that is in both."""
    assert scene_of(tmp_path, subsets([1], [1, 2])).surfaces[0].material_of_triangle.tolist() == [0, 0, 1, 2]


def test_a_face_subset_of_faces_that_are_not_there(tmp_path):
    """One line names the subset and the faces there are."""
    line = "/World/A/F0: indices is 1…3; allowed: 0…2, the faces there are"
    with pytest.raises(ValueError, match="allowed") as error:
        scene_of(tmp_path, subsets([1, 3]))
    assert str(error.value).endswith(line)


def test_subsets_of_points_are_left_out(tmp_path):
    """A subset of another element type is named in a warning."""
    scene = scene_of(tmp_path, subsets([1], more="").replace('"face"', '"point"'))
    assert scene.surfaces[0].subsets == ()
    assert scene.warnings == (
        "/World/A/F0: a materialBind subset of anything but faces is not supported; it is left out",
    )


@pytest.mark.usefixtures("picture")
@pytest.mark.parametrize(
    ("parts", "line"),
    [
        (("float inputs:roughness = 2",), "/World/M/S: inputs:roughness is 2.0; allowed: 0 to 1"),
        (
            ("color3f inputs:diffuseColor = (nan, 0, 0)",),
            "/World/M/S: inputs:diffuseColor is (nan, 0.0, 0.0); allowed: 3 finite numbers",
        ),
        (
            texture("asset inputs:file = @./gone.png@"),
            "/World/M/T: inputs:file is @./gone.png@; allowed: a file that exists",
        ),
        (texture(""), "/World/M/T: inputs:file is unset; allowed: a picture"),
        (
            texture('asset inputs:file = @./picture.png@\ntoken inputs:wrapS = "tile"'),
            "/World/M/T: inputs:wrapS is tile; allowed: repeat, clamp, mirror, black",
        ),
        (
            texture('asset inputs:file = @./picture.png@\ntoken inputs:sourceColorSpace = "ACES"'),
            "/World/M/T: inputs:sourceColorSpace is ACES; allowed: auto, sRGB, raw",
        ),
        (
            (TRANSFORMED[0], TRANSFORMED[1] + BROKEN_TRANSFORM),
            "/World/M/U: inputs:scale is (inf, 1.0); allowed: 2 finite numbers",
        ),
    ],
)
def test_bad_materials_are_named_in_one_line(tmp_path, parts, line):
    """Each bad material raises one line with file, prim, attribute, value and what is allowed."""
    with pytest.raises(ValueError, match="allowed") as error:
        material_of(tmp_path, *parts)
    assert str(error.value) == f"{tmp_path / 'scene.usda'}: {line}"
