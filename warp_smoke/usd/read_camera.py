"""Reading of cameras: `UsdGeomCamera`."""

from collections.abc import Sequence

from pxr import Usd, UsdGeom, UsdRender

from warp_smoke.record import VAST, finite
from warp_smoke.scene import Camera
from warp_smoke.usd.names import CAMERA, TRANSFORM
from warp_smoke.usd.reader import StageReader


def read_camera(reader: StageReader, prim: Usd.Prim) -> Camera:
    """Reads a camera.

    Raises:
        ValueError: one line naming file, prim and attribute.
    """
    if prim.GetAttribute("projection").Get() == UsdGeom.Tokens.orthographic:
        reader.warn(prim, "orthographic cameras are not supported; it is used as a perspective one")
    names = CAMERA | {"near": "clippingRange", "far": "clippingRange", "transform": TRANSFORM}
    with reader.naming(prim.GetPath(), names):
        lens = {field: reader.changing(prim.GetAttribute(attribute)) for field, attribute in CAMERA.items()}
        near, far = finite(str(prim.GetPath()), "near", reader.still(prim.GetAttribute("clippingRange")), (2,), VAST)
        return Camera(path=reader.path(prim), transform=reader.transform(prim), near=near, far=far, **lens)


def choose_camera(
    reader: StageReader, stage: Usd.Stage, cameras: Sequence[Usd.Prim], path: str | None
) -> Usd.Prim | None:
    """Chooses the camera that pictures and highlights are seen from.

    Args:
        reader: the stage's reader; takes a warning where nothing chooses among several cameras.
        stage: the stage.
        cameras: all cameras on the stage.
        path: prim path of the camera to use; unless given, the camera of the stage's render settings is used, or else
            the first one under the default prim, or else the first.

    Returns:
        One of the cameras; None if there are none.

    Raises:
        ValueError: there is no camera at the path.
    """
    by_path = {str(prim.GetPath()): prim for prim in cameras}
    if path is not None:
        if path not in by_path:
            raise reader.error("/", "camera", path, ", ".join(by_path) or "none, for the stage has no camera")
        return by_path[path]
    settings = UsdRender.Settings.GetStageRenderSettings(stage)
    if settings:
        for target in settings.GetCameraRel().GetTargets():
            if str(target) in by_path:
                return by_path[str(target)]
    first = sorted(cameras, key=lambda prim: not prim.GetPath().HasPrefix(stage.GetDefaultPrim().GetPath()))
    if len(first) > 1:
        text = f"this one of {len(first)} cameras is used; choose another by --camera or by the stage's render settings"
        reader.warn(first[0], text)
    return first[0] if first else None
