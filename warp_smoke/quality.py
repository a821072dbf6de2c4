"""Quality presets: measured settings for what a stage leaves open, and what was chosen for a scene (without Warp).

`quality.json` holds what `scripts/presets.py` measured on a named machine: for smoke, baked light and rendered
pictures, many settings with their error and time. Each preset combines one setting of each family.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path

from warp_smoke.record import FieldError, Record
from warp_smoke.scene import DistantLight, Light, Scene

QUALITIES = ("draft", "preview", "final")
_MEASURED = Path(__file__).with_suffix(".json")
_KEPT = ("error", "milliseconds", "ns_per_item")
# Distant lights cover the whole set with one map; others have six.
_DISTANT_MAPS = 2


@dataclass(frozen=True)
class Quality:
    """Settings for what a stage leaves open.

    Attributes:
        resolution: cells along the longest side of a domain.
        advection, max_courant, pressure_tolerance: for a domain.
        shadow_filter, shadow_map_size, smoke_shadow: for a light; maps of distant lights are twice as wide.
        smoke_shadow_share: texels along the light buffer's longer side, per cell along the finest domain's longest.
        texture_size: for a receiver.
        samples: rays along each side of a rendered pixel.
    """

    resolution: int
    advection: str
    max_courant: float
    pressure_tolerance: float
    shadow_filter: str
    shadow_map_size: int
    smoke_shadow: str
    smoke_shadow_share: float
    texture_size: int
    samples: int


@dataclass(frozen=True)
class Chosen:
    """The settings chosen for a scene.

    Attributes:
        by: what asked for them, such as `Quality draft`.
        settings: values by prim path and field.
        kept: fields that the stage sets itself and that were left unchanged, by prim path.
        why: the reason, in one line.
        measured: errors and times that the choice is based on, by name.
        taken_over: whether a resumed run took the choice over from before it was interrupted.
    """

    by: str
    settings: Mapping[str, Mapping[str, object]]
    kept: Mapping[str, tuple[str, ...]]
    why: str
    measured: Mapping[str, object]
    taken_over: bool = False

    def __str__(self) -> str:
        said = [f"{path} {_list(values)}" for path, values in self.settings.items()]
        left = [f"{path} {', '.join(names)}" for path, names in self.kept.items()]
        text = f"{self.by} sets {'; '.join(said)}" if said else f"{self.by} sets nothing"
        text += f". The stage's own values are kept: {'; '.join(left)}" if left else ""
        return f"{text}. {self.why}" + (". Taken over from the resumed run" if self.taken_over else "")


def words_of_choice(max_error: float | None, budget: float | None) -> str:
    """Describes what measured settings were asked for: a largest error, or a longest time per frame [ms]."""
    return f"Budget of {budget:g} ms a frame" if max_error is None else f"Error of {max_error:g} at most"


@cache
def measured_presets() -> dict:
    """Returns the measurements of each family: stage, machine, meaning of the error, and measured points."""
    return json.loads(_MEASURED.read_text(encoding="utf-8"))


def preset_points(name: str) -> dict[str, dict]:
    """Returns the measured points that make up a preset, one for each family.

    Raises:
        FieldError: there is no such preset.
    """
    if name not in QUALITIES:
        raise FieldError("run", "quality", name, ", ".join(QUALITIES))
    found = measured_presets().items()
    return {family: next(point for point in each["points"] if name in point["presets"]) for family, each in found}


def preset(name: str) -> Quality:
    """Returns a preset's settings.

    Raises:
        FieldError: there is no such preset.
    """
    settings = {}
    for point in preset_points(name).values():
        settings |= point["settings"]
    return Quality(**settings)


def choose_quality(scene: Scene, name: str) -> tuple[Scene, Chosen]:
    """Fills the fields that a scene leaves open with a preset's settings; returns the scene and these settings.

    A field is open if the stage does not set it or, for a record made in Python, if it has its default value.

    Raises:
        FieldError: there is no such preset.
    """
    quality, points = preset(name), preset_points(name)
    settings, kept = {}, {}

    def fill(record: Record, values: Mapping[str, object]) -> Record:
        defaults = {field.name: field.default for field in fields(record)}
        open_fields = {f for f in values if f not in record.given and getattr(record, f) == defaults[f]}
        found = {field: value for field, value in values.items() if field in open_fields and value != defaults[field]}
        settings.setdefault(record.path, {}).update(found)
        left = tuple(field for field in values if field not in open_fields)
        kept[record.path] = kept.get(record.path, ()) + left
        return replace(record, **found)

    domains = [fill(domain, _of_domain(quality)) for domain in scene.domains]
    finest = max((domain.resolution for domain in domains), default=None)
    lights = [fill(light, _of_light(quality, light, finest)) for light in scene.lights]
    surfaces = []
    for surface in scene.surfaces:
        receiver = surface.receiver and fill(surface.receiver, _of_receiver(quality))
        surfaces.append(surface if receiver is surface.receiver else replace(surface, receiver=receiver))
    families = [family for family, has in (("smoke", scene.domains), ("light", _receives(scene))) if has]
    measured = {family: {key: points[family][key] for key in _KEPT} | _measured_on(family) for family in families}
    said = [
        f"{each['is']} {each['error']:.2g} in {each['milliseconds']:.3g} ms a frame ({each['stage']})"
        for each in measured.values()
    ]
    why = f"Measured: {'; '.join(said)}" if said else "The scene has neither smoke nor bakes"
    chosen = replace(scene, domains=domains, lights=lights, surfaces=surfaces)
    settings, kept = ({path: each for path, each in found.items() if each} for found in (settings, kept))
    return chosen, Chosen(f"Quality {name}", settings, kept, why, measured)


def samples_of(name: str) -> int:
    """Returns how many rays a preset renders along each side of a pixel.

    Raises:
        FieldError: there is no such preset.
    """
    return preset(name).samples


def _of_domain(quality: Quality) -> dict[str, object]:
    names = ("resolution", "advection", "max_courant", "pressure_tolerance")
    return {name: getattr(quality, name) for name in names}


def _of_light(quality: Quality, light: Light, finest: int | None) -> dict[str, object]:
    texels = quality.shadow_map_size * (_DISTANT_MAPS if isinstance(light, DistantLight) else 1)
    values = {"shadow_filter": quality.shadow_filter, "shadow_map_size": texels}
    if finest is not None:
        values["smoke_shadow"] = quality.smoke_shadow
        if quality.smoke_shadow_share != 1.0:  # unset, texels are as wide as cells
            values["smoke_shadow_size"] = max(1, round(quality.smoke_shadow_share * finest))
    return values


def _of_receiver(quality: Quality) -> dict[str, object]:
    return {"texture_size": quality.texture_size}


def _measured_on(family: str) -> dict[str, str]:
    about = measured_presets()[family]
    return {"is": about["error"], "stage": about["stage"], "processor": about["machine"]["processor"]}


def _receives(scene: Scene) -> bool:
    return any(surface.receiver is not None for surface in scene.surfaces)


def _list(values: Mapping[str, object]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())
