"""Slices through volumes that show a quantity by colour, with a colour bar."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pyvista as pv


class Quantity(NamedTuple):
    """A quantity that a slice can show: the volume's field it is read from, and its title with its unit."""

    field: str
    title: str


QUANTITIES = {
    "density": Quantity("density", "density"),
    "temperature": Quantity("temperature", "temperature"),
    "speed": Quantity("vel", "speed [m/s]"),
}
COLORS = "viridis"
TEXT_SHARE = 1 / 45  # of the picture's height
_BAR = {
    "vertical": True,
    "position_x": 0.9,
    "position_y": 0.2,
    "width": 0.05,
    "height": 0.6,
    "color": "#e8e8e8",
    "n_labels": 5,
    "fmt": "%.3g",
    "shadow": True,  # else the text is lost against a bright floor
    "render": False,
}


@dataclass(frozen=True)
class Slice:
    """One layer of a volume's voxels.

    Attributes:
        values: [na, nb] float32.
        to_world: index (a, b, 0) of a voxel to the world position of its centre, 4 × 4 row-vector matrix.
    """

    values: np.ndarray
    to_world: np.ndarray


def cut_slice(values: np.ndarray, to_world: np.ndarray, facing: np.ndarray, middle: np.ndarray | None) -> Slice | None:
    """Returns the layer of voxels that faces a direction most and lies nearest to a point.

    Args:
        values: [nx, ny, nz].
        to_world: index (i, j, k) of a voxel to the world position of its centre, 4 × 4 row-vector matrix.
        facing: a world direction, [3].
        middle: a world point; None = the middle of the voxels.

    Returns:
        The slice, or None if the point lies outside the voxels along the slice's normal.
    """
    axes = to_world[:3, :3] / np.linalg.norm(to_world[:3, :3], axis=1, keepdims=True)
    axis = int(np.argmax(np.abs(axes @ facing)))
    index = (values.shape[axis] - 1) / 2
    if middle is not None:
        index = float((np.append(middle, 1.0) @ np.linalg.inv(to_world))[axis])
    layer = round(index)
    if not 0 <= layer < values.shape[axis]:
        return None
    kept = [a for a in range(3) if a != axis]
    place = np.eye(4)
    place[:3] = to_world[[*kept, axis]]
    place[3] = to_world[3] + layer * to_world[axis]
    return Slice(np.take(values, layer, axis), place)


class SliceActors:
    """Draws slices, all on one colour scale, which grows to the values shown so far.

    Args:
        plotter: where they are drawn.
    """

    def __init__(self, plotter: pv.Plotter):
        self._plotter = plotter
        self._names: list[str] = []
        self._ranges: dict[str, tuple[float, float]] = {}

    def show(self, quantity: str | None, slices: tuple[Slice | None, ...]) -> None:
        """Draws these slices and their colour bar in place of the last ones."""
        for name in self._names:
            self._plotter.remove_actor(name, reset_camera=False, render=False)
        self._names.clear()
        for title in list(self._plotter.scalar_bars.keys()):
            self._plotter.remove_scalar_bar(title, render=False)
        shown = [one for one in slices if one is not None and one.values.size]
        if quantity is None:
            return
        limits = self._ranges.get(quantity, (0.0, 0.0))
        for one in shown:
            limits = min(limits[0], float(one.values.min())), max(limits[1], float(one.values.max()))
        self._ranges[quantity] = limits
        for number, one in enumerate(shown):
            name = f"slice {number}"
            self._names.append(name)
            self._plotter.add_mesh(
                _sheet(one),
                name=name,
                scalars="value",
                cmap=COLORS,
                clim=limits if limits[0] < limits[1] else (0.0, 1.0),
                lighting=False,
                show_scalar_bar=False,
                reset_camera=False,
                render=False,
            )
        if shown:
            mapper = self._plotter.actors[self._names[0]].mapper
            size = max(round(TEXT_SHARE * self._plotter.window_size[1]), 8)
            sizes = {"title_font_size": size, "label_font_size": size}
            # The title's empty second line keeps it clear of the topmost label.
            self._plotter.add_scalar_bar(f"{QUANTITIES[quantity].title}\n", mapper=mapper, **_BAR, **sizes)


def _sheet(one: Slice) -> pv.PolyData:
    """Makes one square for each voxel of a slice, with the voxel's value."""
    a, b = one.values.shape
    i, j = (edge.ravel() for edge in np.meshgrid(np.arange(a + 1) - 0.5, np.arange(b + 1) - 0.5, indexing="ij"))
    corners = np.stack([i, j, np.zeros_like(i), np.ones_like(i)], axis=1) @ one.to_world
    first = (np.arange(a)[:, None] * (b + 1) + np.arange(b)).ravel()
    sheet = pv.PolyData.from_regular_faces(corners[:, :3], first[:, None] + [0, b + 1, b + 2, 1])
    sheet.cell_data["value"] = one.values.ravel()
    return sheet
