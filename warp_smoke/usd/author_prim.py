"""Authoring of what all kinds of records share: fields of the package's schemas, transform and visibility."""

from dataclasses import fields

import numpy as np
from pxr import Gf, Usd, UsdGeom

from warp_smoke.record import Samples, each_value
from warp_smoke.scene import Prim, Receiver
from warp_smoke.usd.names import smoke_fields
from warp_smoke.usd.schema import schema_attributes


def set_value(attribute: Usd.Attribute, value: object) -> None:
    """Sets a value, or all its samples if it changes in time."""
    if isinstance(value, Samples):
        for time, sample in zip(value.times.tolist(), value.values.tolist(), strict=True):
            attribute.Set(tuple(sample) if isinstance(sample, list) else sample, time)
    else:
        attribute.Set(value)


def author_smoke_fields(prim: Usd.Prim, schema: str, record: Prim | Receiver) -> None:
    """Applies a schema, and sets the fields that differ from the record's defaults or were given."""
    prim.AddAppliedSchema(schema)
    definitions = schema_attributes()[schema]
    defaults = {field.name: field.default for field in fields(record)}
    for field, name in smoke_fields(type(record), definitions).items():
        value = getattr(record, field)
        if value != defaults[field] or field in record.given:
            definition = definitions[name]
            set_value(prim.CreateAttribute(name, definition.value_type, False, definition.variability), value)


def author_transform(prim: Usd.Prim, record: Prim) -> None:
    """Sets a prim's transform, unless it is the identity."""
    matrices = each_value(record.transform)
    if np.array_equal(matrices, np.eye(4)[None]):
        return
    operation = UsdGeom.Xformable(prim).AddTransformOp()
    if isinstance(record.transform, Samples):
        for time, matrix in zip(record.transform.times.tolist(), matrices, strict=True):
            operation.Set(Gf.Matrix4d(matrix), time)
    else:
        operation.Set(Gf.Matrix4d(matrices[0]))


def author_visibility(prim: Usd.Prim, visible: bool | Samples) -> None:
    """Hides a prim, always or at some times."""
    if visible is True:
        return
    attribute = UsdGeom.Imageable(prim).CreateVisibilityAttr()
    tokens = (UsdGeom.Tokens.invisible, UsdGeom.Tokens.inherited)
    if isinstance(visible, Samples):
        for time, on in zip(visible.times.tolist(), visible.values.tolist(), strict=True):
            attribute.Set(tokens[on], time)
    else:
        attribute.Set(tokens[visible])
