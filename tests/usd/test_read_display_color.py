"""Display colours: what they are on surfaces without a material, in the records and in pictures."""

import numpy as np
import pytest
from material_text import with_material
from stage_text import QUAD, scene_of

from warp_smoke.scene import Material, Scene

# A quad and two triangles.
FACES = """
    int[] faceVertexCounts = [4, 3, 3]
    int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4, 3, 4, 5]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 2, 0), (0, 2, 0)]
"""
RED, BLUE = "(1, 0, 0)", "(0, 0, 1)"


def colors(*values: str, interpolation: str = "constant") -> str:
    """The primvar with some values."""
    return f'color3f[] primvars:displayColor = [{", ".join(values)}] ( interpolation = "{interpolation}" )'


def read(folder, shape: str, kind: str = "Mesh"):
    """The only surface, and the warnings."""
    scene = scene_of(folder, f'def {kind} "A" {{ {shape} }}')
    (surface,) = scene.surfaces
    return surface, scene.warnings


@pytest.mark.parametrize(("kind", "shape"), [("Mesh", QUAD), ("Sphere", ""), ("Cube", "")])
def test_one_color(tmp_path, kind, shape):
    """A constant colour is the diffuse colour as it stands, linear; all else is that of surfaces without a material."""
    surface, warnings = read(tmp_path, f"{shape} {colors('(0.1, 0.2, 0.3)')}", kind)
    assert surface.material == Material(path="/World/A_displayColor", diffuse_color=(0.1, 0.2, 0.3))
    assert (surface.subsets, warnings) == ((), ())


def test_a_color_from_above(tmp_path):
    """Constant primvars hold for what lies below."""
    scene = scene_of(tmp_path, f'def Xform "X" {{ {colors(RED)}\ndef Mesh "A" {{ {QUAD} }} }}')
    assert scene.surfaces[0].material.diffuse_color == (1.0, 0.0, 0.0)


def test_a_material_wins(tmp_path):
    """A bound material is read alone, also one of another renderer, which stays grey as its warning says."""
    prims = with_material("color3f inputs:diffuseColor = (0, 1, 0)").replace(QUAD, f"{QUAD}{colors(RED)}\n")
    assert scene_of(tmp_path, prims).surfaces[0].material.diffuse_color == (0.0, 1.0, 0.0)
    other = prims.replace("UsdPreviewSurface", "SomeRenderersOwn").replace("inputs:diffuseColor", "inputs:c")
    assert scene_of(tmp_path, other).surfaces[0].material is None


@pytest.mark.parametrize(
    ("interpolation", "values"),
    [
        ("uniform", [RED, BLUE, RED]),
        ("faceVarying", [RED] * 4 + [BLUE] * 3 + [RED] * 3),
    ],
)
def test_colors_of_faces(tmp_path, interpolation, values):
    """Colours of whole faces, however they are given, are those of their triangles: a quad's two, and one each."""
    surface, warnings = read(tmp_path, FACES + colors(*values, interpolation=interpolation))
    seen = [surface.materials[n].diffuse_color for n in surface.material_of_triangle]
    assert seen == [(1, 0, 0), (1, 0, 0), (0, 0, 1), (1, 0, 0)]
    assert warnings == ()


def test_indexed_colors_of_faces_with_holes(tmp_path):
    """Indices are followed, and a hole takes its colour with it."""
    indexed = f"int[] primvars:displayColor:indices = [0, 1, 0]\nint[] holeIndices = [0]\n{FACES}"
    surface, _ = read(tmp_path, indexed + colors(RED, BLUE, interpolation="uniform"))
    assert [surface.materials[n].diffuse_color for n in surface.material_of_triangle] == [(0, 0, 1), (1, 0, 0)]


@pytest.mark.parametrize("interpolation", ["vertex", "varying"])
def test_colors_inside_faces_become_their_mean(tmp_path, interpolation):
    """Red at two of a quad's corners and blue at the others: half of both, with one warning."""
    surface, warnings = read(tmp_path, QUAD + colors(RED, RED, BLUE, BLUE, interpolation=interpolation))
    assert surface.material.diffuse_color == (0.5, 0.0, 0.5)
    text = "varies inside faces or has more than 64 values, which is not supported; its mean is used"
    assert warnings == (f"/World/A: primvars:displayColor {text}",)


def test_the_same_color_at_each_point(tmp_path):
    """One colour at all points is exact, without a warning."""
    surface, warnings = read(tmp_path, QUAD + colors(*[RED] * 4, interpolation="vertex"))
    assert (surface.material.diffuse_color, surface.subsets, warnings) == ((1.0, 0.0, 0.0), (), ())


def test_opacity(tmp_path):
    """A constant opacity is the material's, also without a colour; its shadow is told of."""
    surface, warnings = read(tmp_path, QUAD + "float[] primvars:displayOpacity = [0.25]")
    assert surface.material == Material(path="/World/A_displayColor", opacity=0.25)
    assert warnings == ("/World/A: primvars:displayOpacity: it casts no shadow, since it hides less than half",)
    surface, warnings = read(tmp_path, QUAD + "float[] primvars:displayOpacity = [0.75]")
    assert warnings == ("/World/A: primvars:displayOpacity: its shadow is that of an opaque surface",)
    surface, warnings = read(tmp_path, QUAD + "float[] primvars:displayOpacity = [1]\n" + colors(RED))
    assert (surface.material.opacity, warnings) == (1.0, ())


@pytest.mark.parametrize(
    ("shape", "warning"),
    [
        (QUAD + colors("(-1, 0, 0)"), "primvars:displayColor has values other than 0 to 1e+09; it is left out"),
        (QUAD + colors("(nan, 0, 0)"), "primvars:displayColor has values other than 0 to 1e+09; it is left out"),
        (
            QUAD + "float[] primvars:displayOpacity = [2]",
            "primvars:displayOpacity has values other than 0 to 1; it is left out",
        ),
        (
            QUAD + colors(RED, BLUE),
            "primvars:displayColor has 2 values, which do not fit the prim (constant); they are left out",
        ),
        (
            QUAD + colors(RED, BLUE, interpolation="vertex"),
            "primvars:displayColor has 2 values, which do not fit the prim (vertex); they are left out",
        ),
        (
            QUAD + 'string[] primvars:displayColor = ["red"]',
            "primvars:displayColor does not hold values of 3 numbers each; it is left out",
        ),
        (
            QUAD + colors(RED) + "\nint[] primvars:displayColor:indices = [7]",
            "primvars:displayColor does not hold values of 3 numbers each; it is left out",
        ),
        (QUAD + "color3f[] primvars:displayColor = []", None),
    ],
)
def test_what_is_no_color_is_left_out(tmp_path, shape, warning):
    """Colours are for viewers: bad ones do not stop a run, and are named with their prim."""
    surface, warnings = read(tmp_path, shape)
    assert surface.material is None
    assert warnings == (() if warning is None else (f"/World/A: {warning}",))


def test_subsets_with_a_material_keep_it(tmp_path):
    """On a colored mesh, faces that are bound to a material have that, and those of an unbound subset the colour."""
    prims = f"""def Mesh "A" {{ {FACES} {colors(RED, RED, BLUE, interpolation="uniform")}
        def GeomSubset "Bound" ( apiSchemas = ["MaterialBindingAPI"] ) {{
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0]
            rel material:binding = </World/M> }}
        def GeomSubset "Unbound" {{
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1, 2] }} }}
    def Material "M" {{ token outputs:surface.connect = </World/M/S.outputs:surface>
        def Shader "S" {{ uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0, 1, 0)
            token outputs:surface }} }}"""
    surface = scene_of(tmp_path, prims).surfaces[0]
    seen = [surface.materials[n].diffuse_color for n in surface.material_of_triangle]
    assert seen == [(0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 0, 1)]


def test_a_saved_scene_keeps_its_colors(tmp_path):
    """Written as materials and read again, colours of faces are the same."""
    prims = f'def Mesh "A" {{ {FACES} {colors(RED, BLUE, RED, interpolation="uniform")} }}'
    scene = scene_of(tmp_path, prims)
    scene.save(tmp_path / "saved.usda")
    assert Scene.open(tmp_path / "saved.usda").surfaces == scene.surfaces


def test_colors_of_instances_are_told_of(tmp_path):
    """The prototype's colour reaches each instance; one for each instance is not supported."""
    prims = f"""def PointInstancer "I" {{
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (3, 0, 0)]
        rel prototypes = </World/I/P>
        {colors(RED, BLUE, interpolation="vertex")}
        def Mesh "P" {{ {QUAD} {colors("(0, 1, 0)")} }} }}"""
    scene = scene_of(tmp_path, prims)
    assert [surface.material.diffuse_color for surface in scene.surfaces] == [(0, 1, 0)] * 2
    text = "primvars:displayColor of each instance is not supported; the prototypes' is used"
    assert scene.warnings == (f"/World/I: {text}",)
    assert np.unique([id(surface.material) for surface in scene.surfaces]).size == 1
