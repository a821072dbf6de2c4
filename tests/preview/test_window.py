"""The window's slider: the frame it is drawn to is the frame that is shown."""

import shutil
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from scenes import at

import warp_smoke as ws
from warp_smoke.files import write_png
from warp_smoke.preview.stage import PreviewStage
from warp_smoke.preview.view import StageView
from warp_smoke.preview.window import Window
from warp_smoke.usd.author import author_scene
from warp_smoke.usd.write import BakeResult, write_results

SIZE = (160, 120)


@pytest.fixture
def window_of(open_plotter):
    """Makes windows on stages, off-screen: window, and its view."""

    def make(path, frame):
        stage = PreviewStage(path)
        view = StageView(stage, open_plotter(SIZE), 1.0)
        return Window(stage, view, frame), view

    return make


def _seen(window, view):
    """The floor's grey once the window has caught up with its slider."""
    window.poll()
    while window._loading is not None:
        window.poll()
    return view.picture()[100, 20].tolist()


def test_slider_shows_the_frame_it_is_moved_to(results, window_of):
    """The first frame is there at once; one moved to, also between two time codes, is there when it is read."""
    window, view = window_of(results, 3)
    assert view.picture()[100, 20].tolist() == [200] * 3
    window.seek(3.6)
    assert _seen(window, view) == [100] * 3
    window.seek(3.0)
    assert _seen(window, view) == [200] * 3
    window.close()


def test_damaged_frame_is_said_in_the_window(results, tmp_path, window_of):
    """A frame that cannot be read leaves the last one standing with a line of text, and the window goes on."""
    folder = tmp_path / "damaged"
    shutil.copytree(results.parent, folder)
    (folder / "volumes" / "4.vdb").write_bytes(b"nothing")
    window, view = window_of(folder, 3)
    whole = view.picture()
    window.seek(4)
    assert _seen(window, view) == [200] * 3
    assert not np.array_equal(view.picture(), whole)
    window.seek(3)
    _seen(window, view)
    np.testing.assert_array_equal(view.picture(), whole)
    window.close()


def test_space_plays_at_the_stages_rate(results, window_of):
    """Playing goes from frame to frame by the clock, from the last to the first, until space is pressed again."""
    window, view = window_of(results, 3)
    now = [0.0]
    window._clock = lambda: now[0]
    window.press("space")
    assert _seen(window, view) == [200] * 3  # no time has passed
    for expected in (100, 200, 100):
        now[0] += 1 / 24
        assert _seen(window, view) == [expected] * 3
    window.press("space")
    now[0] += 1.0
    assert _seen(window, view) == [100] * 3
    window.close()


def test_keys_step_and_stay_within_the_frames(results, window_of):
    """Arrows, home and end move by frames; before the first and after the last there is none."""
    window, view = window_of(results, 3)
    for key, expected in (("Right", 100), ("Right", 100), ("Left", 200), ("Left", 200), ("End", 100), ("Home", 200)):
        window.press(key)
        assert _seen(window, view) == [expected] * 3
    window.close()


@pytest.mark.parametrize("key", ["s", "b", "c", "h"])
def test_keys_switch_parts_of_the_picture(results, window_of, key):
    """Smoke, baked light, camera and help: a key changes the picture, pressed again it is byte-equal."""
    window, view = window_of(results, 4)
    before = view.picture()
    window.press(key)
    assert np.abs(view.picture().astype(int) - before).max() > 10
    window.press(key)
    np.testing.assert_array_equal(view.picture(), before)
    window.close()


@pytest.mark.parametrize("key", ["d", "l", "F1"])
def test_keys_switch_light(results, window_of, key):
    """Shadows, all lights and the first one: a key bakes the floor anew and is told of, again brings every byte back.

    Without its lamp the floor is black, also with its own look and in another frame.
    """
    window, view = window_of(results, 3)
    before = view.picture()
    window.press(key)
    floor = _seen(window, view)
    switched = view.picture()
    assert np.abs(switched.astype(int) - before)[:16].max() > 50  # the line at the top
    if key == "d":
        assert np.abs(np.array(floor) - 200).min() > 10
    else:
        assert floor == [0, 0, 0]
        window.press("b")
        assert _seen(window, view) == [0, 0, 0]
        window.press("b")
        window.seek(4)
        assert _seen(window, view) == [0, 0, 0]
        window.seek(3)
        _seen(window, view)
    window.press(key)
    _seen(window, view)
    np.testing.assert_array_equal(view.picture(), before)
    window.close()


def test_lights_of_a_stage_before_a_run(tmp_path, window_of):
    """Two lamps of different colours: each key switches its own, of which there are no more than lights."""
    lamps = [
        ws.PointLight(path=f"/World/{name}", transform=at(0, 4, 0), intensity=400.0, color=color)
        for name, color in (("A", (1.0, 0.0, 0.0)), ("B", (0.0, 0.0, 1.0)))
    ]
    floor = ws.Surface(path="/World/Floor", mesh=ws.Mesh.grid((-9, 0, 9), (18, 0, 0), (0, 0, -18)))
    eye = ws.Camera(path="/World/Eye", transform=at(0, 1, 6), focal_length=20.0)
    author_scene(ws.Scene(surfaces=[floor], lights=lamps, camera=eye, end=1), tmp_path / "two.usda")
    window, view = window_of(tmp_path / "two.usda", 1)

    def lit():
        _seen(window, view)
        red, _, blue = view.picture()[100, 80].tolist()
        return red > 50, blue > 50

    assert lit() == (True, True)
    for key, expected in (
        ("F1", (False, True)),
        ("F2", (False, False)),
        ("F3", (False, False)),
        ("F1", (True, False)),
        ("l", (True, True)),
        ("l", (False, False)),
        ("l", (True, True)),
    ):
        window.press(key)
        assert lit() == expected
    window.close()


def test_a_frame_that_takes_long_is_told_of(results, window_of, monkeypatch):
    """Dots follow the line at the top while a frame is waited for, and are gone when it is there."""
    window, view = window_of(results, 4)
    before = view.picture()
    now, gate, load = [0.0], Event(), window._stage.load
    window._clock = lambda: now[0]
    monkeypatch.setattr(window._stage, "load", lambda *args, **asked: gate.wait() and load(*args, **asked))
    window.set_thickness(0.0)
    window.poll()
    np.testing.assert_array_equal(view.picture(), before)
    now[0] = 1.0
    window.poll()
    assert not np.array_equal(view.picture()[:16], before[:16])
    gate.set()
    _seen(window, view)
    np.testing.assert_array_equal(view.picture(), before)
    window.close()


def test_own_look_or_plain(results, window_of):
    """The floor without its baked light has its material, or a plain grey of twice the albedo and more."""
    window, view = window_of(results, 3)
    window.press("b")
    own = view.picture()[100, 20].mean()
    window.press("m")
    plain = view.picture()[100, 20].mean()
    assert 1.3 * own < plain < 255  # 0.18 and 0.5, seen through the sRGB curve
    window.close()


def test_a_quantity_is_shown_by_color_with_a_bar(results, window_of):
    """A cut through the ball of density 1 shows the brightest colour in its middle, and a bar on the right."""
    window, view = window_of(results, 4)
    smoke = view.picture()
    window.press("1")
    _seen(window, view)
    cut = view.picture().astype(int)
    assert np.abs(cut[60, 80] - [253, 231, 37]).max() <= 3  # viridis at its end
    assert np.abs(cut - smoke)[20:100, 140:].max() > 50
    window.press("0")
    _seen(window, view)
    np.testing.assert_array_equal(view.picture(), smoke)
    window.close()


def test_a_quantity_that_is_not_there_is_said(results, window_of):
    """Without a grid of temperature the window says so and shows what it showed."""
    window, view = window_of(results, 4)
    smoke = view.picture()
    window.press("3")
    _seen(window, view)
    changed = np.abs(view.picture().astype(int) - smoke).max(axis=2) > 10
    assert changed[:40].any()
    assert not changed[80:].any()
    window.close()


def test_exposure_doubles_the_light(results, window_of):
    """One stop takes the baked grey 100 to what twice its light is in sRGB; none takes it back."""
    window, view = window_of(results, 4)
    before = view.picture()
    window.set_exposure(1.0)
    linear = ((100 / 255 + 0.055) / 1.055) ** 2.4
    doubled = 255 * (1.055 * (2 * linear) ** (1 / 2.4) - 0.055)
    assert view.picture()[100, 20].tolist() == [round(doubled)] * 3
    window.set_exposure(0.0)
    np.testing.assert_array_equal(view.picture(), before)
    window.close()


def test_density_slider_scales_the_extinction(results, window_of):
    """One doubling draws the smoke of twice the extinction; none draws what was there, byte for byte."""
    window, view = window_of(results, 4)
    stage = PreviewStage(results)
    (once,), (twice,) = stage.load(4).smoke, stage.load(4, thickness=2.0).smoke
    assert twice.extinction == 2 * once.extinction
    before = view.picture()
    window.set_thickness(1.0)
    _seen(window, view)
    thick = view.picture()
    view.show(stage.load(4, thickness=2.0))
    np.testing.assert_array_equal(view.picture(), thick)
    assert not np.array_equal(thick, before)
    window.set_thickness(0.0)
    _seen(window, view)
    np.testing.assert_array_equal(view.picture(), before)
    window.close()


def test_marks_can_be_hidden(tmp_path, window_of):
    """Before a run the domain's box is drawn in blue wires; g takes them away and brings them back."""
    author_scene(ws.Scene(domains=[ws.SmokeDomain(path="/World/Box")]), tmp_path / "mine.usda")
    window, view = window_of(tmp_path / "mine.usda", 1)

    def blue():
        return np.count_nonzero(view.picture().astype(int) @ [1, 0, -1] < -20)

    assert blue() > 100
    window.press("g")
    assert blue() == 0
    window.press("g")
    assert blue() > 100
    window.close()


def test_a_message_is_wrapped_to_the_window(results, tmp_path, open_plotter):
    """A quantity that no volume has is said in lines that end before the window's right edge."""
    stage = PreviewStage(results)
    view = StageView(stage, open_plotter((480, 240)), 1.0)
    window = Window(stage, view, 3)
    before = view.picture()
    window.press("3")
    _seen(window, view)
    changed = np.abs(view.picture().astype(int) - before).max(axis=2) > 20
    assert np.count_nonzero(changed[:, :160]) > 200
    assert not changed[:, -3:].any()
    window.close()


def test_own_look_has_the_users_material(tmp_path, window_of):
    """Over a bake the key b shows the material that the user bound, not the baked one that stands in for it."""
    mesh = ws.Mesh.grid((-9, 0, 9), (18, 0, 0), (0, 0, -18))
    red = ws.Material(path="/World/Red", diffuse_color=(0.8, 0.0, 0.0))
    floor = ws.Surface(
        path="/World/Floor", mesh=mesh, material=red, receiver=ws.Receiver(path="/World/Floor", texture_size=8)
    )
    lamp = ws.PointLight(path="/World/Lamp", transform=at(0, 4, 0), intensity=400.0)
    eye = ws.Camera(path="/World/Eye", transform=at(0, 1, 6), focal_length=20.0)
    scene = ws.Scene(surfaces=[floor], lights=[lamp], camera=eye, end=1)
    write_png(tmp_path / "grey.png", np.full((8, 8, 3), 90, np.uint8))
    bake = BakeResult(surface=floor, bake="lit", files="./grey.png")
    window, view = window_of(write_results(tmp_path, "red", scene, [], [bake]), 1)
    assert view.picture()[100, 80].tolist() == [90] * 3
    window.press("b")
    red_light, *others = view.picture()[100, 80].tolist()
    assert red_light > 100
    assert others == [0, 0]
    window.close()


def test_a_stage_read_again(results, tmp_path, monkeypatch, window_of):
    """A change on disk is said once and shown at r, in the same look; a file that is no stage leaves what was shown."""
    monkeypatch.chdir(tmp_path)
    folder = Path("copy")  # a short name: messages with the file's cover little of the picture
    shutil.copytree(results.parent, folder)
    path = folder / results.name
    window, view = window_of(path, 4)
    now = [1e9]  # later than when the window was made
    window._clock = lambda: now[0]
    window.set_exposure(1.0)
    before = view.picture()
    window.poll()
    np.testing.assert_array_equal(view.picture(), before)

    text = path.read_text()
    path.write_text(text.replace("endTimeCode = 4", "endTimeCode = 3"))
    now[0] += 10.0
    window.poll()
    assert np.abs(view.picture()[:20].astype(int) - before[:20]).max() > 10
    window.press("r")
    assert view.plotter is window._view.plotter
    np.testing.assert_array_equal(window._view.picture()[100, 20], np.full(3, 255))  # frame 3's 200, a stop brighter
    assert window._stage.scene.end == 3

    shown = window._view.picture()
    path.write_text("nothing")
    window.press("r")
    np.testing.assert_array_equal(window._view.picture()[100:], shown[100:])
    path.write_text(text)
    window.press("r")
    window.seek(4)
    assert _seen(window, window._view) == before[100, 20].tolist()
    window.close()


def test_turning_leaves_the_camera_upright(results, window_of):
    """The mouse turns about the stage's up axis; the picture is the camera's until then, and again at c."""
    window, view = window_of(results, 3)
    before = view.picture()
    view.plotter.camera.roll = 20.0
    view.leave_camera()
    assert view.plotter.camera.up == (0.0, 1.0, 0.0)
    assert not view.follows_camera
    view.plotter.camera.azimuth = 40.0
    assert not np.array_equal(view.picture(), before)
    window.press("c")
    np.testing.assert_array_equal(view.picture(), before)
    window.close()
