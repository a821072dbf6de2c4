"""Results on disk, and studies that go on where they were interrupted."""

import csv
import json
from io import StringIO

import pytest
from study_rows import FakeSuite, make_row

from warp_smoke.record import FieldError
from warp_smoke.study import conduct, disclosure, study
from warp_smoke.study.store import Store, csv_text, read_results

FACTS = {"warp-smoke": "0.1", "device": "cpu", "threads": 2}


@pytest.fixture
def suite(monkeypatch):
    """A fake suite in the place of `flow`."""
    fake = FakeSuite({"quick": (0.1, 1.0), "exact": (0.01, 3.0), "beaten": (0.2, 2.0), "broken": (None, 0.0)})
    monkeypatch.setattr(conduct, "load_suite", lambda name: fake)
    monkeypatch.setattr(disclosure, "source_digest", lambda: "0" * 12)  # unchanged, also while someone works on it
    return fake


def test_rows_come_back(tmp_path):
    """What is stored is read back as it was, failures and passes too."""
    rows = [make_row(), make_row(method="x", failure="it went wrong", median=None, errors={}, passes={"bake": 0.5})]
    store = Store(tmp_path / "a/b", FACTS)
    for row in rows:
        store.add(row)
    assert read_results(tmp_path / "a/b/results.json") == (FACTS, rows)
    assert list(Store(tmp_path / "a/b", FACTS).rows.values()) == rows


@pytest.mark.parametrize(("field", "value"), [("device", "cuda:0"), ("warp-smoke", "0.2"), ("threads", 1)])
def test_results_of_another_machine_are_refused(tmp_path, field, value):
    """Another device, version or number of threads: one line that names it, and the file stays to the byte."""
    Store(tmp_path, FACTS).add(make_row())
    before = (tmp_path / "results.json").read_bytes()
    with pytest.raises(FieldError, match=f"{field} is {FACTS[field]}; allowed: {value}"):
        Store(tmp_path, FACTS | {field: value})
    assert (tmp_path / "results.json").read_bytes() == before


@pytest.mark.parametrize("content", ["", "{}", "[1]", '{"disclosure": {}, "rows": [{"suite": 1}]}'])
def test_other_files_are_refused(tmp_path, content):
    """A results.json that no study wrote is an error that names it, and stays."""
    (tmp_path / "results.json").write_text(content)
    with pytest.raises(FieldError, match=r"results.json: content"):
        Store(tmp_path, FACTS)
    assert (tmp_path / "results.json").read_text() == content


def test_csv_has_a_line_for_each_row():
    """Every row is there with its errors by column, and the disclosure."""
    rows = [make_row(parameters={"a": 1}), make_row(method="x", errors={"linf": 2.0}, failure="l2 is nan")]
    first, second = csv.DictReader(StringIO(csv_text(FACTS, rows)))
    assert (first["l2"], first["linf"], first["parameters"], first["threads"]) == ("0.1", "", "a=1", "2")
    assert (second["l2"], second["linf"], second["failure"]) == ("", "2.0", "l2 is nan")


def test_study_writes_everything_and_shows_failures(suite, tmp_path):
    """Table, results, diagram and page are written; the case that raised an error is in all tables."""
    result = study(None, tmp_path / "out", suites=["flow"])
    assert [row.method for row in result.rows] == ["quick", "exact", "beaten", "broken"]
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"results.json", "results.csv", "flow.png", "study.html"}
    assert result.rows[3].failure == "ValueError: it went wrong"
    for name in ("results.json", "results.csv", "study.html"):
        assert "it went wrong" in (tmp_path / "out" / name).read_text()
    json.dumps(result.as_json(), allow_nan=False)


def test_rows_of_two_references_do_not_mix(suite, tmp_path):
    """A study against another finest run measures its own rows; the earlier ones stay stored, but are not shown."""
    del suite.results["broken"]
    for suite.reference in ("a coarse run", "a fine run"):
        result = study(None, tmp_path, suites=["flow"])
        assert [row.reference for row in result.rows] == [suite.reference] * 3
        assert f"measured from {suite.reference}" in result.page.read_text()
        table = csv.DictReader(StringIO((tmp_path / "results.csv").read_text()))
        assert [line["reference"] for line in table] == [suite.reference] * 3
    assert suite.measured == ["quick", "exact", "beaten"] * 2
    _, rows = read_results(tmp_path / "results.json")
    assert [row.reference for row in rows] == ["a coarse run"] * 3 + ["a fine run"] * 3


def test_interrupted_study_goes_on(suite, tmp_path):
    """After Ctrl-C in the second case only what is missing is measured; what failed is tried again."""

    def stop(row, number, count):
        if number == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study(None, tmp_path, suites=["flow"], on_row=stop)
    assert suite.measured == ["quick", "exact"]
    numbers = []
    study(None, tmp_path, suites=["flow"], on_row=lambda row, number, count: numbers.append((number, count)))
    assert suite.measured == ["quick", "exact", "beaten", "broken"]
    assert numbers == [(1, 4), (2, 4), (3, 4), (4, 4)]
    suite.results["broken"] = (0.5, 0.5)
    result = study(None, tmp_path, suites=["flow"])
    assert suite.measured[4:] == ["broken"]
    assert all(row.failure is None for row in result.rows)
