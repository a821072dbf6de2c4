"""A run that goes on keeps the settings that it had chosen, without measuring again, and says so."""

from dataclasses import replace

import pytest
from scenes import plume

import warp_smoke as ws
from warp_smoke.quality import Chosen, words_of_choice
from warp_smoke.study import choice


class Stopped(Exception):
    """What ends a run in these tests."""


@pytest.fixture
def choose(monkeypatch):
    """Puts a resolution in place of what measuring would choose; gives the list of those still to come."""
    resolutions = []

    def chosen(scene, *, max_error, budget, **options):
        cells = resolutions.pop(0)
        settings = {"/World/Smoke": {"resolution": cells, "advection": "bfecc"}}
        domain = replace(scene.domains[0], **settings["/World/Smoke"])
        by = words_of_choice(max_error, budget)
        return replace(scene, domains=[domain]), Chosen(by, settings, {}, "Measured", {"error": 0.1})

    monkeypatch.setattr(choice, "choose", chosen)
    return resolutions


def run_until(frame, folder, **options):
    """A run that fails right after a frame."""

    def stop(made):
        if made.number == frame:
            raise Stopped

    with pytest.raises(Stopped):
        ws.run(plume(), folder, on_frame=stop, checkpoint_every=1, **options)


@pytest.mark.parametrize("asked", [{"budget": 40.0}, {"max_error": 0.02}])
def test_the_choice_is_kept(choose, tmp_path, asked):
    """What was chosen comes out of the checkpoint, though measured again it would be another; the report tells."""
    choose += [10, 14]
    run_until(2, tmp_path, **asked)
    result = ws.run(plume(), tmp_path, resume=True, **asked)
    assert choose == [14]
    assert result.report["resumed_after"] == 2
    assert result.report["chosen"]["settings"] == {"/World/Smoke": {"resolution": 10, "advection": "bfecc"}}
    assert result.report["chosen"]["taken_over"]
    assert ws.run(plume(), tmp_path, resume=True, **asked).report == result.report  # finished, and known to be
    assert choose == [14]


def test_it_is_said():
    """The line that the command prints ends with it."""
    chosen = Chosen("Budget of 40 ms a frame", {"/World/Smoke": {"resolution": 10}}, {}, "Measured", {})
    assert str(chosen).endswith("resolution 10. Measured")
    assert str(replace(chosen, taken_over=True)).endswith("resolution 10. Measured. Taken over from the resumed run")


def test_another_choice_is_refused(choose, tmp_path):
    """Another budget, or one where there was none, is another run; both are named."""
    choose += [10]
    run_until(2, tmp_path, budget=40.0)
    with pytest.raises(ValueError, match=r"chosen by Budget of 40 ms a frame and now are by Error of 0\.1 at most"):
        ws.run(plume(), tmp_path, resume=True, max_error=0.1)
    run_until(2, tmp_path)
    with pytest.raises(ValueError, match="chosen by nothing and now are by Budget of 40 ms a frame"):
        ws.run(plume(), tmp_path, resume=True, budget=40.0)


def test_where_nothing_is_left_it_is_chosen_anew(choose, tmp_path):
    """No checkpoint, no report, or one of another choice: measured, and run from the first frame."""
    choose += [10, 12, 14]
    for budget, cells in ((40.0, 10), (50.0, 12)):
        report = ws.run(plume(frames=1), tmp_path, resume=True, budget=budget).report
        assert report["chosen"]["settings"]["/World/Smoke"]["resolution"] == cells
    assert choose == [14]


def test_an_edited_stage_is_noticed(choose, tmp_path):
    """What else has changed since is still refused with its name."""
    choose += [10]
    run_until(2, tmp_path, budget=40.0)
    scene = plume()
    brighter = replace(scene, lights=[replace(scene.lights[0], intensity=7.0), *scene.lights[1:]])
    with pytest.raises(ValueError, match="/World/Lamp: intensity was"):
        ws.run(brighter, tmp_path, resume=True, budget=40.0)


def test_an_edited_stage_is_measured_anew_after_a_finished_run(choose, tmp_path):
    """What was chosen for the stage as it was is not taken over once the run is finished and the stage is another."""
    choose += [10, 14]
    ws.run(plume(frames=1), tmp_path, budget=40.0)
    report = ws.run(plume(frames=2), tmp_path, resume=True, budget=40.0).report
    assert report["chosen"]["settings"]["/World/Smoke"]["resolution"] == 14
    assert not report["chosen"]["taken_over"]
