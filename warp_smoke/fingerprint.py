"""What the results of a run depend on, as flat text, so that two runs can be compared and their difference named."""

import platform
from dataclasses import fields
from hashlib import sha256
from importlib.metadata import version

import numpy as np

from warp_smoke.picture_file import open_picture_file, tile_files
from warp_smoke.record import Record
from warp_smoke.scene import Scene, Texture

# Packages whose arithmetic affects the results.
_PACKAGES = ("warp-smoke", "warp-lang", "numpy", "scipy")


def fingerprint(scene: Scene, device: str, stirred_by: str = "") -> dict[str, str]:
    """Returns everything the results of a run depend on, by name: settings as text, arrays and files as digests.

    Neither the stage's location nor the number of threads is part of it.

    Args:
        scene: the scene to run.
        device: the device to run on.
        stirred_by: what else moves the air, such as a script's force; its presence is recorded, not its effect.
    """
    found = {f"version of {name}": version(name) for name in _PACKAGES}
    found |= {"machine": platform.machine(), "device": device.partition(":")[0]}
    found |= {f"the script's {stirred_by}": "given"} if stirred_by else {}
    for field in fields(Scene):
        value = getattr(scene, field.name)
        if field.compare and isinstance(value, tuple) and all(isinstance(each, Record) for each in value):
            found[f"scene: {field.name}"] = ", ".join(each.path for each in value)
            for record in value:
                _describe(found, f"{record.path}: ", record)
        elif field.compare:
            _describe_value(found, "scene: ", field.name, value)
    return found


def first_difference(before: dict[str, str], now: dict[str, str]) -> str | None:
    """Describes the first difference between two fingerprints; None if they are equal."""
    for name in dict.fromkeys((*now, *before)):
        was, is_now = before.get(name), now.get(name)
        if was == is_now:
            continue
        if was is None:
            return f"{name} is new"
        if is_now is None:
            return f"{name} is gone"
        return f"{name} was {was} and is {is_now}"
    return None


def digest(found: dict[str, str]) -> str:
    """Returns the SHA-256 of a fingerprint, 64 hexadecimal digits."""
    return sha256(repr(sorted(found.items())).encode()).hexdigest()


def _describe(found: dict[str, str], prefix: str, record: Record) -> None:
    found[f"{prefix}kind"] = type(record).__name__
    for field in fields(record):
        if field.compare:
            _describe_value(found, prefix, field.name, getattr(record, field.name))


def _describe_value(found: dict[str, str], prefix: str, name: str, value: object) -> None:
    if isinstance(value, Record):
        _describe(found, f"{prefix}{name}.", value)
        if isinstance(value, Texture):
            found[f"{prefix}{name}.content"] = _content(value.file)
    elif isinstance(value, tuple) and any(isinstance(each, Record) for each in value):
        for number, each in enumerate(value):
            _describe_value(found, prefix, f"{name}[{number}]", each)
    elif hasattr(value, "__array__"):
        values = np.ascontiguousarray(value)
        found[prefix + name] = f"{values.dtype} {list(values.shape)} {sha256(values).hexdigest()[:16]}"
    else:
        found[prefix + name] = repr(value)


def _content(file: str) -> str:
    found = sha256()
    try:
        for place, tile in tile_files(file).items():
            with open_picture_file(tile) as opened:
                found.update(repr(place).encode() + opened.read())
        return found.hexdigest()[:16]
    except OSError as error:  # the bake reports it
        return type(error).__name__
