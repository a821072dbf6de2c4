from importlib.util import find_spec

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdShade
from results import SET

import warp_smoke as ws
from warp_smoke.usd.author import author_scene
from warp_smoke.usd.material import VertexBakeResult
from warp_smoke.usd.validate import validate_stage
from warp_smoke.usd.write import write_results
from warp_smoke.vdb import Grid, write_vdb

DENSITY = "/World/Box_smoke/density"
PICTURE = "/World/Looks/Floor_baked/lit"


def problems_after(results, plant) -> list[tuple[str, str]]:
    """Severity and place of what is found when a fault is planted in the results layer."""
    layer = Sdf.Layer.FindOrOpen(str(results.root.with_name("set.results.usdc")))
    stage = Usd.Stage.Open(str(results.root))
    stage.SetEditTarget(layer)
    plant(stage)
    layer.Save()
    return [(problem.severity, problem.where) for problem in validate_stage(results.root)]


def test_results_are_clean(results):
    """No validator has anything to say, not even a warning."""
    assert validate_stage(results.root) == []


def test_a_folder_of_results_is_clean(results):
    """A folder stands for the stage in it."""
    assert validate_stage(results.root.parent) == []


def test_the_other_look_is_clean(results):
    """The user's own look over the results is as good."""
    stage = Usd.Stage.Open(str(results.root))
    stage.GetDefaultPrim().GetVariantSet("smokeLook").SetVariantSelection("dcc")
    stage.Save()
    assert validate_stage(results.root) == []


def test_a_stage_without_results_is_clean(set_stage):
    """A user's stage can be checked before anything is run."""
    assert validate_stage(set_stage) == []


def test_light_at_points_is_clean(tmp_path, set_stage):
    """Primvars and the look that reads them are as good as pictures, and so is a stage with no results at all."""
    scene = ws.Scene.open(set_stage)
    colors = {frame: np.random.default_rng(frame).random((4, 3), np.float32) for frame in scene.frames}
    bake = VertexBakeResult(surface=scene.surfaces[0], bake="lit", values=colors)
    assert validate_stage(write_results(tmp_path / "out", "set", scene, bakes=[bake])) == []
    assert validate_stage(write_results(tmp_path / "empty", "set", scene)) == []


def _set(path, value, time=None):
    at = Usd.TimeCode.Default() if time is None else time
    return lambda stage: stage.GetAttributeAtPath(path).Set(value, at)


FAULTS = {
    "volume file missing at one frame": (
        _set(f"{DENSITY}.filePath", Sdf.AssetPath("./volumes/gone.vdb"), 6),
        f"{DENSITY}.filePath",
    ),
    "gap in the frames": (
        lambda stage: stage.GetAttributeAtPath(f"{DENSITY}.filePath").ClearAtTime(6),
        f"{DENSITY}.filePath",
    ),
    "file between frames": (
        _set(f"{DENSITY}.filePath", Sdf.AssetPath("./volumes/Box.0006.vdb"), 6.5),
        f"{DENSITY}.filePath",
    ),
    "field that leads nowhere": (
        lambda stage: stage.GetPrimAtPath("/World/Box_smoke").GetRelationship("field:vel").SetTargets(["/World/No"]),
        "/World/Box_smoke.field:vel",
    ),
    "no extent": (lambda stage: stage.GetPrimAtPath("/World/Box_smoke").RemoveProperty("extent"), "/World/Box_smoke"),
    "extent smaller than the smoke": (
        _set("/World/Box_smoke.extent", [(0, 0, 0), (100, 100, 100)]),
        "/World/Box_smoke.extent",
    ),
    "picture missing": (_set(f"{PICTURE}.inputs:file", Sdf.AssetPath("./gone.png")), f"{PICTURE}.inputs:file"),
    "picture missing at one frame": (
        _set(f"{PICTURE}.inputs:file", Sdf.AssetPath("./gone.png"), 6),
        f"{PICTURE}.inputs:file",
    ),
    "bake missing": (
        _set("/World/Floor.smokeBaked:smokeShadow", Sdf.AssetPath("./gone.png")),
        "/World/Floor.smokeBaked:smokeShadow",
    ),
    "unknown token": (_set(f"{DENSITY}.fieldDataType", "halves"), f"{DENSITY}.fieldDataType"),
    "unknown wrap mode": (_set(f"{PICTURE}.inputs:wrapS", "tile"), f"{PICTURE}.inputs:wrapS"),
    "unknown smoke token": (
        lambda stage: (
            stage.GetPrimAtPath("/World/Box")
            .CreateAttribute("smoke:grids", Sdf.ValueTypeNames.TokenArray, False, Sdf.VariabilityUniform)
            .Set(["fire"])
        ),
        "/World/Box.smoke:grids",
    ),
    "extent too small": (_set("/World/Floor.extent", [(0, 0, 0), (1, 1, 0)]), "/World/Floor.extent"),
    "wrong type": (
        lambda stage: Sdf.AttributeSpec(
            stage.GetEditTarget().GetLayer().GetPrimAtPath("/World/Floor"), "doubleSided", Sdf.ValueTypeNames.String
        ),
        "/World/Floor.doubleSided",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found(results, fault):
    """Each kind of fault is an error at its place."""
    plant, where = FAULTS[fault]
    assert ("error", where) in problems_after(results, plant)


def test_a_shader_from_a_file_is_left_to_its_renderer(results):
    """A node without an identifier, as MDL and glslfx have, is no fault where only its renderer meets it."""

    def plant(stage):
        shader = UsdShade.Shader.Define(stage, "/World/Looks/Grey/Own")
        shader.SetSourceAsset(Sdf.AssetPath("OmniPBR.mdl"), "mdl")
        output = shader.CreateOutput("out", Sdf.ValueTypeNames.Token)
        UsdShade.Material.Get(stage, "/World/Looks/Grey").CreateSurfaceOutput("mdl").ConnectToSource(output)
        stage.GetDefaultPrim().GetVariantSet("smokeLook").SetVariantSelection("dcc")

    assert [problem for problem in problems_after(results, plant) if problem[0] != "info"] == []


def test_an_unknown_shader_for_all_is_an_error(results):
    """A node that no one knows, on the output that is for every renderer, is a fault."""

    def plant(stage):
        shader = UsdShade.Shader.Define(stage, "/World/Looks/Grey/Odd")
        shader.CreateIdAttr("OddSurface")
        output = shader.CreateOutput("out", Sdf.ValueTypeNames.Token)
        UsdShade.Material.Get(stage, "/World/Looks/Grey").CreateSurfaceOutput().ConnectToSource(output)

    assert ("error", "/World/Looks/Grey/Odd.info:id") in problems_after(results, plant)


def test_a_light_may_have_inputs_of_other_renderers(results):
    """An input that UsdLux does not know is a warning, not an error."""

    def plant(stage):
        lamp = stage.DefinePrim("/World/Lamp", "SphereLight")
        lamp.CreateAttribute("inputs:glow", Sdf.ValueTypeNames.Float).Set(1.0)

    assert ("warning", "/World/Lamp.inputs:glow") in problems_after(results, plant)


def test_a_shader_may_have_inputs_of_other_programs(results):
    """An input that a shader does not know, as Blender gives every material `specular`, is a warning."""

    def plant(stage):
        UsdShade.Shader.Get(stage, PICTURE).CreateInput("glow", Sdf.ValueTypeNames.Float).Set(1.0)

    found = problems_after(results, plant)
    assert ("warning", f"{PICTURE}.inputs:glow") in found
    assert not any(severity == "error" for severity, _ in found)


@pytest.mark.skipif(find_spec("usd_validation_nvidia") is None, reason="its rule")
def test_slow_text_files_are_told_of_the_layer_that_is_one(tmp_path):
    """A user's large text layer is no problem of the layers that a run wrote over it."""
    ball = ws.Surface(path="/World/Ball", mesh=ws.Mesh.sphere(segments=64))
    author_scene(ws.Scene(surfaces=[ball]), tmp_path / "large.usda")
    root = write_results(tmp_path / "out", "large", ws.Scene.open(tmp_path / "large.usda"))
    slow = [each for each in validate_stage(root) if each.source == "UsdAsciiPerformanceChecker"]
    assert [(each.part, each.severity) for each in slow] == [("stage", "warning")]


def test_files_without_a_default_are_named(results):
    """A reader that knows no time finds no file where there are samples alone."""
    warned = problems_after(results, lambda stage: stage.GetAttributeAtPath(f"{DENSITY}.filePath").ClearDefault())
    assert ("warning", f"{DENSITY}.filePath") in warned


def test_a_format_that_few_read(results):
    """A volume that is there, but whose name does not end in .vdb, is an error."""
    folder = results.root.parent / "volumes"
    (folder / "Box.0006.nvdb").write_bytes((folder / "Box.0006.vdb").read_bytes())
    found = problems_after(results, _set(f"{DENSITY}.filePath", Sdf.AssetPath("./volumes/Box.0006.nvdb"), 6))
    assert [problem for problem in found if problem[0] == "error"] == [("error", f"{DENSITY}.filePath")]


def test_fields_in_different_files_are_named(results):
    """A renderer that reads one file finds only one of the fields."""
    warned = problems_after(results, _set(f"{DENSITY}.filePath", Sdf.AssetPath("./volumes/Box.0007.vdb"), 5))
    assert ("warning", "/World/Box_smoke") in warned


@pytest.mark.parametrize("kind", ["lost grid", "noise"])
def test_a_volume_file_is_looked_into(results, kind):
    """A file without its grid, or that is no volume file at all, is an error."""
    path = results.root.parent / "volumes/Box.0006.vdb"
    if kind == "noise":
        path.write_bytes(np.random.default_rng(0).bytes(1000))
    else:
        grid = Grid("density", np.ones((2, 2, 2), np.float32), voxel_size=1.0, translation=(0.5, 0.5, 0.5))
        write_vdb(path, [grid])
    found = [problem for problem in validate_stage(results.root) if problem.severity == "error"]
    assert found
    assert {problem.where for problem in found} == {str(path)}
    if kind == "lost grid":
        assert any("has no grid vel" in problem.message for problem in found)


def test_value_clips_are_refused(results):
    """Files that come from value clips play in no Blender."""

    def plant(stage):
        field = stage.GetPrimAtPath(DENSITY)
        field.RemoveProperty("filePath")
        clip = Sdf.Layer.CreateNew(str(results.root.with_name("clip.usda")))
        Sdf.CreatePrimInLayer(clip, "/density")
        files = Sdf.AttributeSpec(clip.GetPrimAtPath("/density"), "filePath", Sdf.ValueTypeNames.Asset)
        clip.SetTimeSample(files.path, 5, Sdf.AssetPath("./volumes/Box.0005.vdb"))
        clip.Save()
        clips = Usd.ClipsAPI(field)
        clips.SetClipAssetPaths([Sdf.AssetPath("./clip.usda")])
        clips.SetClipPrimPath("/density")
        clips.SetClipActive([(5, 0)])
        clips.SetClipTimes([(5, 5), (7, 5)])
        clips.SetClipManifestAssetPath(Sdf.AssetPath("./clip.usda"))

    assert ("error", f"{DENSITY}.filePath") in problems_after(results, plant)


def test_a_tiled_picture_needs_a_tile(tmp_path, set_stage):
    """`<UDIM>` stands for the tiles that are there, and is an error if there are none."""
    set_stage.write_text(
        SET.replace(
            'def Shader "Surface"',
            """def Shader "Tiles"
            {
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @./wood.<UDIM>.png@
            }

            def Shader "Surface\"""",
        )
    )
    where = "/World/Looks/Grey/Tiles.inputs:file"
    assert where in [problem.where for problem in validate_stage(set_stage)]
    (set_stage.parent / "wood.1001.png").touch()
    assert where not in [problem.where for problem in validate_stage(set_stage)]


def test_what_the_reader_refuses_is_an_error(set_stage):
    """A value that the scene may not have is found before anything is run."""
    set_stage.write_text(SET.replace("int smoke:resolution = 8", "int smoke:resolution = -8"))
    (found,) = validate_stage(set_stage)
    assert found.severity == "error"
    assert "smoke:resolution" in found.message


def test_noise_is_not_a_stage(tmp_path):
    """A file that USD cannot read is one error; a file that is not there is bad input."""
    path = tmp_path / "noise.usda"
    path.write_bytes(np.random.default_rng(0).bytes(1000))
    assert [problem.severity for problem in validate_stage(path)] == ["error"]
    with pytest.raises(ValueError, match="no such file"):
        validate_stage(tmp_path / "gone.usda")


def test_whose_a_problem_is(results, set_stage):
    """What is wrong with the user's floor is of the stage, with a volume's fields or files of the results."""
    set_stage.write_text(SET.replace("float3[] extent = [(-100, -100, 0), (100, 100, 0)]", "", 1))
    (results.root.parent / "volumes/Box.0006.vdb").write_bytes(b"noise")
    stage = Usd.Stage.Open(str(results.root))
    stage.SetEditTarget(Sdf.Layer.FindOrOpen(str(results.root.with_name("set.results.usdc"))))
    _set("/World/Floor.smokeBaked:smokeShadow", Sdf.AssetPath("./gone.png"))(stage)
    stage.GetEditTarget().GetLayer().Save()
    stage.GetRootLayer().Reload()
    found = [(each.part, each.severity, each.where) for each in validate_stage(results.root)]
    assert found[0] == ("stage", "warning", "/World/Floor")
    assert {each[:2] for each in found[1:]} == {("results", "error")}
    assert ("results", "error", "/World/Floor.smokeBaked:smokeShadow") in found
    assert ("results", "error", str(results.root.parent / "volumes/Box.0006.vdb")) in found


UNTIDY = """#usda 1.0
(
    defaultPrim = "World"
    upAxis = "Y"
    metersPerUnit = 1
)
def "World"
{
    def Mesh "Floor"
    {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(-3, 0, 3), (3, 0, 3), (3, 0, -3)]
        uniform token subdivisionScheme = "none"
    }
}
"""


def test_style_is_a_warning_told_once(tmp_path):
    """No type, extent or normals: every DCC reads it, and what two validators find stands there once."""
    path = tmp_path / "untidy.usda"
    path.write_text(UNTIDY)
    found = [(problem.severity, problem.where) for problem in validate_stage(path)]
    assert {severity for severity, _ in found} == {"warning"}
    assert found.count(("warning", "/World")) <= 1  # its type, which two rules of usd-validation-nvidia miss
    assert found.count(("warning", "/World/Floor")) == 1 + (find_spec("usd_validation_nvidia") is not None)


def test_a_missing_file_and_unit_are_told_once(tmp_path):
    """Each is an error that up to three validators find."""
    path = tmp_path / "torn.usda"
    path.write_text(UNTIDY.replace("metersPerUnit = 1", "").replace("}", "    asset map = @./gone.png@\n    }", 1))
    errors = [problem for problem in validate_stage(path) if problem.severity == "error"]
    assert [problem.where for problem in errors if "gone.png" in problem.message] == ["/World/Floor.map"]
    assert sum("metersPerUnit" in problem.message for problem in errors) == 1
    assert len(errors) == 2
