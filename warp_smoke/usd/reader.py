"""An open stage while it is read: its values in time, its transforms, and how errors and warnings name its prims."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warp_smoke.record import FieldError, Samples, each_value

LONGEST_VALUE = 120
SINGLE_PRECISION = (Gf.Vec2f, Gf.Vec3f, Gf.Vec4f, Gf.Vec2h, Gf.Vec3h, Gf.Vec4h)
# Operations of which a value halfway gives the matrix halfway.
LINEAR_OPERATIONS = {
    UsdGeom.XformOp.TypeTransform,
    UsdGeom.XformOp.TypeTranslate,
    UsdGeom.XformOp.TypeTranslateX,
    UsdGeom.XformOp.TypeTranslateY,
    UsdGeom.XformOp.TypeTranslateZ,
    UsdGeom.XformOp.TypeScale,
    UsdGeom.XformOp.TypeScaleX,
    UsdGeom.XformOp.TypeScaleY,
    UsdGeom.XformOp.TypeScaleZ,
}


class StageReader:
    """Reads values from one stage.

    Attributes:
        file: how errors name the stage.
        start: time code at which values that may not change are taken.
        warnings: what is not supported, each said once, as `PRIM: text`.
    """

    def __init__(self, file: str, start: float):
        self.file = file
        self.start = start
        self._warnings: dict[str, None] = {}
        self._transforms: dict[float, UsdGeom.XformCache] = {}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was said by `warn`, in order."""
        return tuple(self._warnings)

    def warn(self, prim: Usd.Prim, text: str) -> None:
        """Notes that something on a prim is not supported."""
        self._warnings[f"{prim.GetPath()}: {text}"] = None

    def path(self, prim: Usd.Prim) -> str:
        """The path of the records made of a prim."""
        return str(prim.GetPath())

    @contextmanager
    def naming(self, path: object, attributes: Mapping[str, str]) -> Iterator[None]:
        """Turns a FieldError raised within into the one line that names file, prim and attribute."""
        try:
            yield
        except FieldError as error:
            attribute = attributes.get(error.field, error.field)
            raise self.error(path, attribute, error.value, error.allowed) from None

    def error(self, path: object, attribute: str, value: object, allowed: str) -> ValueError:
        """The one line for bad input."""
        return bad_input(self.file, path, attribute, value, allowed)

    def sample_times(self, attributes: Sequence[Usd.Attribute]) -> list[float]:
        """The time codes at which any of the attributes has a sample; splines are sampled at whole time codes too."""
        times = set()
        for attribute in attributes:
            if attribute.HasSpline():
                knots = list(attribute.GetSpline().GetKnots())
                times.update(knots, whole_times(knots))
            else:
                times.update(attribute.GetTimeSamples())
        return sorted(times)

    def over_time(self, times: Sequence[float], evaluate: Callable[[float], object]) -> object:
        """The values at some time codes as Samples, or the one value if they are all the same."""
        if len(times) < 2:
            return evaluate(self.start)
        values = np.array([evaluate(time) for time in times])
        if np.array_equal(values, np.broadcast_to(values[:1], values.shape), equal_nan=values.dtype.kind == "f"):
            return evaluate(self.start)
        return Samples(np.array(times), values)

    def changing(self, attribute: Usd.Attribute) -> object:
        """An attribute's value, as Samples where it changes in time."""
        return self.over_time(self.sample_times([attribute]), partial(value_of, attribute))

    def still(self, attribute: Usd.Attribute) -> object:
        """An attribute's value at the start, with a warning where it changes in time."""
        if attribute.ValueMightBeTimeVarying():
            name = attribute.GetName()
            self.warn(attribute.GetPrim(), f"{name} changes in time, which is not supported; its first value is used")
        return value_of(attribute, self.start)

    def transform(self, prim: Usd.Prim) -> np.ndarray | Samples:
        """Local to world, 4 × 4 row-vector matrix.

        It is sampled where any of the operations that make it has a sample, and where it is not linear between these
        also at every whole time code.
        """
        moving = list(moving_operations(prim))
        times = self.sample_times([operation.GetAttr() for operation in moving])
        linear = len(moving) == 1 and moving[0].GetOpType() in LINEAR_OPERATIONS and not moving[0].IsInverseOp()
        if times and not linear:
            times = sorted({*times, *whole_times(times)})
        return self.over_time(times, lambda time: np.array(self._transforms_at(time).GetLocalToWorldTransform(prim)))

    def _transforms_at(self, time: float) -> UsdGeom.XformCache:
        if time not in self._transforms:
            self._transforms[time] = UsdGeom.XformCache(time)
        return self._transforms[time]

    def visible(self, prim: Usd.Prim) -> bool | Samples:
        """Whether neither a prim nor an ancestor of it is invisible."""
        imageable = UsdGeom.Imageable(prim)
        above = map(UsdGeom.Imageable, _upwards(prim))
        attributes = [one.GetVisibilityAttr() for one in above if one]
        return self.over_time(
            self.sample_times(attributes), lambda time: imageable.ComputeVisibility(time) != UsdGeom.Tokens.invisible
        )


def bad_input(file: str, path: object, attribute: str, value: object, allowed: str) -> ValueError:
    """The one line that names file, prim and attribute, the value and what is allowed."""
    if isinstance(value, Samples):
        value = each_value(value).tolist()
    shown = " ".join(str(value).split())
    if len(shown) > LONGEST_VALUE:
        shown = shown[:LONGEST_VALUE] + "…"
    return ValueError(f"{file}: {path}: {attribute} is {shown}; allowed: {allowed}")


def whole_times(times: Sequence[float]) -> np.ndarray:
    """The whole time codes between the first and the last of some."""
    return np.arange(np.ceil(min(times)), np.floor(max(times)) + 1)


def value_of(attribute: Usd.Attribute, time: float) -> object:
    """An attribute's value as plain Python or NumPy.

    A number stored in single precision becomes the shortest decimal that is stored so: 0.1, not 0.10000000149.
    """
    value = attribute.Get(time)
    if isinstance(value, SINGLE_PRECISION):
        return tuple(map(shortest_decimal, value))
    if isinstance(value, (Gf.Vec2d, Gf.Vec3d, Gf.Vec4d)):
        return tuple(value)
    if isinstance(value, float) and attribute.GetTypeName() in (Sdf.ValueTypeNames.Float, Sdf.ValueTypeNames.Half):
        return shortest_decimal(value)
    if isinstance(value, Vt.TokenArray):
        return tuple(value)
    return value


def shortest_decimal(value: float) -> float:
    """The shortest decimal number that single precision stores as this value; infinity if it is too large."""
    with np.errstate(over="ignore"):
        return float(str(np.float32(value)))


def _upwards(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """A prim and its ancestors, without the pseudo-root."""
    while not prim.IsPseudoRoot():
        yield prim
        prim = prim.GetParent()


def moving_operations(prim: Usd.Prim, top: Usd.Prim | None = None) -> Iterator[UsdGeom.XformOp]:
    """The transform operations of a prim and its ancestors, up to `top`, that may change in time."""
    for one in _upwards(prim):
        xformable = UsdGeom.Xformable(one)
        if xformable:
            yield from (operation for operation in xformable.GetOrderedXformOps() if operation.MightBeTimeVarying())
        if one == top or (xformable and xformable.GetResetXformStack()):
            break
