from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Usd, UsdGeom, UsdShade
from results import SET, write_all

import warp_smoke as ws
from warp_smoke.record import FieldError
from warp_smoke.usd.material import BakeResult, VertexBakeResult
from warp_smoke.usd.validate import validate_stage
from warp_smoke.usd.write import write_results

FLOOR, BAKED, GREY = "/World/Floor", "/World/Looks/Floor_baked", "/World/Looks/Grey"
SUBSET = """
        def GeomSubset "Half" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0]
            rel material:binding = </World/Looks/Grey>
        }
    }

    def Scope "Looks"
"""


def look_of(stage: Usd.Stage, path: str, purpose: str = "") -> str:
    """Path of the material that a renderer shows on a prim."""
    api = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path))
    return str(api.ComputeBoundMaterial(purpose)[0].GetPath())


def switch(stage: Usd.Stage, look: str) -> None:
    """Turns the one switch."""
    stage.GetDefaultPrim().GetVariantSet("smokeLook").SetVariantSelection(look)


def changed(text: str) -> str:
    """Names the user's own material in another way."""
    direct = "        rel material:binding = </World/Looks/Grey>\n"
    if text == "direct":
        return SET
    if text == "subset":
        return SET.replace('    }\n\n    def Scope "Looks"\n', SUBSET)
    if text == "preview":
        return SET.replace(direct, direct.replace("binding", "binding:preview"))
    strong = 'rel material:binding = </World/Looks/Grey> (\n        bindMaterialAs = "strongerThanDescendants"\n    )'
    return SET.replace(direct, "").replace('    def Mesh "Floor"', f'    {strong}\n    def Mesh "Floor"')


@pytest.mark.parametrize("binding", ["direct", "subset", "preview", "strong"])
def test_one_switch_turns_the_look(tmp_path, binding):
    """On the default prim, `baked` shows the pictures and `dcc` the user's material, however that was bound."""
    source = tmp_path / "user.usda"
    source.write_text(changed(binding))
    assert source.read_text() != SET or binding == "direct"
    stage = Usd.Stage.Open(str(write_all(source, tmp_path / "out").root))
    purpose = "preview" if binding == "preview" else ""
    path = f"{FLOOR}/Half" if binding == "subset" else FLOOR
    assert stage.GetDefaultPrim().GetVariantSet("smokeLook").GetVariantNames() == ["baked", "dcc"]
    assert look_of(stage, path, purpose) == BAKED
    switch(stage, "dcc")
    assert look_of(stage, path, purpose) == GREY
    switch(stage, "baked")
    assert look_of(stage, path, purpose) == BAKED


def test_the_baked_look_only_emits(results):
    """Nothing that a DCC's lights could add to: black, not shiny, and the picture as light of its own."""
    stage = Usd.Stage.Open(str(results.root))
    material = UsdShade.Material.Get(stage, BAKED)
    surface, _, _ = material.ComputeSurfaceSource()
    assert surface.GetShaderId() == "UsdPreviewSurface"
    assert surface.GetInput("diffuseColor").Get() == Gf.Vec3f(0)
    assert surface.GetInput("specularColor").Get() == Gf.Vec3f(0)
    assert surface.GetInput("ior").Get() == 1.0
    assert surface.GetInput("useSpecularWorkflow").Get() == 1
    picture = UsdShade.Shader(surface.GetInput("emissiveColor").GetConnectedSources()[0][0].source.GetPrim())
    assert picture.GetShaderId() == "UsdUVTexture"
    assert picture.GetInput("sourceColorSpace").Get() == "sRGB"
    reader = UsdShade.Shader(picture.GetInput("st").GetConnectedSources()[0][0].source.GetPrim())
    assert (reader.GetShaderId(), reader.GetInput("varname").Get()) == ("UsdPrimvarReader_float2", "st")


def test_every_picture_is_found_from_its_receiver(results):
    """Each bake is named on the mesh, at each frame where it changes, and the file is there."""
    stage = Usd.Stage.Open(str(results.root))
    for path in (f"{FLOOR}.smokeBaked:lit", f"{BAKED}/lit.inputs:file"):
        files = stage.GetAttributeAtPath(path)
        assert files.GetTimeSamples() == [5, 6, 7]
        for frame in (5, 6, 7):
            picture = results.root.parent / f"textures/Floor.lit.{frame:04d}.png"
            assert files.Get(frame).resolvedPath == str(picture)
        assert files.Get() == files.Get(7)
    shadow = stage.GetAttributeAtPath(f"{FLOOR}.smokeBaked:smokeShadow")
    assert shadow.Get().resolvedPath == str(results.root.parent / "textures/Floor.smokeShadow.png")
    assert not shadow.GetTimeSamples()


def test_other_bakes_leave_the_look_alone(tmp_path, set_stage):
    """Without a lit picture the user's material stays, and there is no switch."""
    scene = ws.Scene.open(set_stage)
    bake = BakeResult(surface=scene.surfaces[0], bake="visibility", files="./textures/Floor.visibility.png")
    stage = Usd.Stage.Open(str(write_results(tmp_path / "out", "set", scene, bakes=[bake])))
    assert look_of(stage, FLOOR) == GREY
    assert not stage.GetDefaultPrim().HasVariantSets()


def test_texture_coordinates_have_the_name_they_have(tmp_path):
    """A mesh whose coordinates are not called st is read by the name they have (Blender: UVMap)."""
    source = tmp_path / "user.usda"
    source.write_text(SET.replace("primvars:st", "primvars:UVMap"))
    stage = Usd.Stage.Open(str(write_all(source, tmp_path / "out").root))
    assert stage.GetAttributeAtPath(f"{BAKED}/st.inputs:varname").Get() == "UVMap"


def test_coordinates_outside_the_unit_square_get_a_set_for_the_bake(tmp_path):
    """The baked look reads `st_bake`, made of the mesh's own by its interpolation; who reads the mesh finds its own."""
    source, uvs = tmp_path / "user.usda", "[(0, 0), (1, 0), (1, 1), (0, 1)]"
    tiled = SET.replace(uvs, "[(-1, 2), (3, 2), (3, 4), (-1, 4)]").replace("primvars:st", "primvars:uv")
    source.write_text(tiled)
    root = write_all(source, tmp_path / "out").root
    stage = Usd.Stage.Open(str(root))
    assert stage.GetAttributeAtPath(f"{BAKED}/st.inputs:varname").Get() == "st_bake"
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(FLOOR)).GetPrimvar("st_bake")
    np.testing.assert_array_equal(primvar.Get(), [(0, 0), (1, 0), (1, 1), (0, 1)])
    assert primvar.GetInterpolation() == "vertex"
    (own,) = {surface.mesh.uvs.max() for surface in ws.Scene.open(root).surfaces}
    assert own == 4.0
    assert not [problem for problem in validate_stage(root) if problem.severity == "error"]


def test_pictures_need_texture_coordinates(tmp_path, set_stage):
    """A picture for a mesh without texture coordinates is refused with its path."""
    scene = ws.Scene.open(set_stage)
    set_stage.write_text(SET.replace("primvars:st", "other"))
    bake = BakeResult(surface=scene.surfaces[0], bake="lit", files="./textures/Floor.png")
    with pytest.raises(ValueError, match="/World/Floor: has baked pictures but no texture coordinates"):
        write_results(tmp_path / "out", "set", scene, bakes=[bake])


def test_light_at_points_is_a_primvar(tmp_path, set_stage):
    """Without texture coordinates the light at each point emits in the same way, and shares are primvars too."""
    scene = ws.Scene.open(set_stage)
    (floor,) = scene.surfaces
    colors = {frame: np.random.default_rng(frame).random((4, 3), np.float32) for frame in scene.frames}
    shares = np.float32([0, 0.25, 0.5, 1])
    bakes = [
        VertexBakeResult(surface=floor, bake="lit", values=colors),
        VertexBakeResult(surface=floor, bake="smokeShadow", values=shares),
    ]
    stage = Usd.Stage.Open(str(write_results(tmp_path / "out", "set", scene, bakes=bakes)))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(FLOOR))
    lit = primvars.GetPrimvar("smokeLit")
    assert (lit.GetTypeName(), lit.GetInterpolation()) == ("color3f[]", "vertex")
    for frame, expected in colors.items():
        assert np.array_equal(lit.Get(frame), expected)
    assert np.array_equal(primvars.GetPrimvar("smokeShadow").Get(), shares)
    assert look_of(stage, FLOOR) == BAKED
    surface, _, _ = UsdShade.Material.Get(stage, BAKED).ComputeSurfaceSource()
    reader = UsdShade.Shader(surface.GetInput("emissiveColor").GetConnectedSources()[0][0].source.GetPrim())
    assert (reader.GetShaderId(), reader.GetInput("varname").Get()) == ("UsdPrimvarReader_float3", "smokeLit")


def test_values_fit_the_mesh(set_stage):
    """Colours for another number of points are refused."""
    (floor,) = ws.Scene.open(set_stage).surfaces
    with pytest.raises(FieldError, match="/World/Floor: values is of shape"):
        VertexBakeResult(surface=floor, bake="lit", values=np.zeros((3, 3), np.float32))


def test_an_instance_gets_pictures_of_its_own(tmp_path):
    """One of two native instances is baked: it becomes a prim of its own, and the other keeps the user's look."""
    text = SET.replace('def Mesh "Floor"', 'def Xform "Set"\n    {\n    def Mesh "Floor"', 1)
    text = text.replace('    def Scope "Looks"', '    }\n    def Scope "Looks"')
    copies = "".join(
        f'    def "{name}" (\n        instanceable = true\n        references = </World/Set>\n    )\n    {{\n    }}\n'
        for name in ("A", "B")
    )
    source = tmp_path / "user.usda"
    source.write_text(text.replace('    def Cube "Box"', copies + '    def Cube "Box"'))
    scene = ws.Scene.open(source)
    (floor,) = (surface for surface in scene.surfaces if surface.path == "/World/A/Floor")
    bake = BakeResult(surface=floor, bake="lit", files="./textures/Floor.png")
    stage = Usd.Stage.Open(str(write_results(tmp_path / "out", "set", scene, bakes=[bake])))
    assert look_of(stage, "/World/A/Floor") == BAKED
    assert look_of(stage, "/World/B/Floor") == GREY
    assert not stage.GetPrimAtPath("/World/A").IsInstance()
    assert stage.GetPrimAtPath("/World/B").IsInstance()


def test_a_computed_picture_becomes_the_diffuse_color(tmp_path):
    """A run writes what smoke:procedural asks for as a PNG, bound so that any renderer shows it; it reads back."""
    material = ws.Material(path="/World/M", procedural=ws.Procedural(kind="checker", size=8, repeats=2))
    surface = ws.Surface(path="/World/Plane", mesh=ws.Mesh.grid((0, 0, 0), (1, 0, 0), (0, 1, 0)), material=material)
    result = ws.run(ws.Scene(surfaces=[surface], end=1), tmp_path / "out")
    picture = np.asarray(Image.open(tmp_path / "out/textures/M.procedural.png"))
    assert picture.shape == (8, 8, 3)
    assert picture[7, 0].tolist() == [255, 0, 0]
    assert picture[0, 0].tolist() == [0, 255, 0]
    read = ws.Scene.open(result.stage).surfaces[0].material
    assert read.procedural == material.procedural
    assert read.diffuse_texture.file == str(tmp_path / "out/textures/M.procedural.png")
    assert read.diffuse_texture.color_space == "sRGB"


@pytest.mark.parametrize(
    ("bake", "primvar", "kind"),
    [("irradiance", "smokeIrradiance", "color3f[]"), ("normal", "smokeNormal", "normal3f[]")],
)
def test_other_bakes_at_points(tmp_path, set_stage, bake, primvar, kind):
    """Irradiance and normals of a mesh without pictures are primvars of their own kind."""
    scene = ws.Scene.open(set_stage)
    values = np.full((4, 3), 0.5, np.float32)
    made = VertexBakeResult(surface=scene.surfaces[0], bake=bake, values=values)
    stage = Usd.Stage.Open(str(write_results(tmp_path / "out", "set", scene, bakes=[made])))
    found = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(FLOOR)).GetPrimvar(primvar)
    assert str(found.GetTypeName()) == kind
    assert np.array_equal(found.Get(), values)


@pytest.mark.parametrize("threshold", [0.0, 0.3])
def test_the_baked_look_keeps_opacity(tmp_path, set_stage, threshold):
    """Opacity comes from the picture's alpha; where it is cut off, the alpha's 0 and 1 are."""
    scene = ws.Scene.open(set_stage)
    (floor,) = (surface for surface in scene.surfaces if surface.path == FLOOR)
    material = replace(floor.material, opacity=0.5, opacity_threshold=threshold)
    floor = replace(floor, material=material)
    bake = BakeResult(surface=floor, bake="lit", files="./textures/Floor.lit.png")
    stage = Usd.Stage.Open(str(write_results(tmp_path / "out", "set", scene, bakes=[bake])))
    surface, _, _ = UsdShade.Material.Get(stage, BAKED).ComputeSurfaceSource()
    source = surface.GetInput("opacity").GetConnectedSources()[0][0]
    assert source.sourceName == "a"
    assert surface.GetInput("opacityThreshold").Get() == (0.5 if threshold else None)
