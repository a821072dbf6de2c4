"""Real meshes that nobody here wrote: those that come with Warp."""

from pathlib import Path

import numpy as np
import warp.examples
from pxr import Usd, UsdGeom

from warp_smoke.geometry import Mesh


def asset(name):
    """A mesh that comes with Warp, centred, the longest side 1.7."""
    stage = Usd.Stage.Open(str(Path(warp.examples.get_asset_directory()) / f"{name}.usd"))
    mesh = UsdGeom.Mesh(next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)))
    points = np.array(mesh.GetPointsAttr().Get(), np.float64)
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get())
    triangles, first = [], 0
    for count in mesh.GetFaceVertexCountsAttr().Get():
        triangles += [[corners[first], corners[first + n], corners[first + n + 1]] for n in range(1, count - 1)]
        first += count
    points -= (points.max(axis=0) + points.min(axis=0)) / 2
    return Mesh(1.7 * points / np.ptp(points, axis=0).max(), np.array(triangles))
