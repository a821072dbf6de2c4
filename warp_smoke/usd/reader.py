"""Reading of values over time and transforms from an open stage, and how errors and warnings name its prims."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warp_smoke.record import FieldError, Samples, each_value

LONGEST_VALUE = 120
SINGLE_PRECISION = (Gf.Vec2f, Gf.Vec3f, Gf.Vec4f, Gf.Vec2h, Gf.Vec3h, Gf.Vec4h)
# Operations whose matrix is linear in their value, so that both can be interpolated alike.
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
        start: time code at which values that may not change are read.
        warnings: what is not supported, each once, as `PRIM: text`.
    """

    def __init__(self, file: str, start: float):
        self.file = file
        self.start = start
        self._warnings: dict[str, None] = {}
        self._transforms: dict[float, UsdGeom.XformCache] = {}

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings recorded by `warn`, in order."""
        return tuple(self._warnings)

    def warn(self, prim: Usd.Prim, text: str) -> None:
        """Records a warning that something on a prim is not supported."""
        self._warnings[f"{prim.GetPath()}: {text}"] = None

    def path(self, prim: Usd.Prim) -> str:
        """Returns the path of the records made from a prim."""
        return str(prim.GetPath())

    @contextmanager
    def naming(self, path: object, attributes: Mapping[str, str]) -> Iterator[None]:
        """Turns a FieldError raised inside the context into one line that names file, prim and attribute."""
        try:
            yield
        except FieldError as error:
            attribute = attributes.get(error.field, error.field)
            raise self.error(path, attribute, error.value, error.allowed) from None

    def error(self, path: object, attribute: str, value: object, allowed: str) -> ValueError:
        """Makes the one-line error for bad input."""
        return bad_input(self.file, path, attribute, value, allowed)

    def sample_times(self, attributes: Sequence[Usd.Attribute]) -> list[float]:
        """Returns the times of all samples of the attributes; of splines, the knots and the whole time codes."""
        times = set()
        for attribute in attributes:
            if attribute.HasSpline():
                knots = list(attribute.GetSpline().GetKnots())
                times.update(knots, whole_times(knots))
            else:
                times.update(attribute.GetTimeSamples())
        return sorted(times)

    def over_time(self, times: Sequence[float], evaluate: Callable[[float], object]) -> object:
        """Returns the values at the given time codes as Samples, or one value if they are all the same."""
        if len(times) < 2:
            return evaluate(self.start)
        values = np.array([evaluate(time) for time in times])
        if np.array_equal(values, np.broadcast_to(values[:1], values.shape), equal_nan=values.dtype.kind == "f"):
            return evaluate(self.start)
        return Samples(np.array(times), values)

    def changing(self, attribute: Usd.Attribute) -> object:
        """Returns an attribute's value, as Samples if it changes in time."""
        return self.over_time(self.sample_times([attribute]), partial(value_of, attribute))

    def still(self, attribute: Usd.Attribute) -> object:
        """Returns an attribute's value at the start, with a warning if it changes in time."""
        if attribute.ValueMightBeTimeVarying():
            name = attribute.GetName()
            self.warn(attribute.GetPrim(), f"{name} changes in time, which is not supported; its first value is used")
        return value_of(attribute, self.start)

    def transform(self, prim: Usd.Prim) -> np.ndarray | Samples:
        """Returns local to world, 4 × 4 row-vector matrix.

        It is sampled wherever one of its operations has a sample and, unless it is linear in between, also at every
        whole time code.
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
        """Returns whether neither a prim nor any of its ancestors is invisible."""
        imageable = UsdGeom.Imageable(prim)
        above = map(UsdGeom.Imageable, _upwards(prim))
        attributes = [one.GetVisibilityAttr() for one in above if one]
        return self.over_time(
            self.sample_times(attributes), lambda time: imageable.ComputeVisibility(time) != UsdGeom.Tokens.invisible
        )


def bad_input(file: str, path: object, attribute: str, value: object, allowed: str) -> ValueError:
    """Returns the error that names file, prim, attribute, value and what is allowed, in one line."""
    if isinstance(value, Samples):
        value = each_value(value).tolist()
    shown = " ".join(str(value).split())
    if len(shown) > LONGEST_VALUE:
        shown = shown[:LONGEST_VALUE] + "…"
    return ValueError(f"{file}: {path}: {attribute} is {shown}; allowed: {allowed}")


def whole_times(times: Sequence[float]) -> np.ndarray:
    """Returns the whole time codes between the first and the last of the given ones."""
    return np.arange(np.ceil(min(times)), np.floor(max(times)) + 1)


def value_of(attribute: Usd.Attribute, time: float) -> object:
    """Returns an attribute's value as plain Python or NumPy.

    A single-precision number becomes the shortest decimal that rounds to it: 0.1, not 0.10000000149.
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
    """Returns the shortest decimal number that single precision stores as this value; infinity if it is too large."""
    with np.errstate(over="ignore"):
        return float(str(np.float32(value)))


def _upwards(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """Yields a prim and its ancestors, without the pseudo-root."""
    while not prim.IsPseudoRoot():
        yield prim
        prim = prim.GetParent()


def moving_operations(prim: Usd.Prim, top: Usd.Prim | None = None) -> Iterator[UsdGeom.XformOp]:
    """Yields the transform operations of a prim and its ancestors, up to `top`, that may change in time."""
    for one in _upwards(prim):
        xformable = UsdGeom.Xformable(one)
        if xformable:
            yield from (operation for operation in xformable.GetOrderedXformOps() if operation.MightBeTimeVarying())
        if one == top or (xformable and xformable.GetResetXformStack()):
            break
