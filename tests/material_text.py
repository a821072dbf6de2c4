"""Stages of one mesh with materials, written as text, and what is read of them."""

from pathlib import Path

from stage_text import QUAD, scene_of

from warp_smoke.scene import Material


def with_material(surface: str, more: str = "") -> str:
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


def texture(inputs: str, output: str = "rgb") -> tuple[str, str]:
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


def material_of(folder: Path, *parts: str) -> tuple[Material, tuple[str, ...]]:
    """The material of the only surface, and the warnings."""
    scene = scene_of(folder, with_material(*parts))
    (surface,) = scene.surfaces
    return surface.material, scene.warnings


def subsets(*indices: list[int], more: str = "") -> str:
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
