"""The codeless schema agrees with the records, and works whether or not USD could be told of it."""

import json
import os
import subprocess
import sys
from dataclasses import fields

import pytest
from pxr import Sdf
from stage_text import write_stage

from warp_smoke import material
from warp_smoke import scene as records
from warp_smoke.material import Material, Procedural
from warp_smoke.scene import Collider, DistantLight, Emitter, PointLight, Prim, Receiver, SmokeDomain, SpotLight
from warp_smoke.usd.names import LIGHT, PROCEDURAL, smoke_attribute, smoke_fields
from warp_smoke.usd.schema import SCHEMA_FOLDER, register_schema, schema_attributes

RECORDS = {
    "SmokeDomainAPI": SmokeDomain,
    "SmokeEmitterAPI": Emitter,
    "SmokeColliderAPI": Collider,
    "SmokeReceiverAPI": Receiver,
    "SmokeLightAPI": PointLight,
}
# Fields that have another home on the stage: the prim itself, its geometry, UsdLux.
ELSEWHERE = {"lower", "upper", "mesh", *(field.name for field in fields(Prim)), *LIGHT}


@pytest.mark.parametrize("schema", RECORDS)
def test_every_field_has_an_attribute(schema):
    """Each record field is either a smoke attribute of its schema or stands in a standard schema."""
    names = {field.name for field in fields(RECORDS[schema])}
    assert names - ELSEWHERE == set(smoke_fields(RECORDS[schema], schema_attributes()[schema])) - ELSEWHERE


@pytest.mark.parametrize("record", [*RECORDS.values(), DistantLight, SpotLight])
def test_defaults_are_those_of_the_records(record):
    """What a DCC shows for an attribute that is not authored is what the record takes."""
    schema = next((name for name, one in RECORDS.items() if one is record), "SmokeLightAPI")
    defaults = {field.name: field.default for field in fields(record)}
    for field, attribute in smoke_fields(record, schema_attributes()[schema]).items():
        shown = schema_attributes()[schema][attribute].default
        if field == "shadow_map_size":  # differs between lights, so that the schema shows none
            assert shown is None
        elif isinstance(defaults[field], tuple):
            assert tuple(shown) == defaults[field]
        else:
            assert shown == defaults[field]


@pytest.mark.parametrize(
    ("schema", "field", "allowed"),
    [
        ("SmokeDomainAPI", "boundary", records.BOUNDARIES),
        ("SmokeDomainAPI", "grids", records.GRIDS),
        ("SmokeDomainAPI", "advection", records.ADVECTION_SCHEMES),
        ("SmokeDomainAPI", "pressure_solver", records.PRESSURE_SOLVERS),
        ("SmokeDomainAPI", "diffusion_solver", records.DIFFUSION_SOLVERS),
        ("SmokeEmitterAPI", "source", records.SOURCES),
        ("SmokeReceiverAPI", "bake", records.BAKES),
        ("SmokeLightAPI", "falloff_model", records.FALLOFF_MODELS),
        ("SmokeLightAPI", "shadow_filter", records.SHADOW_FILTERS),
        ("SmokeLightAPI", "smoke_shadow", records.SMOKE_SHADOWS),
        ("SmokeLightAPI", "smoke_diffuser", records.SMOKE_DIFFUSERS),
        ("SmokeLightAPI", "smoke_projection", records.SMOKE_PROJECTIONS),
        ("SmokeLightAPI", "smoke_compositing", records.SMOKE_COMPOSITINGS),
    ],
)
def test_tokens_are_those_of_the_records(schema, field, allowed):
    """A DCC offers exactly the tokens that the record takes."""
    assert tuple(schema_attributes()[schema][smoke_attribute(field)].allowed_tokens) == allowed


def test_every_attribute_is_described():
    """Each schema and attribute has the name and the sentence that a DCC shows."""
    layer = Sdf.Layer.FindOrOpen(str(SCHEMA_FOLDER / "generatedSchema.usda"))
    for prim in layer.rootPrims:
        assert prim.documentation
        assert prim.customData["apiSchemaType"] == "singleApply"
        for attribute in prim.attributes:
            assert attribute.name.startswith("smoke:")
            assert attribute.displayName, attribute.path
            assert attribute.documentation.endswith("."), attribute.path


def test_plugin_declares_every_schema():
    """plugInfo.json and generatedSchema.usda name the same schemas."""
    types = json.loads((SCHEMA_FOLDER / "plugInfo.json").read_text())["Plugins"][0]["Info"]["Types"]
    schemas = {*RECORDS, "SmokeMaterialAPI"}
    assert {one["schemaIdentifier"] for one in types.values()} == set(schema_attributes()) == schemas


def test_materials_agree_with_their_records():
    """Each attribute of SmokeMaterialAPI is a field of Material or Procedural, with its default and tokens."""
    attributes = schema_attributes()["SmokeMaterialAPI"]
    defaults = {smoke_attribute(field.name): field.default for field in fields(Material)}
    defaults |= {PROCEDURAL[field.name]: field.default for field in fields(Procedural)}
    tokens = {
        "smoke:reflection": material.REFLECTIONS,
        "smoke:gloss": material.GLOSS_ROLES,
        "smoke:parallax": material.PARALLAXES,
        "smoke:procedural": material.PROCEDURALS,
    }
    assert set(PROCEDURAL.values()) < set(attributes)
    for name, attribute in attributes.items():
        if name == "smoke:procedural":
            assert attribute.default is None
        elif isinstance(defaults[name], float):
            assert attribute.default == pytest.approx(defaults[name], rel=1e-6)
        else:
            shown = attribute.default
            assert (tuple(shown) if isinstance(defaults[name], tuple) else shown) == defaults[name]
        assert tuple(attribute.allowed_tokens or ()) == tokens.get(name, ())


def test_registered_schema_gives_a_prim_its_attributes():
    """Once registered, an applied schema makes its attributes appear on a prim, with default and description."""
    script = (
        "from warp_smoke.usd.schema import register_schema; assert register_schema()\n"
        "from pxr import Usd\n"
        "stage = Usd.Stage.CreateInMemory()\n"
        "prim = stage.DefinePrim('/Box', 'Cube')\n"
        "prim.ApplyAPI('SmokeDomainAPI')\n"
        "attribute = prim.GetAttribute('smoke:resolution')\n"
        "assert attribute.Get() == 64 and 'cells are cubes' in attribute.GetDocumentation()\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


def test_reading_works_when_usd_was_used_first(tmp_path):
    """A stage opened with pxr before warp_smoke is imported leaves the schema unknown, and the scene is the same."""
    path = write_stage(
        tmp_path,
        """
    def Cube "Box" ( prepend apiSchemas = ["SmokeDomainAPI"] )
    {
        uniform int smoke:resolution = 12
        uniform token[] smoke:grids = ["density"]
    }""",
    )
    script = (
        "import sys\n"
        "if sys.argv[2] == 'pxr first':\n"
        "    from pxr import Usd; Usd.Stage.CreateInMemory().DefinePrim('/A', 'Cube')\n"
        "from warp_smoke.scene import Scene\n"
        "from warp_smoke.usd.schema import register_schema\n"
        "scene = Scene.open(sys.argv[1]); scene.save(sys.argv[1] + '.out.usda')\n"
        "print(register_schema(), scene.domains, scene.warnings, Scene.open(sys.argv[1] + '.out.usda') == scene)\n"
    )
    env = os.environ | {"PYTHONHASHSEED": "0"}  # sets are printed
    run = [
        subprocess.run(
            [sys.executable, "-c", script, str(path), order],
            check=True,
            timeout=60,
            capture_output=True,
            text=True,
            env=env,
        )
        for order in ("warp_smoke first", "pxr first")
    ]
    assert [one.stderr for one in run] == ["", ""]
    known, unknown = (one.stdout for one in run)
    assert known.startswith("True")
    assert "resolution=12" in known
    assert known.rstrip().endswith("() True")
    assert unknown == known.replace("True", "False", 1)


def test_registering_again_changes_nothing():
    """Registration may be asked for any number of times."""
    assert register_schema() == register_schema()
