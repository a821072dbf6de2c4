"""The command `study`: its files, its JSON, and one line for each mistake."""

import json
from pathlib import Path

import pytest
from study_rows import FakeSuite

from warp_smoke import cli
from warp_smoke.study import conduct

STAGES = Path(__file__).parents[2] / "stages"


@pytest.fixture
def call(monkeypatch, capfd, tmp_path):
    """Runs the command in an empty folder with a fake suite; gives status, output and errors."""
    monkeypatch.chdir(tmp_path)
    fake = FakeSuite({"quick": (0.1, 1.0), "broken": (None, 0.0)})
    monkeypatch.setattr(conduct, "load_suite", lambda name: fake)

    def call(*args):
        monkeypatch.setattr("sys.argv", ["warp-smoke", "study", *map(str, args)])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        printed = capfd.readouterr()
        return stopped.value.code, printed.out, printed.err

    return call


def test_study_command(call, tmp_path):
    """A suite is measured to out/study; the page is named, and a failure is a warning."""
    status, out, err = call("--suite", "flow")
    assert (status, out) == (0, "Wrote out/study/study.html\n")
    assert "warning failed: flow/p/broken" in err
    assert (tmp_path / "out/study/flow.png").exists()


def test_study_as_json(call):
    """With --json standard output is one document with rows and disclosure."""
    status, out, _ = call("--suite", "flow", "--json")
    found = json.loads(out)
    assert status == 0
    assert [row["method"] for row in found["rows"]] == ["quick", "broken"]
    assert {"device", "processor", "threads", "warp-lang", "commit", "copy_gb_per_s"} <= found["disclosure"].keys()


@pytest.mark.parametrize(
    ("args", "line"),
    [
        (("--suite", "nonsense"), "suite is nonsense; allowed: advection, pressure"),
        (("--suite", "scene"), "suite is scene, which needs a stage; allowed"),
        (("--suite", "flow", "-o", "file"), "file: output folder is a file; allowed: a folder"),
        (("--suite", "flow", "-o", "file/inside"), "file/inside: output folder is below the file"),
        (("--suite", "flow", "--device", "tpu"), "device is tpu; allowed here: cpu"),
        (("none.usda",), "none.usda"),
        ((STAGES / "mandelbrot.usda",), "mandelbrot.usda: stage is one without anything to study; allowed"),
    ],
)
def test_bad_input_is_one_line(call, tmp_path, args, line):
    """Exit status 2, one line that says what is wrong and what is allowed, and nothing written."""
    (tmp_path / "file").write_text("kept")
    status, out, err = call(*args)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert line in err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "kept"


def test_results_of_another_version_are_kept(call, tmp_path):
    """A stored result of another version: exit status 2, one line, and the file as it was."""
    call("--suite", "flow")
    file = tmp_path / "out/study/results.json"
    changed = file.read_text().replace('"warp-lang": "', '"warp-lang": "0.')
    file.write_text(changed)
    status, _, err = call("--suite", "flow")
    assert (status, err.count("\n")) == (2, 1)
    assert "results.json: warp-lang is 0." in err
    assert file.read_text() == changed
