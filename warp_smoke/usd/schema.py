"""The codeless schema: what `generatedSchema.usda` defines, and its registration with USD."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

from pxr import Plug, Sdf, Usd

SCHEMA_FOLDER = Path(__file__).parent / "schema"


class SchemaAttribute(NamedTuple):
    """One attribute of an applied schema; the default is None where unset has a meaning of its own."""

    value_type: Sdf.ValueTypeName
    variability: Sdf.Variability
    default: object
    allowed_tokens: tuple[str, ...] | None


def register_schema() -> bool:
    """Makes the schema known to USD in this process, so that prims show its attributes with their defaults.

    USD builds its table of schemas when the first stage is opened and never again: after that, this changes
    nothing. Scenes are read and authored all the same, from the names of the applied schemas alone.

    Returns:
        Whether USD knows the schema.
    """
    Plug.Registry().RegisterPlugins(str(SCHEMA_FOLDER))
    return Usd.SchemaRegistry().FindAppliedAPIPrimDefinition("SmokeDomainAPI") is not None


@cache
def schema_attributes() -> Mapping[str, Mapping[str, SchemaAttribute]]:
    """The attributes of each applied schema: schema name → attribute name → what is defined."""
    layer = Sdf.Layer.FindOrOpen(str(SCHEMA_FOLDER / "generatedSchema.usda"))
    return {
        prim.name: {
            spec.name: SchemaAttribute(spec.typeName, spec.variability, spec.default, spec.allowedTokens)
            for spec in prim.attributes
        }
        for prim in layer.rootPrims
    }
