"""Authoring of lights as `UsdLux`."""

from pxr import Sdf, Usd, UsdLux

from warp_smoke.scene import DistantLight, Light, SpotLight
from warp_smoke.usd.author_prim import author_smoke_fields, author_transform, author_visibility, set_value
from warp_smoke.usd.names import LIGHT


def author_light(stage: Usd.Stage, light: Light) -> None:
    """Authors a light's prim; fields that UsdLux has no place for go into `SmokeLightAPI`."""
    if isinstance(light, DistantLight):
        prim = UsdLux.DistantLight.Define(stage, light.path).GetPrim()
        names = ["color", "intensity", "normalize", "angle"]
    else:
        prim = UsdLux.SphereLight.Define(stage, light.path).GetPrim()
        prim.GetAttribute("extent").Set([(-light.radius,) * 3, (light.radius,) * 3])
        names = ["color", "intensity", "normalize", "radius"]
    if isinstance(light, SpotLight):
        UsdLux.ShapingAPI.Apply(prim)
        names += ["cone_angle", "cone_softness", "focus"]
    for name in names:
        set_value(prim.GetAttribute(LIGHT[name]), getattr(light, name))
    if not light.shadow_enable:
        UsdLux.ShadowAPI.Apply(prim).CreateShadowEnableAttr(False)
    api = UsdLux.LightAPI(prim)
    _author_members(api.GetLightLinkCollectionAPI(), light.illuminates)
    _author_members(api.GetShadowLinkCollectionAPI(), light.shadowed_by)
    author_visibility(prim, light.enabled)
    author_transform(prim, light)
    author_smoke_fields(prim, "SmokeLightAPI", light)


def _author_members(collection: Usd.CollectionAPI, paths: tuple[str, ...] | None) -> None:
    """Makes a light's collection hold only these prims; None leaves it unchanged, with everything in it."""
    if paths is not None:
        collection.CreateIncludeRootAttr(False)
        collection.CreateIncludesRel().SetTargets([Sdf.Path(path) for path in paths])
