"""The command line: what it prints, its exit status, and one line for each mistake."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from pxr import Usd
from scenes import at, floor, plume

import warp_smoke as ws
from warp_smoke import cli
from warp_smoke.cli.console import warn

STAGES = Path(__file__).parents[1] / "stages"


@pytest.fixture
def warp_smoke(monkeypatch, capfd, tmp_path):
    """Runs the command line in an empty folder; gives status, output and errors."""
    monkeypatch.chdir(tmp_path)

    def call(*args):
        monkeypatch.setattr("sys.argv", ["warp-smoke", *map(str, args)])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        printed = capfd.readouterr()
        return stopped.value.code, printed.out, printed.err

    return call


def test_run_plan_validate(warp_smoke, tmp_path):
    """A stage is planned, run to out/NAME and validated."""
    stage = STAGES / "smoke_only.usda"
    status, out, _ = warp_smoke("plan", stage, "--resolution", 16)
    assert status == 0
    assert "advect_density" in out
    assert "Left out" in out
    status, out, err = warp_smoke("run", stage, "--resolution", 16, "--frames", "1:2", "--threads", 1)
    assert (status, err) == (0, "")
    assert "out/smoke_only/smoke_only.usda" in out
    assert sorted(path.name for path in (tmp_path / "out/smoke_only/volumes").iterdir())[0].endswith("0001.vdb")
    status, out, _ = warp_smoke("validate", "out/smoke_only")
    assert (status, "no problems" in out) == (0, True)


def test_materials_for_the_smoke(warp_smoke, tmp_path):
    """--volume-shader adds a layer, which the flattened stage has too; what only its renderer knows is no error."""
    stage, options = STAGES / "smoke_only.usda", ("--resolution", 16, "--frames", "1:2")
    status, out, _ = warp_smoke("run", stage, *options, "--volume-shader", "karma", "--flatten")
    assert status == 0
    assert "out/smoke_only/smoke_only.karma.usda" in out
    flat = Usd.Stage.Open(str(tmp_path / "out/smoke_only/smoke_only.flat.usdc"))
    assert [prim.GetName() for prim in flat.Traverse() if prim.GetTypeName() == "Material"] == ["Smoke_smoke_karma"]
    status, out, _ = warp_smoke("validate", "out/smoke_only")
    assert status == 0
    assert "info(s)" in out
    assert "error" not in out
    assert out.startswith("The layers that the run wrote over it:\n")
    status, _, err = warp_smoke("run", stage, "--volume-shader", "mantra")
    assert status == 2
    assert "karma" in err


def test_problems_are_told(warp_smoke, tmp_path):
    """Each problem is a line with severity and place, then counts; --json has the same; warnings are no failure."""
    path = tmp_path / "odd.usda"
    path.write_text("""#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 1
    upAxis = "Y"
)
def Xform "World"
{
    def Mesh "Floor"
    {
        token visibility = "seen"
        float3[] extent = [(0, 0, 0), (1, 0, 1)]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (0, 0, 1), (1, 0, 0)]
        normal3f[] normals = [(0, 1, 0)] (
            interpolation = "constant"
        )
        uniform token subdivisionScheme = "none"
    }
}
""")
    status, out, _ = warp_smoke("validate", path)
    assert status == 1
    lines = out.splitlines()
    assert lines[0].startswith("error: /World/Floor.visibility: is seen; allowed: inherited, invisible")
    assert "error(s)" in lines[-1]
    status, out, _ = warp_smoke("validate", path, "--json")
    assert status == 1
    problems = json.loads(out)
    assert len(problems) == len(lines) - 1
    assert {"severity": "error", "where": "/World/Floor.visibility"}.items() <= problems[0].items()
    untidy = path.read_text().replace('"seen"', '"inherited"').replace("float3[] extent = [(0, 0, 0), (1, 0, 1)]", "")
    path.write_text(untidy)
    status, out, _ = warp_smoke("validate", path)
    assert status == 0
    assert "warning: /World/Floor: has no extent" in out


def test_a_plan_cuts_nothing(warp_smoke, tmp_path):
    """In 80 columns long paths go on in the next line; places with the same reason share a row; warnings come last."""
    scene, path = plume(), "/World/" + "Corridor" * 9 + "/Door"
    surface = replace(floor(), path=path, receiver=replace(floor().receiver, path=path, bake=("lit",)))
    replace(scene, surfaces=[surface], emitters=[]).save(tmp_path / "set.usda")
    status, out, err = warp_smoke("plan", "set.usda")
    assert status == 0
    assert max(map(len, out.splitlines())) <= 80
    assert "…" not in out
    places = "".join(line.split("│")[2].replace(" ", "") for line in out.splitlines() if line.startswith("│"))
    assert f"{path}×/World/Lamp,/World/Sun" in places
    assert err.startswith("warning /World/Smoke: no emitter")
    made = ws.make_plan(ws.Scene.open("set.usda"))
    assert [each.name for each in made.passes].count("shade_light") == 2
    assert out.count("shade_light") == 1


def test_json(warp_smoke):
    """With --json standard output is one JSON document."""
    stage = STAGES / "room.usda"
    for command in (["plan", stage], ["run", stage], ["info"], ["validate", stage]):
        status, out, _ = warp_smoke(*command, "--json")
        assert status == 0
        json.loads(out)


def test_bake_all(warp_smoke, tmp_path):
    """--bake-all plans a bake for every visible mesh."""
    box = ws.Surface(path="/World/Box", mesh=ws.Mesh.box(0.5), transform=at(1, 0.5, 0))
    replace(plume(), surfaces=[floor(), box]).save(tmp_path / "set.usda")
    for options, expected in (((), {"/World/Floor"}), (("--bake-all",), {"/World/Floor", "/World/Box"})):
        _, out, _ = warp_smoke("plan", "set.usda", "--json", *options)
        assert {each["subjects"][0] for each in json.loads(out)["passes"] if each["name"] == "bake"} == expected


def test_bake_all_leaves_out_what_cannot_hold_a_bake(warp_smoke):
    """A Cylinder has no texture coordinates on its prim: it is not baked, and the run goes through."""
    args = ("--bake-all", "--frames", "1:1", "--resolution", 16)
    status, _, _ = warp_smoke("run", PLUME, *args)
    assert status == 0
    _, out, _ = warp_smoke("plan", PLUME, "--json", *args)
    receivers = {each["subjects"][0] for each in json.loads(out)["passes"] if each["name"] == "bake"}
    assert receivers == {"/World/Floor"}


def test_quality_and_budget(warp_smoke, tmp_path):
    """`plan` and `run` say what a quality sets and keeps; a budget is measured, kept to, and put into the report."""
    _, out, _ = warp_smoke("plan", PLUME, "--quality", "draft")
    assert "Quality draft sets /World/Smoke advection " in out
    assert "The stage's own values are kept: /World/Smoke resolution; /World/Floor texture_size" in out
    _, out, _ = warp_smoke("plan", PLUME, "--quality", "draft", "--resolution", 64, "--json")
    assert json.loads(out)["chosen"]["kept"]["/World/Smoke"] == ["resolution"]

    scene = plume(resolution=8, frames=2)
    replace(scene, surfaces=[], lights=[]).save(tmp_path / "puff.usda")
    status, _, err = warp_smoke("run", "puff.usda", "--budget", 1e6, "--threads", 1)
    assert status == 0
    assert err.startswith("Budget of 1e+06 ms a frame sets /World/Smoke resolution ")
    assert "measured now and stored in out/puff.study/results.json" in err
    chosen = json.loads((tmp_path / "out/puff/report.json").read_text())["chosen"]
    assert chosen["by"] == "Budget of 1e+06 ms a frame"
    assert chosen["measured"]["milliseconds"] > 0.0
    assert not (tmp_path / "out/puff/textures").exists()
    status, _, err = warp_smoke("run", "puff.usda", "--budget", 1e-6, "--threads", 1)
    assert status == 2
    assert "budget is 1e-06; allowed: from " in err
    assert "ms, the cheapest there is" in err


def test_warnings_of_the_bake_are_printed(warp_smoke, tmp_path):
    """What could not be baked as asked is said on standard error, one line each."""
    text = PLUME.read_text().replace("def Camera", "def Scope")
    shutil.copytree(STAGES / "textures", tmp_path / "textures")
    (tmp_path / "shot.usda").write_text(text)
    status, _, err = warp_smoke("run", "shot.usda", "--frames", "1:1", "--resolution", 16)
    assert status == 0
    assert "warning /World/Floor: no camera" in err


def test_help_names_every_option(warp_smoke):
    """--help is there for the tool and for each command."""
    status, out, _ = warp_smoke("--help")
    assert status == 0
    for command in ("run", "plan", "preview", "render", "validate", "info"):
        assert command in out
        assert warp_smoke(command, "--help")[0] == 0


PLUME = STAGES / "plume.usda"


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["run"], "stage"),
        (["frobnicate"], "frobnicate"),
        (["run", "nothere.usda"], "nothere.usda"),
        (["run", "noise.usda"], "noise.usda"),
        (["run", "nodefault.usda"], "defaultPrim"),
        (["run", PLUME, "--bogus"], "--bogus"),
        (["run", PLUME, "--frames", "9:3"], "--frames is 9:3"),
        (["run", PLUME, "--frames", "x"], "--frames is x"),
        (["run", PLUME, "--resolution", "0"], "resolution is 0"),
        (["run", PLUME, "--resolution", "many"], "many"),
        (["run", PLUME, "--quality", "best"], "quality is best; allowed: draft, preview, final"),
        (["plan", PLUME, "--quality", "best"], "quality is best"),
        (["run", PLUME, "--quality", "draft", "--budget", "40"], "quality draft and budget 40.0; allowed: one of"),
        (["run", PLUME, "--max-error", "0.1", "--budget", "40"], "max_error 0.1 and budget 40.0; allowed: one of"),
        (["run", PLUME, "--budget", "0"], "budget is 0.0; allowed"),
        (["run", PLUME, "--resolution", "8", "--budget", "40"], "--resolution is 8; allowed: none"),
        (["run", PLUME, "--device", "abacus"], "device is abacus; allowed here: cpu"),
        (["run", PLUME, "--threads", "-1"], "threads is -1"),
        (["run", PLUME, "-o", STAGES], "would overwrite"),
        (["run", PLUME, "-o", "noise.usda/out"], "below the file"),
        (["run", PLUME, "-o", "noise.usda"], "noise.usda: output folder is a file; allowed: a folder"),
        (["preview", "nothere.usda"], "nothere.usda"),
        (["preview", PLUME, "--frame", "999", "--screenshot", "a.png"], "frame is 999"),
        (["preview", PLUME, "--screenshot", "a.foo"], "screenshot is a.foo; allowed: a name that ends in .png, .jpg"),
        (["render", PLUME, "-o", "a.foo"], "output is a.foo; allowed: a name that ends in .png"),
        (["render", PLUME, "-o", "a.png", "--frame", "999"], "plume.usda: frame is 999; allowed: 1…48"),
        (["render", "blind.usda", "-o", "a.png"], "blind.usda: no camera to render through; add a UsdGeomCamera"),
        (["preview", PLUME, "--size", "0x9"], "--size is 0x9"),
        (["validate", "nothere.usda"], "nothere.usda"),
    ],
)
def test_bad_input(warp_smoke, tmp_path, args, said):
    """A mistake ends with exit status 2 and one line that names it; no folder is left behind."""
    (tmp_path / "noise.usda").write_bytes(bytes(range(256)))
    (tmp_path / "blind.usda").write_text('#usda 1.0\n(\n    defaultPrim = "A"\n)\ndef Xform "A"\n{\n}\n')
    (tmp_path / "nodefault.usda").write_text('#usda 1.0\ndef Xform "A"\n{\n}\n')
    status, out, err = warp_smoke(*args)
    assert status == 2
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("error ")
    assert said in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("attribute", "value", "said"),
    [
        ("int smoke:resolution", "-5", "smoke:resolution is -5; allowed: whole numbers from 1"),
        ("token smoke:advection", '"magic"', "smoke:advection is magic; allowed: semi_lagrangian, "),
        ("float smoke:maxCourant", "-4", "smoke:maxCourant is -4.0; allowed: > 0"),
        ("float smoke:buoyancyTemperature", "nan", "smoke:buoyancyTemperature is nan; allowed: a finite number"),
    ],
)
def test_bad_attributes(warp_smoke, tmp_path, attribute, value, said):
    """A bad attribute is named with file, prim, value and what is allowed."""
    text = PLUME.read_text()
    name = attribute.split()[1]
    lines = [line for line in text.splitlines() if f" {name} =" not in line]
    index = next(n for n, line in enumerate(lines) if "smoke:resolution" in line or "SmokeDomainAPI" in line)
    while "{" not in lines[index] and "smoke:" not in lines[index]:
        index += 1
    lines.insert(index + 1, f"        {attribute} = {value}")
    stage = tmp_path / "bad.usda"
    stage.write_text("\n".join(lines) + "\n")
    shutil.copytree(STAGES / "textures", tmp_path / "textures")
    status, out, err = warp_smoke("run", stage)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "bad.usda: /World/Smoke: " in err
    assert said in err
    assert not (tmp_path / "out").exists()


def test_names_are_printed_as_they_are(warp_smoke, tmp_path):
    """Brackets and colons in names are no mark-up: primvars of Blender's bones end with `:Bone`."""
    name = "[final] :bone:"
    stage = tmp_path / f"{name}.usda"
    stage.write_bytes((STAGES / "smoke_only.usda").read_bytes())
    status, out, _ = warp_smoke("run", stage, "--resolution", 8, "--frames", "1:1", "-o", name)
    assert status == 0
    assert out.splitlines()[-1] == f"Wrote {name}/{name}.usda"
    status, out, _ = warp_smoke("validate", stage)
    assert out.splitlines()[-1].startswith(f"{stage}: ")


def test_warnings_are_printed_as_they_are(capfd):
    """Only the word warning is marked up."""
    text = "/World/Mesh.primvars:Bone: inputs:file is ./[/red][bold].png"
    warn([text])
    assert capfd.readouterr().err == f"warning {text}\n"


def test_what_is_wrong_with_a_stage_is_told_once(warp_smoke, tmp_path):
    """A reference to itself, as Blender exports an instance in a curve, is one line, and USD prints none of its own."""
    text = (STAGES / "smoke_only.usda").read_text()
    ring = 'def Xform "Ring"\n{\ndef Xform "Copy" (\nreferences = </World/Ring>\n)\n{\n}\n}\n'
    end = text.rindex("}")
    (tmp_path / "shot.usda").write_text(text[:end] + ring + text[end:])
    options = ("--resolution", 8, "--frames", "1:1", "--flatten", "--usdz", "--volume-shader", "karma")
    for command, lines in (
        (("run", "shot.usda", *options), 1),
        (("render", "out/shot", "-o", "a.png", "--size", "8x8"), 1),
        (("preview", "out/shot", "--screenshot", "b.png", "--size", "32x32"), 0),
    ):
        status, _, err = warp_smoke(*command)
        assert status == 0
        assert err.count("\n") == err.count("warning /World/Ring/Copy: Cycle detected") == lines
