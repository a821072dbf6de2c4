"""Selection of the emitters and colliders that take part in a domain, and what emitters may do there."""

import numpy as np

from warp_smoke.lattice import Lattice
from warp_smoke.plan.passes import Ledger
from warp_smoke.plan.reach import is_moving, may_touch, over, swept_corners
from warp_smoke.record import each_value
from warp_smoke.scene import ArrayCollider, ArrayEmitter, Collider, Emitter, Scene, SmokeDomain
from warp_smoke.scene.arrays import check_cells


def heats(emitter: Emitter | ArrayEmitter, ambient: float) -> bool:
    """Returns whether its smoke may be hotter or colder than the air; always for arrays, whose values may change."""
    if isinstance(emitter, ArrayEmitter):
        return emitter.temperature is not None
    return bool(np.any(each_value(emitter.temperature) != ambient))


def weighs(emitter: Emitter | ArrayEmitter) -> bool:
    """Returns whether it may emit smoke of non-zero density."""
    if isinstance(emitter, ArrayEmitter):
        return emitter.density is not None
    return bool(np.any(each_value(emitter.density)))


def pushes(emitter: Emitter | ArrayEmitter) -> bool:
    """Returns whether it may give the air a velocity."""
    if isinstance(emitter, ArrayEmitter):
        return emitter.velocity is not None
    return bool(np.any(each_value(emitter.velocity)) or (emitter.inherit_velocity and is_moving(emitter)))


def stirs(emitter: Emitter | ArrayEmitter) -> bool:
    """Returns whether it stirs the air inside it."""
    return isinstance(emitter, Emitter) and emitter.turbulence > 0.0


def _covers(record: ArrayEmitter | ArrayCollider, domain: SmokeDomain, lattice: Lattice) -> bool:
    """Returns whether a record's arrays are meant for a domain.

    Raises:
        FieldError: they are, but do not fit its cells.
    """
    if record.domain not in (None, domain.path):
        return False
    check_cells(record, lattice.shape)
    return True


def find_emitters(
    ledger: Ledger, scene: Scene, domain: SmokeDomain, lattice: Lattice
) -> tuple[Emitter | ArrayEmitter, ...]:
    """Returns the emitters that ever act in the domain; the ledger records why the others do not."""
    found = []
    for emitter in scene.emitters:
        if isinstance(emitter, ArrayEmitter):
            if _covers(emitter, domain, lattice):
                found.append(emitter)
            else:
                ledger.omit("emit", (domain.path, emitter.path), f"{emitter.path} is for {emitter.domain}")
            continue
        gives = emitter.density if emitter.rate is None else emitter.rate
        corners = swept_corners(emitter, scene.frames)
        if not np.any(over(emitter.enabled, scene.frames)):
            why = f"{emitter.path} is off at every frame"
        elif not np.any(each_value(gives)) and not np.any(each_value(emitter.temperature)):
            why = f"{emitter.path} makes no smoke: its density or rate is 0"
        elif not may_touch(lattice, corners):
            why = f"{emitter.path} never touches {domain.path}"
        else:
            found.append(emitter)
            continue
        ledger.omit("emit", (domain.path, emitter.path), why)
    return tuple(found)


def find_colliders(
    ledger: Ledger, scene: Scene, domain: SmokeDomain, lattice: Lattice
) -> tuple[Collider | ArrayCollider, ...]:
    """Returns the colliders that are ever in the domain; the ledger records those that are not."""
    found = []
    for collider in scene.colliders:
        if isinstance(collider, ArrayCollider):
            if _covers(collider, domain, lattice):
                found.append(collider)
            else:
                ledger.omit("collide", (domain.path, collider.path), f"{collider.path} is for {collider.domain}")
        elif may_touch(lattice, swept_corners(collider, scene.frames)):
            found.append(collider)
        else:
            why = f"{collider.path} never touches {domain.path}"
            ledger.omit("collide", (domain.path, collider.path), why)
    return tuple(found)
