"""Reading of cameras: `UsdGeomCamera`."""

from pxr import Usd, UsdGeom

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
