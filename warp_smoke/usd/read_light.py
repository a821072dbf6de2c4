"""Reading of lights: `UsdLux` with `ShapingAPI`, `ShadowAPI` and `SmokeLightAPI`.

Exposure is folded into intensity, colour temperature into colour. Area lights become point lights of the same power at
their centre: RectLights and DiskLights shine to the front with a cosine falloff, CylinderLights in all directions, like
a sphere of the same area.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from pxr import Ar, Usd, UsdGeom, UsdLux

from warp_smoke.record import VAST, Samples, at_least, finite, positive
from warp_smoke.scene import DistantLight, Light, PointLight, SpotLight
from warp_smoke.sky import UnsupportedPicture, mean_radiance
from warp_smoke.usd.names import LIGHT
from warp_smoke.usd.read_smoke import read_smoke_fields, smoke_names
from warp_smoke.usd.reader import StageReader, shortest_decimal, value_of

# Inputs that are ignored, and the values at which they have no effect.
WITHOUT_EFFECT = {
    "inputs:diffuse": 1.0,
    "inputs:specular": 1.0,
    "inputs:shaping:focusTint": (0.0, 0.0, 0.0),
    "inputs:shaping:ies:file": None,
    "inputs:shadow:color": (0.0, 0.0, 0.0),
    "inputs:shadow:distance": -1.0,
    "inputs:shadow:falloff": -1.0,
}

# Layouts of a dome light's picture in which each row is a circle of latitude.
ROWS_OF_LATITUDE = ("automatic", "latlong")

# The largest exposure: more would take any intensity beyond single precision.
MOST_STOPS = 100.0


def is_ambient(prim: Usd.Prim) -> bool:
    """Returns whether a prim is a dome light."""
    return prim.IsA(UsdLux.DomeLight) or prim.IsA(UsdLux.DomeLight_1)


def read_light(reader: StageReader, prim: Usd.Prim) -> Light | None:
    """Reads a light; returns None, with a warning, for kinds that are not supported.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    if prim.GetTypeName() not in (*RADII, "DistantLight"):
        reader.warn(prim, f"a light of type {prim.GetTypeName()} is not supported; it is left out")
        return None
    _warn_without_effect(reader, prim, WITHOUT_EFFECT | {"inputs:texture:file": None})
    record, flat = DistantLight, prim.GetTypeName() in FLAT
    if prim.GetTypeName() in RADII:
        record = SpotLight if flat or prim.HasAPI(UsdLux.ShapingAPI) else PointLight
    elif prim.HasAPI(UsdLux.ShapingAPI):
        reader.warn(prim, "shaping of a distant light is not supported; it shines everywhere")

    with reader.naming(prim.GetPath(), smoke_names("SmokeLightAPI", record) | LIGHT):
        fields = {
            "color": _read_color(reader, prim),
            "intensity": _read_intensity(reader, prim),
            "normalize": reader.still(prim.GetAttribute(LIGHT["normalize"])),
            "enabled": reader.visible(prim),
        }
        shadow = prim.GetAttribute(LIGHT["shadow_enable"])
        if shadow and shadow.HasAuthoredValue():
            fields["shadow_enable"] = reader.still(shadow)
        if record is DistantLight:
            fields["angle"] = reader.still(prim.GetAttribute(LIGHT["angle"]))
        else:
            fields["radius"] = RADII[prim.GetTypeName()](reader, prim)
        if prim.HasAPI(UsdLux.ShapingAPI) and record is SpotLight:
            for name in ("cone_angle", "cone_softness", "focus"):
                fields[name] = reader.still(prim.GetAttribute(LIGHT[name]))
        if flat:
            fields = _to_the_front(fields)
        if "SmokeLightAPI" in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
            smoke = read_smoke_fields(reader, prim, "SmokeLightAPI", record)
            fields |= smoke | {"given": frozenset(smoke)}
        return record(path=reader.path(prim), transform=reader.transform(prim), **fields)


def read_ambient(reader: StageReader, prim: Usd.Prim) -> np.ndarray:
    """Reads a dome light's ambient colour, linear RGB, with the mean of its picture; black if invisible at the start.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    _warn_without_effect(reader, prim, WITHOUT_EFFECT)
    if UsdGeom.Imageable(prim).ComputeVisibility(reader.start) == UsdGeom.Tokens.invisible:
        return np.zeros(3)
    with reader.naming(prim.GetPath(), LIGHT):
        path = str(prim.GetPath())
        intensity = at_least(path, "intensity", _read_intensity(reader, prim))
        if isinstance(intensity, Samples):
            reader.warn(prim, "a dome light that changes in time is not supported; its first value is used")
            intensity = float(intensity.at(reader.start))
        light = intensity * np.array(at_least(path, "color", _read_color(reader, prim), shape=(3,)))
    return light * _read_sky(reader, prim) if light.any() else light


def _read_sky(reader: StageReader, prim: Usd.Prim) -> np.ndarray:
    """Reads the mean colour of a dome light's picture, linear RGB; white if there is none, or an unsupported one."""
    name, white = "inputs:texture:file", np.ones(3)
    asset = reader.still(prim.GetAttribute(name))
    if not asset or not asset.path:
        return white
    opened = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(asset.resolvedPath)) if asset.resolvedPath else None
    if not opened:
        raise reader.error(prim.GetPath(), name, f"@{asset.path}@", "a file that exists")
    layout = reader.still(prim.GetAttribute("inputs:texture:format"))
    if layout not in ROWS_OF_LATITUDE:
        reader.warn(prim, f"inputs:texture:format {layout} is not supported; the picture has no effect")
        return white
    try:
        mean, even = mean_radiance(opened.GetBuffer())
    except UnsupportedPicture as reason:
        reader.warn(prim, f"{name} is {reason}, which is not supported; it has no effect")
        return white
    except OSError as error:
        raise reader.error(prim.GetPath(), name, f"{asset.path} ({error})", "a picture that can be read") from None
    if not even:
        reader.warn(prim, f"the mean colour of {name} is used, as light from all directions")
    return mean


def link_light(prim: Usd.Prim, light: Light, paths: Sequence[str]) -> Light:
    """Returns the light with its `lightLink` and `shadowLink` applied to the surfaces and domains at some paths."""
    api = UsdLux.LightAPI(prim)
    return replace(
        light,
        illuminates=_members(api.GetLightLinkCollectionAPI(), paths),
        shadowed_by=_members(api.GetShadowLinkCollectionAPI(), paths),
    )


def _members(collection: Usd.CollectionAPI, paths: Sequence[str]) -> tuple[str, ...] | None:
    """Returns the paths that a collection includes; None if it includes them all."""
    query = collection.ComputeMembershipQuery()
    members = tuple(path for path in paths if query.IsPathIncluded(path))
    return None if len(members) == len(paths) else members


def _read_color(reader: StageReader, prim: Usd.Prim) -> tuple[float, ...]:
    path = str(prim.GetPath())
    color = finite(path, "color", reader.still(prim.GetAttribute(LIGHT["color"])), shape=(3,))
    if not reader.still(prim.GetAttribute("inputs:enableColorTemperature")):
        return color
    temperature = "inputs:colorTemperature"
    kelvin = positive(path, temperature, reader.still(prim.GetAttribute(temperature)))
    tint = UsdLux.BlackbodyTemperatureAsRgb(kelvin)
    return tuple(shortest_decimal(a * b) for a, b in zip(color, tint, strict=True))


def _read_intensity(reader: StageReader, prim: Usd.Prim) -> float | Samples:
    attributes = [prim.GetAttribute(name) for name in (LIGHT["intensity"], "inputs:exposure")]
    path = str(prim.GetPath())

    def at(time: float) -> float:
        intensity, exposure = (value_of(attribute, time) for attribute in attributes)
        stops = finite(path, "inputs:exposure", exposure, largest=MOST_STOPS)
        return shortest_decimal(finite(path, "intensity", intensity, largest=VAST) * 2.0**stops)

    return reader.over_time(reader.sample_times(attributes), at)


def _warn_without_effect(reader: StageReader, prim: Usd.Prim, without_effect: dict[str, object]) -> None:
    for name, value in without_effect.items():
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue() and attribute.Get() != value:
            reader.warn(prim, f"{name} is not supported; it has no effect")
    light = UsdLux.LightAPI(prim)
    if light.GetFiltersRel().GetTargets():
        reader.warn(prim, "light:filters is not supported; it has no effect")


def _lengths(reader: StageReader, prim: Usd.Prim, *names: str) -> list[float]:
    attributes = [prim.GetAttribute(f"inputs:{name}") for name in names]
    return [at_least(str(prim.GetPath()), a.GetName(), reader.still(a)) for a in attributes]


def _sphere_radius(reader: StageReader, prim: Usd.Prim) -> float:
    return _lengths(reader, prim, "radius")[0]


def _rect_radius(reader: StageReader, prim: Usd.Prim) -> float:
    width, height = _lengths(reader, prim, "width", "height")
    return _flat_radius(reader, prim, width * height)


def _disk_radius(reader: StageReader, prim: Usd.Prim) -> float:
    (radius,) = _lengths(reader, prim, "radius")
    return _flat_radius(reader, prim, np.pi * radius**2)


def _flat_radius(reader: StageReader, prim: Usd.Prim, area: float) -> float:
    """Returns the radius of the sphere that looks as large as a flat light seen from the front."""
    text = "shines from its centre only, to the front; its shadows are those of a disk"
    reader.warn(prim, f"a {prim.GetTypeName()} {text}")
    return shortest_decimal(np.sqrt(area / np.pi))


def _cylinder_radius(reader: StageReader, prim: Usd.Prim) -> float:
    radius, length = _lengths(reader, prim, "radius", "length")
    reader.warn(prim, "a CylinderLight is used as a sphere of the same area")
    return shortest_decimal(np.sqrt(2.0 * np.pi * radius * length / (4.0 * np.pi)))


def _to_the_front(fields: dict[str, object]) -> dict[str, object]:
    """Returns the fields of a spot light that from afar shines like a flat light of area A.

    With radiance L, the flat light gives the irradiance L A cos θ/d² at an angle θ to its front, and the sphere of
    radius √(A/π), whose area is 4 A, gives L A/d². `normalize` divides by the area, so the intensity is quadrupled.
    """
    cone = fields.get("cone_angle", 90.0)
    shaped = {
        "focus": fields.get("focus", 0.0) + 1.0,
        "cone_angle": min(cone, 90.0),
        "cone_softness": fields.get("cone_softness", 0.0) if cone < 90.0 else 0.0,
    }
    intensity = fields["intensity"]
    if fields["normalize"]:
        if isinstance(intensity, Samples):
            intensity = Samples(intensity.times, 4.0 * intensity.values)
        else:
            intensity = 4.0 * intensity
    return fields | shaped | {"intensity": intensity}


RADII: dict[str, Callable[[StageReader, Usd.Prim], float]] = {
    "SphereLight": _sphere_radius,
    "RectLight": _rect_radius,
    "DiskLight": _disk_radius,
    "CylinderLight": _cylinder_radius,
}
# Lights that shine to one side, along −Z.
FLAT = ("RectLight", "DiskLight")
