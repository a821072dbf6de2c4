import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdVol
from results import write_all

import warp_smoke as ws
from warp_smoke.usd.export import flatten_stage
from warp_smoke.usd.validate import validate_stage
from warp_smoke.usd.volume_shader import VOLUME_SHADERS, write_volume_shader

# The set is in centimetres and its smoke dims by 4 a metre at density 1.
PER_UNIT = 0.04


def bound(stage: Usd.Stage, path: str) -> UsdShade.Material:
    """The material of a prim."""
    return UsdShade.MaterialBindingAPI(stage.GetPrimAtPath(path)).ComputeBoundMaterial()[0]


def source(output) -> UsdShade.Shader:
    """The shader that an input or output is connected to."""
    (connection,), _ = output.GetConnectedSources()
    return UsdShade.Shader(connection.source)


@pytest.mark.parametrize("renderer", VOLUME_SHADERS)
def test_shaders_stay_in_a_layer_of_their_own(results, renderer):
    """The results layer keeps its bytes, the root names the new layer first, and twice gives the same bytes."""
    layer = results.root.with_name("set.results.usdc")
    before = layer.read_bytes()
    path = write_volume_shader(results.root, results.scene, renderer)
    files = path.read_bytes(), results.root.read_bytes()
    assert layer.read_bytes() == before
    root = Sdf.Layer.FindOrOpen(str(results.root))
    assert list(root.subLayerPaths)[:2] == [f"./set.{renderer}.usda", "./set.results.usdc"]
    write_volume_shader(results.root, results.scene, renderer)
    assert (path.read_bytes(), results.root.read_bytes()) == files


@pytest.mark.parametrize("renderer", VOLUME_SHADERS)
def test_results_with_a_shader_are_clean(results, renderer):
    """No validator finds a fault with the stage, nor with its flattened form; some nodes only their renderer knows."""
    write_volume_shader(results.root, results.scene, renderer)
    for path in (results.root, flatten_stage(results.root, results.root.with_suffix(".flat.usdc"))):
        assert [problem for problem in validate_stage(path) if problem.severity != "info"] == []


@pytest.mark.parametrize("renderer", VOLUME_SHADERS)
def test_the_scene_is_the_same_with_a_shader(results, renderer):
    """What was added for a renderer is nothing to simulate, to bake or to draw."""
    before = ws.Scene.open(results.root)
    write_volume_shader(results.root, results.scene, renderer)
    assert ws.Scene.open(results.root) == before


def test_karma_scatters_and_absorbs(tmp_path, set_stage):
    """kma_volume gets σ · albedo and σ · (1 − albedo), times the density grid, for each stage unit."""
    text = set_stage.read_text().replace(
        "int smoke:resolution = 8", "int smoke:resolution = 8\n        color3f smoke:albedo = (1, 0.75, 0.5)"
    )
    set_stage.write_text(text)
    results = write_all(set_stage, tmp_path / "out")
    write_volume_shader(results.root, results.scene, "karma")
    stage = Usd.Stage.Open(str(results.root))
    smoke = source(bound(stage, "/World/Box_smoke").GetVolumeOutput("kma"))
    assert smoke.GetShaderId() == "kma_volume"
    for name, expected in (("scattering", (1, 0.75, 0.5)), ("absorption", (0, 0.25, 0.5))):
        product = source(smoke.GetInput(name))
        np.testing.assert_allclose(product.GetInput("in1").Get(), PER_UNIT * np.array(expected), rtol=1e-6)
        assert source(product.GetInput("in2")).GetInput("geomprop").Get() == "density"


def test_arnold_reads_the_density_channel(results):
    """standard_volume has σ for each stage unit as its density, from the grid of that name."""
    write_volume_shader(results.root, results.scene, "arnold")
    stage = Usd.Stage.Open(str(results.root))
    smoke = source(bound(stage, "/World/Box_smoke").GetVolumeOutput("arnold"))
    assert smoke.GetShaderId() == "arnold:standard_volume"
    assert smoke.GetInput("density").Get() == pytest.approx(PER_UNIT)
    assert smoke.GetInput("density_channel").Get() == "density"


def test_omniverse_gets_a_box_in_the_space_of_the_grid(results):
    """The box is where the volume is, its points are the grid's corners, and its material plays the same files."""
    write_volume_shader(results.root, results.scene, "omniverse")
    stage = Usd.Stage.Open(str(results.root))
    volume, box = (UsdVol.Volume.Get(stage, "/World/Box_smoke"), UsdGeom.Mesh.Get(stage, "/World/Box_smoke_omniverse"))
    cache = UsdGeom.XformCache()
    assert cache.GetLocalToWorldTransform(box.GetPrim()) == cache.GetLocalToWorldTransform(volume.GetPrim())
    points = np.array(box.GetPointsAttr().Get())
    np.testing.assert_array_equal([points.min(axis=0), points.max(axis=0)], volume.GetExtentAttr().Get())
    faces = np.reshape(box.GetFaceVertexIndicesAttr().Get(), (6, 4))
    triangles = points.astype(float)[np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])]
    enclosed = np.linalg.det(triangles).sum() / 6
    assert enclosed == pytest.approx(np.prod(np.ptp(points, axis=0)), rel=1e-6)  # all faces look outwards
    smoke = source(bound(stage, box.GetPath()).GetVolumeOutput("mdl"))
    file = UsdVol.OpenVDBAsset.Get(stage, "/World/Box_smoke/density").GetFilePathAttr()
    texture = smoke.GetInput("volume_density_texture").GetAttr()
    for time in (*file.GetTimeSamples(), Usd.TimeCode.Default()):
        assert texture.Get(time).resolvedPath == file.Get(time).resolvedPath
    assert texture.GetTimeSamples() == file.GetTimeSamples()
    assert smoke.GetInput("volume_density_scale").Get() == pytest.approx(PER_UNIT)


def test_an_unknown_renderer_is_bad_input(results):
    """The error lists the renderers."""
    with pytest.raises(ValueError, match="karma, arnold, omniverse"):
        write_volume_shader(results.root, results.scene, "mantra")
