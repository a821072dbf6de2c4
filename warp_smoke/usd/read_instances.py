"""Reading of point instancers: every prim of every instance as if it were on the stage by itself.

Instances are identified by `ids`, or by their index in the arrays. Outside the times at which an instance exists, it
is invisible and does not move.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from pxr import Usd, UsdGeom

from warp_smoke.record import Samples, value_at
from warp_smoke.usd.reader import StageReader, moving_operations, whole_times

# Prototypes may be under an `over` or a `class`.
_PROTOTYPE_PRIMS = Usd.TraverseInstanceProxies(Usd.PrimIsActive & Usd.PrimIsLoaded)


@dataclass(frozen=True)
class _Instance:
    """One instance at one time: index of its prototype, transform to the instancer's space, and whether it is shown."""

    prototype: int
    to_instancer: np.ndarray
    shown: bool


def instanced_prims(reader: StageReader, prim: Usd.Prim) -> Iterator[tuple["InstanceReader", Usd.Prim]]:
    """Yields each prim of a point instancer's instances, with the reader that reads it as that instance's."""
    instancer = UsdGeom.PointInstancer(prim)
    instances = _Instances(reader, instancer)
    for identity, first in instances.every.items():
        prototype = instances.prototypes[first.prototype]
        inside = InstanceReader(reader, instances, identity, prototype)
        prims = iter(Usd.PrimRange(prototype, _PROTOTYPE_PRIMS))
        for each in prims:
            if each.IsA(UsdGeom.PointInstancer):
                prims.PruneChildren()
            yield inside, each


class _Instances:
    """The instances of a point instancer over time.

    Attributes:
        prim: the instancer.
        prototypes: root prims of its prototypes.
        times: time codes at which anything about the instances changes; none if nothing does.
        every: each instance that ever exists, by its identity, in its first state.
    """

    def __init__(self, reader: StageReader, instancer: UsdGeom.PointInstancer):
        self.prim, self._instancer, self._reader = instancer.GetPrim(), instancer, reader
        targets = instancer.GetPrototypesRel().GetTargets()
        self.prototypes = [self.prim.GetStage().GetPrimAtPath(path) for path in targets]
        attributes = [
            instancer.GetPositionsAttr(),
            instancer.GetOrientationsAttr(),
            instancer.GetOrientationsfAttr(),
            instancer.GetScalesAttr(),
            instancer.GetVelocitiesAttr(),
            instancer.GetAngularVelocitiesAttr(),
            instancer.GetProtoIndicesAttr(),
            instancer.GetIdsAttr(),
            instancer.GetInvisibleIdsAttr(),
        ]
        attributes = [attribute for attribute in attributes if attribute]
        self._check_types(attributes)
        times = reader.sample_times(attributes)
        self.times = sorted({*times, *whole_times(times)}) if len(times) > 1 else []
        self.at = lru_cache(maxsize=None)(self._at)
        self.every: dict[int, _Instance] = {}
        self._present: dict[int, list[float]] = {}
        for time in self.times or [reader.start]:
            for identity, instance in self.at(time).items():
                known = self.every.setdefault(identity, instance)
                self._present.setdefault(identity, []).append(time)
                if known.prototype != instance.prototype:
                    reader.warn(self.prim, "instances that change their prototype are not supported; the first is used")

    def _check_types(self, attributes: list[Usd.Attribute]) -> None:
        """Raises ValueError if a type is not the schema's: USD computes transforms and masks only from those."""
        for attribute in attributes:
            meant = self.prim.GetPrimDefinition().GetAttributeDefinition(attribute.GetName()).GetTypeName()
            # The layers count too: the attribute may name its schema's type and still have values of another.
            for kind in (attribute.GetTypeName(), *(spec.typeName for spec in attribute.GetPropertyStack())):
                if kind != meant:
                    raise self._reader.error(self.prim.GetPath(), attribute.GetName(), f"of type {kind}", str(meant))

    def _at(self, time: float) -> dict[int, _Instance]:
        """Returns the instances at a time code, by their identity."""
        prototypes = self._instancer.GetProtoIndicesAttr().Get(time) or []
        for number in set(prototypes):
            if not 0 <= number < len(self.prototypes) or not self.prototypes[number]:
                allowed = f"0…{len(self.prototypes) - 1}, the prototypes there are"
                raise self._reader.error(self.prim.GetPath(), "protoIndices", number, allowed)
        ids = self._instancer.GetIdsAttr().Get(time)
        identities = list(range(len(prototypes))) if not ids or len(ids) != len(prototypes) else list(ids)
        include = UsdGeom.PointInstancer.IncludeProtoXform
        unmasked = UsdGeom.PointInstancer.IgnoreMask
        matrices = self._instancer.ComputeInstanceTransformsAtTime(time, time, include, unmasked)
        if len(matrices) != len(prototypes):
            given = self._instancer.GetPositionsAttr().Get(time) or []
            raise self._reader.error(
                self.prim.GetPath(), "positions", f"{len(given)} in number", f"{len(prototypes)}, one for each instance"
            )
        shown = self._instancer.ComputeMaskAtTime(time) or [True] * len(prototypes)
        each = zip(identities, prototypes, matrices, shown, strict=True)
        return {int(one): _Instance(p, np.array(matrix), bool(seen)) for one, p, matrix, seen in each}

    def to_instancer(self, identity: int, time: float) -> np.ndarray:
        """Returns an instance's transform to the instancer's space, the nearest in time if it does not exist then."""
        now = self.at(time).get(identity)
        if now is None:
            present = np.array(self._present[identity])
            now = self.at(float(present[np.argmin(np.abs(present - time))]))[identity]
        return now.to_instancer

    def shown(self, identity: int, time: float) -> bool:
        """Returns whether an instance exists and is not masked."""
        now = self.at(time).get(identity)
        return now is not None and now.shown


class InstanceReader(StageReader):
    """Reads the prims of a prototype as those of one instance.

    Args:
        outer: the reader of the instancer.
        instances: the instancer's instances.
        identity: the identity of the instance.
        prototype: root prim of its prototype.

    Attributes:
        instancer: path of the instancer.
    """

    def __init__(self, outer: StageReader, instances: _Instances, identity: int, prototype: Usd.Prim):
        super().__init__(outer.file, outer.start)
        self._outer, self._instances, self._identity, self._prototype = outer, instances, identity, prototype
        self.warn = outer.warn
        self.instancer = outer.path(instances.prim)

    def path(self, prim: Usd.Prim) -> str:
        """Returns `<instancer>/Instance<identity>/<path from the prototype's root>`."""
        below = prim.GetPath().MakeRelativePath(self._prototype.GetPath().GetParentPath())
        return f"{self.instancer}/Instance{str(self._identity).replace('-', '_')}/{below}"

    def transform(self, prim: Usd.Prim) -> np.ndarray | Samples:
        """Returns local to world, by way of the prototype, the instance and the instancer."""
        outer = self._outer.transform(self._instances.prim)
        moving = list(moving_operations(prim, self._prototype))
        times = {*self.sample_times([operation.GetAttr() for operation in moving]), *self._instances.times}
        if isinstance(outer, Samples):
            times.update(outer.times.tolist())
        if times:
            times.update(whole_times(list(times)))

        def at(time: float) -> np.ndarray:
            inside = np.eye(4)
            if prim != self._prototype:
                inside = np.array(self._transforms_at(time).ComputeRelativeTransform(prim, self._prototype)[0])
            return inside @ self._instances.to_instancer(self._identity, time) @ value_at(outer, time)

        return self.over_time(sorted(times), at)

    def visible(self, prim: Usd.Prim) -> bool | Samples:
        """Returns whether the instance exists and neither it, its prototype nor the instancer is hidden."""
        outer = self._outer.visible(self._instances.prim)
        inside = [UsdGeom.Imageable(one) for one in self._inside(prim)]
        attributes = [one.GetVisibilityAttr() for one in inside if one]
        times = {*self.sample_times(attributes), *self._instances.times}
        if isinstance(outer, Samples):
            times.update(outer.times.tolist())

        def at(time: float) -> bool:
            hidden = any(attribute.Get(time) == UsdGeom.Tokens.invisible for attribute in attributes)
            return not hidden and self._instances.shown(self._identity, time) and bool(value_at(outer, time))

        return self.over_time(sorted(times), at)

    def _inside(self, prim: Usd.Prim) -> Iterator[Usd.Prim]:
        """Yields a prim and its ancestors within the prototype."""
        while prim.GetPath().HasPrefix(self._prototype.GetPath()):
            yield prim
            prim = prim.GetParent()
