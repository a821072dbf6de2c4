"""Reading of the prims that smoke schemas are applied to: domains, emitters, colliders, receivers."""

import typing
from collections.abc import Iterable, Iterator
from difflib import get_close_matches

from pxr import Usd, UsdGeom

from warp_smoke.geometry import Mesh, Points
from warp_smoke.record import FieldError, Record, Samples, positive
from warp_smoke.scene import Collider, Emitter, Receiver, SmokeDomain
from warp_smoke.usd.names import TRANSFORM, smoke_fields
from warp_smoke.usd.reader import StageReader, shortest_decimal, value_of
from warp_smoke.usd.schema import schema_attributes


def read_domain(reader: StageReader, prim: Usd.Prim) -> SmokeDomain:
    """Reads the domain that a box marks.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    names = smoke_names("SmokeDomainAPI", SmokeDomain) | {"lower": "extent", "upper": "extent"}
    with reader.naming(prim.GetPath(), names):
        lower, upper = _read_box(reader, prim)
        transform = reader.transform(prim)
        if isinstance(transform, Samples):
            reader.warn(prim, "its transform changes in time, which is not supported; it stays as it is at the start")
            transform = transform.at(reader.start)
        fields = read_smoke_fields(reader, prim, "SmokeDomainAPI", SmokeDomain)
        place = {"path": reader.path(prim), "transform": transform, "lower": lower, "upper": upper}
        return SmokeDomain(**place, given=frozenset(fields), **fields)


def read_emitter(reader: StageReader, prim: Usd.Prim, mesh: Mesh | Points) -> Emitter:
    """Reads the emitter that a prim with this shape marks.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    with reader.naming(prim.GetPath(), smoke_names("SmokeEmitterAPI", Emitter)):
        fields = read_smoke_fields(reader, prim, "SmokeEmitterAPI", Emitter)
        return Emitter(path=reader.path(prim), transform=reader.transform(prim), mesh=mesh, **fields)


def read_collider(reader: StageReader, prim: Usd.Prim, mesh: Mesh) -> Collider:
    """Reads the collider that a prim with this shape marks.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    with reader.naming(prim.GetPath(), smoke_names("SmokeColliderAPI", Collider)):
        fields = read_smoke_fields(reader, prim, "SmokeColliderAPI", Collider)
        return Collider(path=reader.path(prim), transform=reader.transform(prim), mesh=mesh, **fields)


def read_receiver(reader: StageReader, prim: Usd.Prim) -> Receiver:
    """Reads what is to be baked for a prim.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    with reader.naming(prim.GetPath(), smoke_names("SmokeReceiverAPI", Receiver)):
        fields = read_smoke_fields(reader, prim, "SmokeReceiverAPI", Receiver)
        return Receiver(path=reader.path(prim), given=frozenset(fields), **fields)


def read_smoke_fields(reader: StageReader, prim: Usd.Prim, schema: str, record: type[Record]) -> dict[str, object]:
    """Reads a record's fields from a schema's authored attributes; warns of attributes that it has no field for."""
    changing = {name for name, kind in typing.get_type_hints(record).items() if Samples in typing.get_args(kind)}
    fields = {attribute: field for field, attribute in smoke_fields(record, schema_attributes()[schema]).items()}
    values = {}
    for attribute, definition in schema_attributes()[schema].items():
        authored = prim.GetAttribute(attribute)
        if not authored or not authored.HasAuthoredValue():
            continue
        if attribute in fields:
            field = fields[attribute]
            values[field] = reader.changing(authored) if field in changing else reader.still(authored)
        elif definition.default is None or authored.Get(reader.start) != definition.default:
            reader.warn(prim, f"{attribute} is {value_of(authored, reader.start)}, which is not supported")
    return values


def smoke_names(schema: str, record: type[Record]) -> dict[str, str]:
    """Maps fields to attributes, for errors in a record that a schema fills."""
    return {"transform": TRANSFORM, **smoke_fields(record, schema_attributes()[schema])}


def unknown_schemas(applied: set[str]) -> Iterator[str]:
    """Yields a warning for each applied schema whose name looks like ours but is unknown."""
    known = schema_attributes()
    for name in sorted(applied):
        if name.lower().startswith("smo") and name.lower().endswith("api") and name not in known:
            yield f"apiSchemas has {name}, which is unknown" + _suggestion(name, known)


def _suggestion(name: str, known: Iterable[str]) -> str:
    """Returns the closest known name, ignoring case, as the end of a message; empty if none is close."""
    by_core = {each.removeprefix("smoke:").lower(): each for each in known}
    close = get_close_matches(name.removeprefix("smoke:").lower(), by_core, 1)
    return f"; did you mean {by_core[close[0]]}?" if close else ""


def stray_attributes(prim: Usd.Prim, applied: set[str]) -> Iterator[str]:
    """Yields a warning for each authored `smoke:` attribute that is unknown, or whose schema is not applied."""
    schemas = schema_attributes()
    for prop in prim.GetAuthoredPropertiesInNamespace("smoke"):
        name = prop.GetName()
        owners = [schema for schema, attributes in schemas.items() if name in attributes]
        if not owners:
            near = [attribute for schema in schemas if schema in applied for attribute in schemas[schema]]
            every = [attribute for attributes in schemas.values() for attribute in attributes]
            yield f"{name} is not an attribute of any smoke schema" + (
                _suggestion(name, near) or _suggestion(name, every)
            )
        elif not applied.intersection(owners):
            yield f"{name} has no effect, since {' or '.join(owners)} is not applied"


def _read_box(reader: StageReader, prim: Usd.Prim) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Reads the lower and upper corner of a domain, in local space."""
    path = str(prim.GetPath())
    if prim.IsA(UsdGeom.Cube):
        half = positive(path, "size", reader.still(prim.GetAttribute("size"))) / 2
        return (-half,) * 3, (half,) * 3
    authored = prim.GetAttribute("extent")
    if authored and authored.HasAuthoredValue():
        extent = reader.still(authored)
    else:
        extent = prim.IsA(UsdGeom.Boundable) and UsdGeom.Boundable(prim).ComputeExtent(reader.start)
    if not extent or len(extent) != 2:
        raise FieldError(path, "extent", extent or None, "the two corners of the domain's box")
    lower, upper = (tuple(map(shortest_decimal, corner)) for corner in extent)
    return lower, upper
