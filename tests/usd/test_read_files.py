"""Files that are missing, damaged or no stages: one line, no crash."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stage_text import HEADER, scene_of, write_stage

from warp_smoke.scene import Scene


def test_missing_file():
    """A stage that is not there."""
    with pytest.raises(ValueError, match=r"^nowhere/none\.usda: no such file$"):
        Scene.open("nowhere/none.usda")


def test_folder_instead_of_a_file(tmp_path):
    """A folder is no stage."""
    with pytest.raises(ValueError, match="is a folder; allowed: the file of a stage"):
        Scene.open(tmp_path)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("broken.usda", b'#usda 1.0\ndef Xform "A" {\n  int x =\n}\n'),
        ("noise.usd", bytes(range(256)) * 8),
        ("noise.usdc", bytes(range(256)) * 8),
        ("noise.usdz", bytes(range(256)) * 8),
        ("empty.usda", b""),
        ("picture.png", b"\x89PNG"),
    ],
)
def test_files_that_do_not_parse(tmp_path, capfd, name, content):
    """What is not USD is said in one line naming the file, and USD prints nothing."""
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match="not a USD stage") as error:
        Scene.open(path)
    assert str(error.value).startswith(f"{path}: not a USD stage: ")
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_syntax_errors_say_where(tmp_path):
    """The line number of a syntax error reaches the user."""
    path = tmp_path / "broken.usda"
    path.write_text('#usda 1.0\ndef Xform "A"\n{\n  int x =\n}\n')
    with pytest.raises(ValueError, match=r"broken\.usda:4:3"):
        Scene.open(path)


@given(st.binary(min_size=1, max_size=400), st.integers(0, 60))
@settings(max_examples=60, deadline=None)
def test_noise_never_crashes(tmp_path_factory, noise, keep):
    """A stage's first bytes with noise after them: refused in one line, without a crash."""
    path = tmp_path_factory.mktemp("noise") / "noise.usda"
    path.write_bytes(HEADER.encode()[:keep] + noise)
    with pytest.raises(ValueError, match=r"not a USD stage|defaultPrim is unset") as error:
        Scene.open(path)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("prim", "asset", "place"),
    [
        ('def "A" ( references = @./gone.usd@ ) { }', "gone.usd@", "/World/A"),
        ('def "A" ( payload = @gone.usd@ ) { }', "@gone.usd@", "/World/A"),
        ('def "A" ( references = </Nowhere> ) { }', "</Nowhere>", "/World/A"),
    ],
)
def test_missing_references(tmp_path, capfd, prim, asset, place):
    """A reference or payload that is not there is said in one line naming file, prim and asset; USD prints nothing."""
    path = write_stage(tmp_path, prim)
    with pytest.raises(ValueError, match=r"gone|Nowhere") as error:
        Scene.open(path)
    assert str(error.value).startswith(f"{path}: {place}: ")
    assert asset in str(error.value)
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_what_else_usd_finds_wrong_is_a_warning(tmp_path):
    """A prim that refers to itself is left as USD leaves it; USD's words become one warning on one line."""
    scene = scene_of(tmp_path, 'def Cube "A" ( references = </World/A> ) { }')
    assert len(scene.surfaces) == 1
    (warning,) = scene.warnings
    assert warning.startswith("/World/A: Cycle detected")
    assert "\n" not in warning


def test_missing_sublayer(tmp_path):
    """A sublayer that is not there is said in one line naming it."""
    with pytest.raises(ValueError, match=r"^[^\n]*Could not load sublayer @[^\n]*gone\.usda@[^\n]*$"):
        scene_of(tmp_path, "", HEADER.replace("upAxis", "subLayers = [@./gone.usda@]\n    upAxis"))
