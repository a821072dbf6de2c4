"""Fuzzed scenes: whatever the records allow runs and stays finite; whatever they do not is refused in one line."""

from dataclasses import fields, replace

import numpy as np
import pytest
from arbitrary import ALLOWED, RECORDS, scenes
from hard_cases import check_finite, refusal, simulate, take_few_steps
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import warp_smoke as ws

# Always the same examples; what fails is shrunk but not explained, which takes longer than all of them.
quick = settings(
    deadline=None,
    derandomize=True,
    max_examples=100,
    phases=[Phase.explicit, Phase.generate, Phase.shrink],
    suppress_health_check=list(HealthCheck),
)
long = settings(quick, max_examples=1500)


@pytest.fixture(autouse=True)
def few_steps(monkeypatch):
    """Frames that take no longer than the rest."""
    take_few_steps(monkeypatch)


def run(scene: ws.Scene) -> None:
    """Runs two frames, unless the plan names two choices that exclude each other."""
    refused = refusal(lambda: ws.make_plan(scene))
    if refused:
        assert "_solver is spectral; allowed: " in refused
    else:
        check_finite(simulate(scene, threads=1)[1])


@given(scenes())
@quick
def test_any_allowed_scene_is_finite(scene):
    """100 scenes with numbers from 1e-9 to 1e6 anywhere, 10 to 1e8 units away too: finite, no negative smoke."""
    run(scene)


@pytest.mark.slow
@given(scenes())
@long
def test_any_allowed_scene_is_finite_at_length(scene):
    """1500 more of them, in the slow tests."""
    run(scene)


@pytest.mark.parametrize("record", ALLOWED, ids=lambda record: record.__name__)
def test_every_field_is_fuzzed(record):
    """No field of a record is forgotten."""
    elsewhere = {"path", "given", "source", "warnings", "start", "end", "camera", "mesh", "receiver", "subsets"}
    elsewhere |= {"domains", "emitters", "colliders", "surfaces", "lights", "instancer", "holds_bakes"}
    assert {field.name for field in fields(record)} - elsewhere <= set(ALLOWED[record])


_bad = st.sampled_from(
    [float("nan"), float("inf"), -float("inf"), 1e300, -1e300, "word", "", b"x", None, (), (1.0,), {}, object()]
)
_bad |= st.just(np.full((4, 4), np.nan)) | st.just(np.zeros((2, 2))) | st.lists(st.floats() | st.text(), max_size=5)
_bad |= _bad.map(lambda value: ws.Samples([1.0, 2.0], [value, value]) if isinstance(value, float) else value)


@given(st.sampled_from(RECORDS), st.data())
@settings(quick, max_examples=400)
def test_any_value_is_taken_or_refused(record, data):
    """400 records with one field set to anything: taken, or refused by one line that names record and field."""
    name = data.draw(st.sampled_from(sorted(set(ALLOWED[type(record)]) - {"mesh", "material"})))
    value = data.draw(_bad)
    line = refusal(lambda: replace(record, **{name: value}))
    if line:
        assert line.startswith(f"{getattr(record, 'path', 'scene')}: ")
        assert "; allowed: " in line
