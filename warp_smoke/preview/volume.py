"""A volume of smoke in VTK, with what makes VTK's ray caster follow the Beer–Lambert law."""

import numpy as np
import pyvista as pv
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction

from warp_smoke.preview.color import expose_light
from warp_smoke.preview.smoke import SmokeVoxels

# Optical depth of voxels of greatest density along VTK's unit distance, which is set to match.
_UNIT_DEPTH = 2.0
# For RGBA voxels VTK takes the opacity of the first component, but the unit distance of the last.
_COMPONENTS = (0, 3)
# A ray ends where smoke lets a fiftieth or less through, an error of up to 5 of 255; VTK would continue to 1/255.
_OPAQUE = 0.98
_STEP_SHADER = "//VTK::Terminate::Impl"


class SmokeActor:
    """Draws one volume's smoke, if there is any.

    Args:
        plotter: where it is drawn.
        step: distance between samples [voxels]; they are jittered, so that no rings show.
    """

    def __init__(self, plotter: pv.Plotter, step: float):
        self._plotter, self._step = plotter, step
        self._actor: pv.Volume | None = None

    def show(self, smoke: SmokeVoxels | None, exposure: float = 0.0) -> None:
        """Draws these voxels in place of the last ones, at an exposure in stops; None draws nothing."""
        if self._actor is not None:
            self._actor.visibility = smoke is not None
        if smoke is None:
            return
        # Scale goes into the spacing: the ray caster measures distances before the actor's matrix applies.
        matrix = np.array(smoke.to_world)
        size = np.linalg.norm(matrix[:3, :3], axis=1)
        matrix[:3, :3] /= size[:, None]
        grid = pv.ImageData(dimensions=smoke.rgba.shape[:3], spacing=size)
        # VTK's first index is the fastest.
        rgba = np.ascontiguousarray(smoke.rgba.transpose(2, 1, 0, 3)).reshape(-1, 4)
        rgba[:, :3], brightest = expose_light(rgba[:, :3], smoke.brightest, exposure)
        grid.point_data["rgba"] = rgba
        grid.point_data.active_scalars_name = "rgba"
        if self._actor is None:
            self._actor = self._add(grid)
        else:
            self._actor.mapper.dataset = grid
        self._actor.user_matrix = matrix.T
        # VTK clips samples at white, but not their sum, which it divides by this window.
        self._actor.mapper.SetFinalColorWindow(1.0 / brightest)
        self._actor.mapper.SetFinalColorLevel(0.5 / brightest)
        self._actor.mapper.SetSampleDistance(self._step * size.min())
        for component in _COMPONENTS:
            self._actor.prop.SetScalarOpacityUnitDistance(component, _UNIT_DEPTH / smoke.extinction)

    def _add(self, grid: pv.ImageData) -> pv.Volume:
        # By hand: `add_volume` takes only bytes, too few for colours beyond white.
        actor = pv.Volume()
        actor.mapper, actor.prop = pv.GPUVolumeRayCastMapper(), pv.VolumeProperty(interpolation_type="linear")
        actor.prop.independent_components = False
        opacity = vtkPiecewiseFunction()
        for share in np.linspace(0.0, 1.0, 256):
            opacity.AddPoint(65535 * share, 1.0 - np.exp(-_UNIT_DEPTH * share))
        actor.prop.SetScalarOpacity(opacity)
        actor.mapper.SetAutoAdjustSampleDistances(False)
        actor.mapper.SetUseJittering(True)
        actor.mapper.dataset = grid
        ends = f"if (g_fragColor.a > {_OPAQUE}) break;\n    {_STEP_SHADER}"
        actor.GetShaderProperty().AddFragmentShaderReplacement(_STEP_SHADER, True, ends, False)
        self._plotter.add_actor(actor, reset_camera=False, render=False)
        return actor
