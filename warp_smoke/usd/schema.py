"""The codeless schemas: the definitions in `generatedSchema.usda`, and their registration with USD."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

from pxr import Plug, Sdf, Usd

SCHEMA_FOLDER = Path(__file__).parent / "schema"


class SchemaAttribute(NamedTuple):
    """One attribute of an applied schema; the default is None if leaving it unset has a meaning of its own."""

    value_type: Sdf.ValueTypeName
    variability: Sdf.Variability
    default: object
    allowed_tokens: tuple[str, ...] | None


def register_schema() -> bool:
    """Registers the schemas with USD in this process, so that prims show their attributes with the defaults.

    USD builds its table of schemas when the first stage is opened, and never again: after that, this has no effect.
    Scenes are still read and authored correctly, from the names of the applied schemas alone.

    Returns:
        Whether USD knows the schemas.
    """
    Plug.Registry().RegisterPlugins(str(SCHEMA_FOLDER))
    return Usd.SchemaRegistry().FindAppliedAPIPrimDefinition("SmokeDomainAPI") is not None


@cache
def schema_attributes() -> Mapping[str, Mapping[str, SchemaAttribute]]:
    """Returns the attributes of each applied schema: schema name → attribute name → definition."""
    layer = Sdf.Layer.FindOrOpen(str(SCHEMA_FOLDER / "generatedSchema.usda"))
    return {
        prim.name: {
            spec.name: SchemaAttribute(spec.typeName, spec.variability, spec.default, spec.allowedTokens)
            for spec in prim.attributes
        }
        for prim in layer.rootPrims
    }
