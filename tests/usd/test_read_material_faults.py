"""Materials and textures that are not allowed or not supported: named in one line."""

import pytest
from material_text import TRANSFORMED, material_of, texture, with_material
from stage_text import scene_of

BROKEN_BINDING = "rel material:binding = </World/Gone>"
BROKEN_TRANSFORM = """def Shader "U" { uniform token info:id = "UsdTransform2d"
        float2 inputs:scale = (inf, 1)
        float2 outputs:result }"""


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
    text = "/World/A: material:binding names /World/Gone, which is not a material; grey is used"
    assert scene.warnings == (text,)


@pytest.mark.usefixtures("picture")
@pytest.mark.parametrize(
    ("parts", "warning"),
    [
        (("float inputs:clearcoat = 0.5",), "/World/M/S: inputs:clearcoat is not supported; it has no effect"),
        (
            ("float inputs:opacity = 0.5",),
            "/World/M/S: inputs:opacity: its shadow is that of an opaque surface",
        ),
        (
            ("float inputs:opacity = 0.4",),
            "/World/M/S: inputs:opacity: it casts no shadow, since it hides less than half",
        ),
        (("float inputs:opacity = 0.4\nfloat inputs:opacityThreshold = 0.3",), None),
        (("float inputs:opacity = 0",), None),
        (("normal3f inputs:normal = (0, 0, 1)\nfloat inputs:opacity = 1",), None),
        (
            ("float inputs:ior.connect = </World/M/T.outputs:r>", texture("")[1]),
            "/World/M/S: inputs:ior from /World/M/T is not supported; its default is used",
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
            "/World/M/S: scale and bias of the normal map are (1.0, 1.0, 1.0) and (0.0, 0.0, 0.0); 8-bit "
            "directions need (2, 2, 2) and (-1, -1, -1)",
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
