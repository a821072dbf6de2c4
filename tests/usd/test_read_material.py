"""Materials: `UsdPreviewSurface` as the package's own, what only `SmokeMaterialAPI` says, and how they are bound."""

import numpy as np
import pytest
from material_text import material_of, with_material
from stage_text import QUAD, scene_of

from warp_smoke.scene import Material, Procedural


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


def test_metal(tmp_path):
    """A share of metal stands beside the colour, and the reflectance is that of what is not metal."""
    color = "color3f inputs:diffuseColor = (0.8, 0.4, 0.2)\nfloat inputs:metallic = 0.5"
    metal, _ = material_of(tmp_path, color)
    assert (metal.diffuse_color, metal.metallic, metal.fresnel_r0) == ((0.8, 0.4, 0.2), 0.5, (0.04,) * 3)


def test_interface_inputs_are_followed(tmp_path):
    """A value that the material passes on to its shader."""
    material, _ = material_of(
        tmp_path,
        "float inputs:roughness.connect = </World/M.inputs:rough>",
        'def "Unused" { }\nfloat inputs:rough = 0.9',
    )
    assert material.roughness == 0.9


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


def test_other_shaders_are_grey(tmp_path):
    """A material of another renderer reads as none, with one warning for all that is bound to it."""
    prims = with_material("").replace("UsdPreviewSurface", "ArnoldStandard") + (
        f'\ndef Mesh "B" ( apiSchemas = ["MaterialBindingAPI"] ) {{ {QUAD} rel material:binding = </World/M> }}'
    )
    scene = scene_of(tmp_path, prims)
    assert [surface.material for surface in scene.surfaces] == [None, None]
    text = "/World/M: only UsdPreviewSurface is supported; grey is used instead"
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
