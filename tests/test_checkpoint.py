"""Runs that are cut short and go on: the same files to the bit, or one clear line why not."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from busy_scene import busy_scene
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pxr import Usd
from scenes import at, floor, plume

import warp_smoke as ws
from warp_smoke.checkpoint import Checkpoint, read_checkpoint
from warp_smoke.usd.validate import validate_stage


class Stopped(Exception):
    """What ends a run in these tests."""


def digests(folder):
    """A hash of every file but the report, which holds times."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.name != "report.json"]
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def run_until(frame, scene, folder, **options):
    """A run that fails right after a frame."""

    def stop(made):
        if made.number == frame:
            raise Stopped

    with pytest.raises(Stopped):
        ws.run(scene, folder, on_frame=stop, **options)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The busy scene and the hashes of its files, run without a stop."""
    scene = busy_scene()
    return scene, digests(ws.run(scene, tmp_path_factory.mktemp("whole"), threads=1).folder)


@pytest.mark.parametrize("frame", [1, 3, 4, 5])
def test_a_run_that_goes_on_gives_the_same_files(whole, tmp_path, frame, record_property):
    """With everything on, a run cut short after any kind of frame goes on to the same bytes in every file.

    Frame 1 only emits; at 3 a collider stops and a caster vanishes; at 4 the collider stands; at 5 all move again.
    """
    scene, expected = whole
    run_until(frame, scene, tmp_path, checkpoint_every=1)
    assert (tmp_path / "scene.checkpoint").exists()
    result = ws.run(scene, tmp_path, resume=True, threads=2)
    assert result.report["resumed_after"] == frame
    assert [each["frame"] for each in result.report["frames"]] == list(scene.frames)
    found = digests(tmp_path)
    record_property(f"files of {len(expected)} that differ", len(found.items() ^ expected.items()))
    assert found == expected


@pytest.mark.usefixtures("divided_launches")
@pytest.mark.parametrize("threads", [1, 2, 7])
def test_the_same_files_for_any_number_of_threads(whole, tmp_path, threads, record_property):
    """With everything on, runs on 1, 2 and 7 threads write the same bytes, twice on 1."""
    scene, expected = whole
    found = digests(ws.run(scene, tmp_path, threads=threads).folder)
    record_property(f"files of {len(expected)} that differ", len(found.items() ^ expected.items()))
    assert found == expected


@pytest.mark.parametrize(
    "domain",
    [
        {"pressure_solver": "red_black", "advection": "bfecc"},
        {"pressure_solver": "spectral_conjugate_gradient", "advection": "semi_lagrangian_cubic"},
        {"pressure_solver": "conjugate_gradient", "advection": "semi_lagrangian", "diffusion_solver": "jacobi"},
        {"boundary": ("closed",) * 6, "pressure_solver": "jacobi", "resolution": 8},
    ],
    ids=["red_black", "spectral", "conjugate_gradient", "jacobi"],
)
def test_every_scheme_goes_on(domain):
    """A simulation that takes over saved fields makes the same frame to the bit, whatever the schemes."""
    scene = replace(busy_scene(), surfaces=(), lights=())
    scene = replace(scene, domains=[replace(scene.domains[0], **domain)])
    straight = ws.Simulation(scene)
    for _ in range(3):
        straight.step()
    saved = straight.save()
    gone_on = ws.Simulation(scene)
    gone_on.load(3, saved)
    for _ in range(2):
        expected, found = (each.step().smoke["/World/Smoke"] for each in (straight, gone_on))
        assert expected == found
    assert all(np.array_equal(a, b) for a, b in zip(straight.save().values(), gone_on.save().values(), strict=True))


@pytest.mark.parametrize("role", ["emitter", "collider"])
def test_meshes_that_deform_go_on(role):
    """A slab that turns and is stretched: queries at one distance from two of its faces are answered as before.

    The answer follows from the shape that the hierarchy of its triangles was given at the first frame; without that,
    fields differ by 1e-6.
    """
    slab, times = ws.Mesh.box((0.9, 0.05, 0.9)), np.arange(1.0, 8.0)
    stretch = [(1.0 + 0.5 * np.sin(2.0 * t), 1.0, 1.0 + 0.5 * np.cos(3.0 * t)) for t in times]
    mesh = replace(slab, points=ws.Samples(times, np.stack([slab.points * each for each in stretch])))
    turned = np.stack([at(0.05 * t, 1.2, 0.03 * t) for t in times])
    turned[:, :2, :2] = [[(np.cos(a), np.sin(a)), (-np.sin(a), np.cos(a))] for a in 0.7 * times]
    place = {"mesh": mesh, "transform": ws.Samples(times, turned)}
    scene = replace(plume(resolution=24), surfaces=(), lights=())
    if role == "emitter":
        scene = replace(scene, emitters=[replace(scene.emitters[0], **place)])
    else:
        scene = replace(scene, colliders=[ws.Collider(path="/World/Slab", thickness=1.0, **place)])
    straight, gone_on = ws.Simulation(scene), ws.Simulation(scene)
    for _ in range(5):
        straight.step()
    gone_on.load(5, straight.save())
    assert straight.step().smoke == gone_on.step().smoke


def test_frames_after_the_checkpoint_are_made_again(tmp_path):
    """With a checkpoint every second frame the run goes on from the last of them, to the same bytes."""
    scene = plume(frames=6)
    expected = digests(ws.run(scene, tmp_path / "whole").folder)
    run_until(5, scene, tmp_path / "cut", checkpoint_every=2)
    result = ws.run(scene, tmp_path / "cut", resume=True)
    assert result.report["resumed_after"] == 4
    assert digests(tmp_path / "cut") == expected


def test_the_stage_of_a_run_cut_short(tmp_path):
    """What is left opens in any DCC, with the frames made so far and no file that is missing."""
    run_until(3, plume(frames=6), tmp_path)
    stage = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1, 3)
    assert not [problem for problem in validate_stage(tmp_path / "scene.usda") if problem.severity == "error"]


def test_a_field_that_is_not_finite_keeps_the_checkpoint(monkeypatch, tmp_path):
    """The run stops with field, cell and frame; the frames before stay, and it goes on from them to the same bytes."""
    scene = plume(frames=5)
    expected = digests(ws.run(scene, tmp_path / "whole").folder)
    step, made = ws.Simulation.step, []

    def spoiled(simulation):
        if len(made) == 3:
            density = simulation.density.numpy().copy()
            density[5, 6, 7] = np.nan
            simulation.density = density
        return step(simulation)

    with monkeypatch.context() as patch:
        patch.setattr(ws.Simulation, "step", spoiled)
        with pytest.raises(FloatingPointError, match=r"/World/Smoke: (density|velocity) is nan .* at frame 4, after "):
            ws.run(scene, tmp_path / "cut", checkpoint_every=1, on_frame=made.append)
    assert read_checkpoint(tmp_path / "cut" / "scene.checkpoint").frame == 3
    assert Usd.Stage.Open(str(tmp_path / "cut" / "scene.usda")).GetEndTimeCode() == 3
    assert ws.run(scene, tmp_path / "cut", resume=True).report["resumed_after"] == 3
    assert digests(tmp_path / "cut") == expected


def test_a_finished_run_keeps_no_checkpoint(tmp_path):
    """The checkpoint, and what waits for the stage, are gone; no hidden file stays."""
    ws.run(busy_scene(frames=3), tmp_path, checkpoint_every=1)
    assert not list(tmp_path.rglob("*.checkpoint"))
    assert not list(tmp_path.rglob(".*"))


def test_resuming_without_a_checkpoint(tmp_path):
    """It starts at the first frame where nothing is there, and leaves the results of a finished run as they are."""
    scene = plume(frames=2)
    first = ws.run(scene, tmp_path, resume=True)
    assert first.report["resumed_after"] is None
    made = []
    again = ws.run(scene, tmp_path, resume=True, on_frame=made.append)
    assert (made, again) == ([], first)
    ws.run(plume(frames=3), tmp_path, resume=True, on_frame=made.append)
    assert [frame.number for frame in made] == [1, 2, 3]


def test_a_new_run_drops_the_checkpoint(tmp_path):
    """Without resuming a run starts at its first frame and takes what was left with it."""
    run_until(3, plume(frames=4), tmp_path, checkpoint_every=1)
    made = []
    ws.run(plume(frames=2), tmp_path, on_frame=made.append)
    assert [frame.number for frame in made] == [1, 2]
    assert sorted(path.name for path in (tmp_path / "volumes").iterdir()) == ["Smoke.0001.vdb", "Smoke.0002.vdb"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda s: replace(s, domains=[replace(s.domains[0], resolution=20)]),
            "/World/Smoke: resolution was 16 and is 20",
        ),
        (lambda s: replace(s, end=5), "scene: end was 4 and is 5"),
        (lambda s: replace(s, lights=s.lights[:1]), "scene: lights was /World/Lamp, /World/Sun and is /World/Lamp"),
        (
            lambda s: replace(s, emitters=[replace(s.emitters[0], mesh=ws.Mesh.box(0.4))]),
            "/World/Source: mesh.points was",
        ),
    ],
)
def test_a_checkpoint_of_another_scene_is_refused(tmp_path, change, said):
    """One line names the first difference; the checkpoint and all files stay as they were."""
    scene = plume(frames=4)
    run_until(2, scene, tmp_path, checkpoint_every=1)
    before = digests(tmp_path)
    with pytest.raises(ValueError, match=said) as refused:
        ws.run(change(scene), tmp_path, resume=True)
    assert "\n" not in str(refused.value)
    assert digests(tmp_path) == before


def test_a_texture_that_was_painted_over_is_noticed(tmp_path):
    """Two fingerprints differ when a picture that a material shows does."""
    from warp_smoke.fingerprint import fingerprint, first_difference

    texture = ws.Texture(file=str(tmp_path / "paint.png"))
    surface = floor(material=ws.Material(path="/World/Paint", diffuse_texture=texture))
    scene = replace(plume(), surfaces=[surface])
    found = []
    for content in (b"one", b"two"):
        (tmp_path / "paint.png").write_bytes(content)
        found.append(fingerprint(scene, "cpu"))
    assert "/World/Floor: material.diffuse_texture.content was" in first_difference(*found)
    assert first_difference(found[0], found[0]) is None


def test_a_checkpoint_of_another_version_is_refused(tmp_path):
    """The package's version, and those of what computes, are part of what must be the same."""
    run_until(2, plume(frames=3), tmp_path, checkpoint_every=1)
    path = tmp_path / "scene.checkpoint"
    checkpoint = read_checkpoint(path)
    older = checkpoint.fingerprint | {"version of warp-smoke": "0.0.1"}
    replace(checkpoint, fingerprint=older).write(path)
    with pytest.raises(ValueError, match=r"version of warp-smoke was 0\.0\.1 and is "):
        ws.run(plume(frames=3), tmp_path, resume=True)


def test_a_missing_frame_is_noticed(tmp_path):
    """A run does not go on over a gap: the file that is gone is named."""
    run_until(3, plume(frames=4), tmp_path, checkpoint_every=1)
    (tmp_path / "volumes" / "Smoke.0002.vdb").unlink()
    with pytest.raises(ValueError, match=r"Smoke\.0002\.vdb.*missing"):
        ws.run(plume(frames=4), tmp_path, resume=True)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A small checkpoint and its file."""
    path = tmp_path_factory.mktemp("small") / "a.checkpoint"
    fields = {"a": np.arange(24, dtype=np.float32).reshape(2, 3, 4), "b": np.array(0.1), "none": np.zeros((0, 3))}
    checkpoint = Checkpoint({"kind": "σ"}, 7, {"frames": [{"frame": 7, "value": float("nan")}]}, fields)
    checkpoint.write(path)
    return checkpoint, path


def test_a_checkpoint_comes_back(small):
    """All of it: fields with their types and shapes, and numbers to the bit."""
    checkpoint, path = small
    found = read_checkpoint(path)
    assert (found.fingerprint, found.frame) == (checkpoint.fingerprint, checkpoint.frame)
    assert json.dumps(found.report) == json.dumps(checkpoint.report)
    for name, values in checkpoint.fields.items():
        assert found.fields[name].dtype == values.dtype
        np.testing.assert_array_equal(found.fields[name], values)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_is_noticed(small, tmp_path, data):
    """A byte changed, the end cut off, bytes added, or noise: one line that names the file, whatever was done."""
    content = bytearray(small[1].read_bytes())
    kind = data.draw(st.sampled_from(["changed", "cut", "added", "noise"]))
    if kind == "changed":
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] ^= data.draw(st.integers(1, 255))
    elif kind == "cut":
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    elif kind == "added":
        content += data.draw(st.binary(min_size=1, max_size=64))
    else:
        content = data.draw(st.sampled_from([b"", bytes(content[:30])])) + data.draw(st.binary(max_size=200))
    path = tmp_path / "a.checkpoint"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.checkpoint: ") as refused:
        read_checkpoint(path)
    assert "\n" not in str(refused.value)
