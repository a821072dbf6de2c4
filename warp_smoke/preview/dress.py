"""A mesh of the set as it is drawn: with baked light as one piece, or with its materials as one piece for each."""

import numpy as np
import pyvista as pv

from warp_smoke.preview.surfaces import SurfaceActor
from warp_smoke.scene import Material, Surface


class DressedSurface:
    """One mesh of the set; VTK draws one material per actor, so a mesh with subsets has several actors.

    Attributes:
        surface: the scene's record.
        actors: what VTK draws.
    """

    def __init__(self, surface: Surface, ambient: np.ndarray, time: float):
        self.surface = surface
        self._whole = SurfaceActor(surface, ambient, time)
        self._pieces = [SurfaceActor(each, ambient, time) for each in surface.pieces] if surface.subsets else []
        self._all = (self._whole, *self._pieces)
        self.actors: list[pv.Actor] = [each.actor for each in self._all]

    def place(self, time: float) -> None:
        """Puts the mesh where it is at a time code; call a `show_…` method again afterwards."""
        for each in self._all:
            each.place(time)

    def show_picture(self, pixels: np.ndarray, exposure: float) -> None:
        """Draws a baked picture; see `SurfaceActor`."""
        self._hide(self._pieces)
        self._whole.show_picture(pixels, exposure)

    def show_colors(self, colors: np.ndarray, exposure: float) -> None:
        """Draws baked colours at the points; see `SurfaceActor`."""
        self._hide(self._pieces)
        self._whole.show_colors(colors, exposure)

    def show_material(self, material: Material, ambient: np.ndarray, exposure: float) -> None:
        """Draws the whole mesh in one material."""
        self._hide(self._pieces)
        self._whole.show_material(material, ambient, exposure)

    def show_own(self, default: Material, ambient: np.ndarray, exposure: float) -> None:
        """Draws the mesh in its own materials, or in a default one where it has none."""
        if self._pieces:
            self._hide([self._whole])
        for each in self._pieces or [self._whole]:
            each.show_material(each.surface.material or default, ambient, exposure)

    def _hide(self, actors: list[SurfaceActor]) -> None:
        for each in actors:
            each.actor.visibility = False
