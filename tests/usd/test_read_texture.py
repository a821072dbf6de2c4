"""Pictures of materials: file, channel, wrap, colour space and transform of each input."""

import pytest
from material_text import TRANSFORMED, material_of, texture, with_material
from stage_text import scene_of

from warp_smoke.scene import Material, Texture


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
@pytest.mark.parametrize(
    ("varname", "more", "warned"),
    [
        ("st", "texCoord2f[] primvars:Second = [(0, 0)]", False),
        ("Second", "texCoord2f[] primvars:Second = [(0, 0)]", True),
        ("UVMap", "texCoord2f[] primvars:Second = [(0, 0)]", False),
    ],
)
def test_textures_over_other_coordinates_are_told(tmp_path, varname, more, warned):
    """A mesh's second coordinates are not used, which is said; a name that it has not, as Blender's UVMap, is `st`."""
    inputs, shader = texture(
        "asset inputs:file = @./picture.png@\nfloat2 inputs:st.connect = </World/M/R.outputs:result>"
    )
    reader = f"""def Shader "R" {{
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "{varname}"
        float2 outputs:result }}"""
    text = with_material(inputs, shader + reader).replace(
        "rel material:binding",
        f"""{more} (
            interpolation = "constant"
        )
        texCoord2f[] primvars:st = [(0, 0)] (
            interpolation = "constant"
        )
        rel material:binding""",
    )
    told = "/World/A: /World/M uses primvars:Second, which is not supported; primvars:st is used instead"
    assert scene_of(tmp_path, text).warnings == ((told,) if warned else ())


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


@pytest.mark.usefixtures("picture")
def test_texture_without_wrap_modes_is_black_outside(tmp_path):
    """As UsdPreviewSurface's specification says for useMetadata, its default, and a file that has none."""
    material, _ = material_of(tmp_path, *texture("asset inputs:file = @./picture.png@"))
    assert (material.diffuse_texture.wrap_s, material.diffuse_texture.wrap_t) == ("black", "black")


def test_tiles(tmp_path):
    """`<UDIM>` stays in the file's path, beside the stage; beyond the tiles their border goes on."""
    (tmp_path / "wood.1012.png").touch()
    inputs = 'asset inputs:file = @./wood.<UDIM>.png@\ntoken inputs:wrapS = "repeat"'
    material, warnings = material_of(tmp_path, *texture(inputs))
    assert warnings == ()
    expected = Texture(file=str(tmp_path / "wood.<UDIM>.png"), wrap_s="clamp", wrap_t="clamp")
    assert material.diffuse_texture == expected
    with pytest.raises(ValueError, match=r"inputs:file is @./oak.<UDIM>.png@; allowed: a file that exists"):
        material_of(tmp_path, *texture("asset inputs:file = @./oak.<UDIM>.png@"))
