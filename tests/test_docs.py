"""The documentation: generated pages are current, links lead somewhere, examples run."""

import re
import runpy
from pathlib import Path

import pytest
from pxr import Sdf

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
EXAMPLES = [page for page in PAGES if "```python" in page.read_text(encoding="utf-8")]


def test_schema_reference_is_current():
    """docs/schema.md says what the schema says."""
    script = runpy.run_path(str(ROOT / "scripts/schema_reference.py"))
    assert (ROOT / "docs/schema.md").read_text(encoding="utf-8") == script["schema_reference"]()


def test_cli_reference_is_current():
    """docs/cli.md says what the commands say."""
    script = runpy.run_path(str(ROOT / "scripts/cli_reference.py"))
    assert (ROOT / "docs/cli.md").read_text(encoding="utf-8") == script["cli_reference"]()


def test_hard_cases_are_found():
    """Every test that docs/stability.md is made from is there."""
    script = runpy.run_path(str(ROOT / "scripts/stability.py"))
    for names in script["ELSEWHERE"].values():
        assert [name for name in names if not list(script["find"](name))] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    """Every relative link and picture of a page is a file."""
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_places_in_pages_are_there(page):
    """What follows the # of a link is a heading of the page that it leads to, as it is written in addresses."""
    for target, place in re.findall(r"\]\(([^):]*)#([^)]+)\)", page.read_text(encoding="utf-8")):
        text = (page.parent / target if target else page).read_text(encoding="utf-8")
        headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
        assert place in [re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings], place


def test_usd_example_smokes(tmp_path):
    """The stage in the README reads without a warning and calls for smoke."""
    import warp_smoke as ws

    text = re.search(r"```usda\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL).group(1)
    (tmp_path / "least.usda").write_text(text)
    scene = ws.Scene.open(tmp_path / "least.usda")
    assert scene.warnings == ()
    assert "advect_density" in ws.make_plan(scene).domains[0].passes


EXPORT = """#usda 1.0
(
    defaultPrim = "root"
    upAxis = "Z"
    metersPerUnit = 1
    startTimeCode = 1
    endTimeCode = 48
)
def Xform "root"
{
    def Xform "Smoke_Box"
    {
        def Cube "Cube"
        {
        }
    }
    def Xform "Torch"
    {
        def Sphere "Sphere"
        {
            double radius = 0.3
        }
    }
}
"""


def test_a_layer_over_an_export_smokes(tmp_path):
    """The layer in the page on other programs, over a stage with its names, calls for smoke without a warning."""
    import warp_smoke as ws

    text = re.search(r"```usda\n(.*?)```", (ROOT / "docs/dcc.md").read_text(encoding="utf-8"), re.DOTALL).group(1)
    (tmp_path / "shot.usda").write_text(text)
    (export := tmp_path / "export.usda").write_text(EXPORT)
    Sdf.Layer.FindOrOpen(str(export)).Export(str(tmp_path / "export.usdc"))
    scene = ws.Scene.open(tmp_path / "shot.usda")
    assert scene.warnings == ()
    assert "advect_density" in ws.make_plan(scene).domains[0].passes


@pytest.mark.parametrize("page", EXAMPLES, ids=lambda page: page.name)
def test_python_examples_run(page, tmp_path, monkeypatch):
    """The Python examples of a page run one after the other, on small versions of the stages."""
    import warp_smoke as ws
    from warp_smoke.usd.read import read_scene

    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)

    def small(path):
        from dataclasses import replace

        scene = read_scene(ROOT / path)
        return replace(scene, end=scene.start + 1, domains=[replace(d, resolution=16) for d in scene.domains])

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(ws.Scene, "open", staticmethod(small))
    exec("\n".join(blocks), {})
