"""The preview of a stage, from its files to the picture."""

import shutil
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdGeom
from scenes import at, plume

import warp_smoke as ws
from warp_smoke.files import write_png
from warp_smoke.geometry import transform_points
from warp_smoke.lattice import place_lattice
from warp_smoke.preview import preview
from warp_smoke.preview.camera import camera_view
from warp_smoke.preview.color import linear_to_srgb, to_bytes
from warp_smoke.preview.stage import PreviewStage
from warp_smoke.preview.view import StageView
from warp_smoke.usd.author import author_scene
from warp_smoke.usd.material import BakeResult, VertexBakeResult
from warp_smoke.usd.write import write_results

SIZE = (160, 120)


def _picture(path, folder, frame, **asked):
    """The picture that `preview` saves, [h, w, 3] int."""
    file = folder / "picture.png"
    preview(path, frame=frame, screenshot=file, size=SIZE, **asked)
    return np.asarray(Image.open(file)).astype(int)


def _without_smoke(results, frame, open_plotter):
    """The same stage drawn twice by one plotter, before magenta: with its smoke and without."""
    stage = PreviewStage(results)
    plotter = open_plotter(SIZE)
    view = StageView(stage, plotter, 1.0)
    plotter.set_background("magenta")  # which no smoke is
    whole = stage.load(frame)
    bare = type(whole)(whole.number, (None,) * len(whole.smoke), whole.pictures, whole.colors)
    pictures = []
    for each in (whole, bare):
        view.show(each)
        pictures.append(view.picture().astype(int))
    return pictures


def test_smoke_covers_its_pixels(results, open_plotter):
    """The ball of smoke changes the pixels that it covers, every one well inside it, and none outside."""
    smoky, bare = _without_smoke(results, 4, open_plotter)
    changed = np.abs(smoky - bare).max(axis=2) > 3
    camera = PreviewStage(results).scene.camera
    view = camera_view(camera, 4, SIZE[0] / SIZE[1], 5.0)
    # From 6 units in front: the ball's edge is seen at asin(r/6) around the point (0, 1, 0).
    y, x = np.indices(SIZE[::-1]) + 0.5
    angle = np.arctan(np.hypot(x - 80, y - 60) / 60 * np.tan(np.radians(view.angle / 2)))
    voxel = 2 / 16
    assert changed[angle < np.arcsin((0.8 - 2 * voxel) / 6)].all()
    assert not changed[angle > np.arcsin((0.8 + 2 * voxel) / 6)].any()


def test_dense_smoke_hides_what_is_behind(results, open_plotter):
    """Along its middle the ball is 8 · 1.6 deep: what is seen there is smoke alone, lit from above."""
    smoky, bare = _without_smoke(results, 4, open_plotter)
    assert np.abs(smoky[60, 80] - bare[60, 80]).max() > 20
    assert np.ptp(smoky[60, 80]) < 5
    assert smoky[48, 80].mean() > smoky[72, 80].mean() + 10


def test_floor_shows_its_baked_picture(results, tmp_path):
    """Where there is no smoke the floor has the baked bytes of its frame, in a stage given by file or by folder."""
    assert (_picture(results, tmp_path, 3)[110, 20] == 200).all()
    assert (_picture(results.parent, tmp_path, 4)[110, 20] == 100).all()


def test_baked_pictures_keep_their_alpha(tmp_path):
    """A see-through floor is baked with alpha: where it is not there, what is behind it is seen."""
    codes = np.full((8, 8, 4), (200, 200, 200, 0), np.uint8)
    codes[:, 4:, 3] = 255
    write_png(tmp_path / "lit.png", codes)
    mesh, path = ws.Mesh.grid((-2, 0, 4), (4, 0, 0), (0, 0, -8)), "/World/Floor"
    floor = ws.Surface(path=path, mesh=mesh, receiver=ws.Receiver(path=path))
    camera = ws.Camera(path="/World/Eye", transform=at(0, 1, 6), focal_length=20.0)
    baked = BakeResult(surface=floor, bake="lit", files={1: "./lit.png"})
    root = write_results(tmp_path, "floor", ws.Scene(surfaces=[floor], camera=camera, end=1), bakes=[baked])
    picture = _picture(root, tmp_path, 1)
    assert (picture[110, 140] == 200).all()
    assert (picture[110, 20] != 200).all()


def test_floor_without_uvs_shows_the_colors_at_its_points(tmp_path):
    """Light baked at points is drawn as it is, in sRGB, and changes with the frame."""
    mesh = ws.Mesh([(-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9)], [(0, 1, 2), (0, 2, 3)])
    floor = ws.Surface(path="/World/Floor", mesh=mesh, receiver=ws.Receiver(path="/World/Floor"))
    scene = ws.Scene(surfaces=[floor], camera=ws.Camera(path="/World/Eye", transform=at(0, 1, 6)), start=3, end=4)
    values = {frame: np.full((4, 3), grey, np.float32) for frame, grey in ((3, 0.2), (4, 0.6))}
    bake = VertexBakeResult(surface=floor, bake="lit", values=values)
    root = write_results(tmp_path, "points", scene, [], [bake])
    for frame, grey in ((3, 0.2), (4, 0.6)):
        assert (_picture(root, tmp_path, frame)[110, 80] == linear_to_srgb(np.array(grey))).all()


def test_unbaked_look_is_lit_by_the_stage(results, tmp_path):
    """With the look switched to the user's own, the floor has its material under the stage's lamp again."""
    folder = tmp_path / "dcc"
    shutil.copytree(results.parent, folder)
    stage = Usd.Stage.Open(str(folder / results.name))
    stage.GetDefaultPrim().GetVariantSet("smokeLook").SetVariantSelection("dcc")
    stage.Save()
    unlike = np.abs(_picture(folder, tmp_path, 3) - _picture(results, tmp_path, 3)).max(axis=2)
    assert unlike[105:111, 15:25].min() > 20


def test_smoke_behind_a_wall_is_hidden(results, tmp_path, open_plotter):
    """A wall between the camera and the smoke hides it: the pictures with and without smoke are the same."""
    folder = tmp_path / "walled"
    shutil.copytree(results.parent, folder)
    wall = """
        #usda 1.0
        (
            subLayers = [@./ball.usda@]
            defaultPrim = "World"
            startTimeCode = 3
            endTimeCode = 4
        )
        over "World"
        {
            def Mesh "Wall"
            {
                int[] faceVertexCounts = [4]
                int[] faceVertexIndices = [0, 1, 2, 3]
                point3f[] points = [(-2, -1, 2), (2, -1, 2), (2, 3, 2), (-2, 3, 2)]
            }
        }
    """
    (folder / "walled.usda").write_text("\n".join(line[8:] for line in wall.strip("\n").splitlines()))
    smoky, bare = _without_smoke(folder / "walled.usda", 4, open_plotter)
    np.testing.assert_array_equal(smoky, bare)


def test_extinction_is_the_domains(results):
    """Opacity follows the domain's extinction, found through the volume's relationship to it."""
    (smoke,) = PreviewStage(results).load(4).smoke
    assert smoke.extinction == pytest.approx(8.0, rel=1e-3)  # densities are stored in half precision


def test_smoke_lies_where_the_lattice_put_it(results):
    """The voxels' box around the ball of radius 0.8 at (0, 1, 0), within a voxel of 0.125 and the empty layer."""
    (smoke,) = PreviewStage(results).load(4).smoke
    last = np.array(smoke.rgba.shape[:3]) - 1
    corners = transform_points(smoke.to_world, [np.zeros(3), last])
    np.testing.assert_allclose(corners, [[-0.8, 0.2, -0.8], [0.8, 1.8, 0.8]], atol=0.125 + 1e-6)


def test_light_in_the_volume_files_is_the_smokes_color(tmp_path):
    """A run that writes the light grid is shown with it: as the simulation's own light, file and frame alike."""
    scene = plume(frames=6, grids=("density", "light"))
    made = []
    result = ws.run(scene, tmp_path, on_frame=made.append)
    (shown,) = PreviewStage(result.stage).load(6).smoke
    fields = made[-1].smoke["/World/Smoke"]
    thick = fields.density > 0.3 * fields.density.max()
    cells = np.argwhere(thick)
    centers = transform_points(place_lattice(scene, scene.domains[0]).cells_to_world(), cells + 0.5)
    voxels = np.rint(transform_points(np.linalg.inv(shown.to_world), centers)).astype(int)
    seen = to_bytes(shown.rgba[(*voxels.T, slice(3))]).astype(int)
    assert np.abs(seen - linear_to_srgb(fields.light[thick])).max() <= 2  # half precision in the file
    assert np.ptp(seen) > 20


def test_a_stage_with_nothing_on_it(tmp_path):
    """It is drawn as its background with a line of text, and so is one with a light but no marks."""
    author_scene(ws.Scene(end=1), tmp_path / "empty.usda")
    author_scene(ws.Scene(end=1, lights=[ws.DistantLight(path="/World/Sun")]), tmp_path / "sun.usda")
    empty, sun = (_picture(tmp_path / f"{name}.usda", tmp_path, 1) for name in ("empty", "sun"))
    marked = _picture(tmp_path / "sun.usda", tmp_path, 1, marks=True)
    for said in (empty, sun):
        assert (np.abs(np.diff(said[:, :40], axis=1)).max(axis=2) > 20).sum() > 50
    assert not np.array_equal(empty, sun)
    assert (np.abs(np.diff(marked[:, :40], axis=1)).max(axis=2) > 20).sum() == 0


def test_pictures_have_no_marks_unless_asked(tmp_path):
    """A red lamp before a black wall is a red ball in the middle with `marks`, and is not seen without."""
    wall = ws.Surface(
        path="/World/Wall",
        mesh=ws.Mesh.grid((-9, -9, -1), (18, 0, 0), (0, 18, 0)),
        material=ws.Material(path="/World/Black", diffuse_color=(0.0, 0.0, 0.0)),
    )
    lamp = ws.PointLight(path="/World/Lamp", transform=at(0, 1, 0), color=(1.0, 0.0, 0.0))
    eye = ws.Camera(path="/World/Eye", transform=at(0, 1, 6))
    path = tmp_path / "lamp.usda"
    author_scene(ws.Scene(surfaces=[wall], lights=[lamp], camera=eye, end=1), path)
    plain, marked = (_picture(path, tmp_path, 1, **asked) for asked in ({}, {"marks": True}))
    assert plain.max() == 0
    assert marked[60, 80].tolist() == [255, 0, 0]


def test_middle_frame_unless_given(results, tmp_path):
    """Without a frame the middle one of the stage is drawn: 4 of 3 and 4."""
    np.testing.assert_array_equal(_picture(results, tmp_path, None), _picture(results, tmp_path, 4))


def test_same_stage_same_picture(results, tmp_path):
    """Two previews of one frame are byte-equal."""
    np.testing.assert_array_equal(_picture(results, tmp_path, 3), _picture(results, tmp_path, 3))


def test_stage_before_a_run_shows_its_setup(tmp_path, open_plotter):
    """A user's own stage shows the domain's box and the emitter as wires."""
    path = tmp_path / "mine.usda"
    source = ws.Emitter(path="/World/Source", mesh=ws.Mesh.sphere(0.3))
    author_scene(ws.Scene(domains=[ws.SmokeDomain(path="/World/Box")], emitters=[source]), path)
    stage = PreviewStage(path)
    assert not stage.has_results
    plotter = open_plotter(SIZE)
    view = StageView(stage, plotter, 1.0)
    view.show(stage.load(1))
    hue = view.picture().astype(int) @ [1, 0, -1]
    assert (hue < -20).sum() > 100  # the box's blue
    assert (hue > 20).sum() > 50  # the emitter's orange


@pytest.mark.parametrize("frame", [2, 5])
def test_frame_that_is_not_there(results, tmp_path, frame):
    """A frame outside the stage's is refused with those that there are."""
    with pytest.raises(ValueError, match=f"frame is {frame}; allowed: 3 to 4"):
        _picture(results, tmp_path, frame)


def test_missing_volume_file(results, tmp_path):
    """A `.vdb` that is gone is named, with the prim and the frame."""
    folder = tmp_path / "torn"
    shutil.copytree(results.parent, folder)
    (folder / "volumes" / "4.vdb").unlink()
    with pytest.raises(ValueError, match=r"/World/Smoke_smoke/density.filePath: .*4\.vdb.* at frame 4"):
        _picture(folder, tmp_path, 4)


def test_damaged_volume_file(results, tmp_path):
    """A `.vdb` cut short is refused in one line, not a crash."""
    folder = tmp_path / "damaged"
    shutil.copytree(results.parent, folder)
    file = folder / "volumes" / "4.vdb"
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(ValueError, match=r"4\.vdb"):
        _picture(folder, tmp_path, 4)


def test_folder_without_results(tmp_path):
    """A folder that no run wrote is refused."""
    with pytest.raises(ValueError, match="nor a folder with the results of one run; found: none"):
        preview(tmp_path, screenshot=tmp_path / "picture.png")


def test_a_notebook_shows_the_picture(results, tmp_path, monkeypatch):
    """Under a Jupyter kernel the picture is displayed below the cell: the one that a screenshot saves."""
    shown = []
    ipython = ModuleType("IPython")
    ipython.get_ipython = lambda: SimpleNamespace(kernel=True)
    display = ModuleType("IPython.display")
    display.display = shown.append
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    preview(results, frame=3, size=SIZE)
    (image,) = shown
    np.testing.assert_array_equal(np.asarray(image), _picture(results, tmp_path, 3))


def test_a_quantity_that_is_not_known(results, tmp_path):
    """Another name than those there are is refused with these."""
    with pytest.raises(ValueError, match="quantity is heat; allowed: density, temperature, speed"):
        preview(results, screenshot=tmp_path / "a.png", quantity="heat")


def test_a_quantity_that_was_not_written(results, tmp_path):
    """One that no volume has is refused with those that there are, and with what to do."""
    said = "the volumes have no velocity; they have: density; add velocity to smoke:grids and run again"
    with pytest.raises(ValueError, match=said):
        preview(results, screenshot=tmp_path / "a.png", quantity="speed")


def test_instances_of_a_point_instancer_are_drawn(tmp_path, open_plotter):
    """Surfaces that have no prim of their own are drawn as any other."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "many.usda"))
    stage.SetDefaultPrim(stage.DefinePrim("/World", "Xform"))
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Many")
    UsdGeom.Cube.Define(stage, "/World/Many/Box")
    instancer.CreatePrototypesRel().AddTarget("/World/Many/Box")
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(-3, 0, 0), (3, 0, 0)])
    stage.Save()
    view = StageView(PreviewStage(tmp_path / "many.usda"), open_plotter(SIZE), 1.0)
    view.plotter.set_background("black")
    view.show(PreviewStage(tmp_path / "many.usda").load(1))
    seen = view.picture().max(axis=(0, 2)) > 20
    assert np.count_nonzero(np.diff(np.concatenate([[0], seen, [0]])) == 1) == 2  # two boxes side by side
