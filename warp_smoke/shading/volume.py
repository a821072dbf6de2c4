"""Light inside the smoke: what each cell scatters, by single scattering with an isotropic phase function.

S = albedo ⊗ (ambient + Σ_L V_L T_L ⊗ B_L / 4), with π B_L the irradiance of a surface that faces light L
(`light_source`), and V_L and T_L the shares that surfaces and smoke between light and cell let through. Along a ray, a
renderer adds S (1 − e^(−τ)).
"""

from collections.abc import Callable, Collection, Sequence

import numpy as np
import warp as wp

from warp_smoke.lattice import Lattice
from warp_smoke.launch import Launcher, Rows
from warp_smoke.scene import Light
from warp_smoke.shading.light_source import LightSource, incident_light, light_source

wp.set_module_options({"enable_backward": False})

# Cells that are lit at a time: more would cost scratch memory and gain nothing.
BLOCK = 16384


@wp.kernel
def _place_cells(rows: Rows, cells: wp.array[int], ny: int, nz: int, to_set: wp.mat44, points_out: wp.array[wp.vec3]):
    """points[s] = centre of the cell with flat index cells[s], in set space."""
    s = rows.first + wp.tid()
    n = cells[s]
    k = n % nz
    j = (n // nz) % ny
    i = n // (ny * nz)
    points_out[s] = wp.transform_point(to_set, wp.vec3(float(i) + 0.5, float(j) + 0.5, float(k) + 0.5))


@wp.kernel
def _face_light(rows: Rows, light: LightSource, points: wp.array[wp.vec3], normals_out: wp.array[wp.vec3]):
    """normals[s] = unit vector from points[s] to the light."""
    s = rows.first + wp.tid()
    to_light, _ = incident_light(light, points[s])
    normals_out[s] = to_light


@wp.kernel
def _scatter_light(
    rows: Rows,
    light: LightSource,
    points: wp.array[wp.vec3],
    visibility: wp.array[float],
    shares: wp.array2d[float],
    albedo: wp.vec3,
    scattered_inout: wp.array[wp.vec3],
):
    """scattered[s] += V albedo ⊗ T ⊗ B / 4, with one share T for all colours or one each."""
    s = rows.first + wp.tid()
    _, b = incident_light(light, points[s])
    last = shares.shape[0] - 1
    share = wp.vec3(shares[0, s], shares[wp.min(1, last), s], shares[last, s])
    scattered_inout[s] = scattered_inout[s] + 0.25 * visibility[s] * wp.cw_mul(albedo, wp.cw_mul(share, b))


class VolumeLight:
    """The light that the smoke of one domain scatters, cell by cell; cells without smoke cost nothing."""

    def __init__(
        self,
        launcher: Launcher,
        lattice: Lattice,
        lights: Sequence[tuple[Light, int]],
        origin: np.ndarray,
        albedo: tuple[float, float, float],
        ambient: tuple[float, float, float],
        shadowed: Collection[str] = (),
    ):
        """Allocates scratch memory for a block of cells.

        Args:
            launcher: launches the kernels.
            lattice: the smoke's cells.
            lights: those that reach the smoke, each with its number of shares: 1, or 3 where smoke colours it.
            origin: world position of set space's origin [stage units], [3] float64.
            albedo: linear RGB.
            ambient: light from everywhere, linear RGB.
            shadowed: paths of the lights from which surfaces shadow the smoke.
        """
        self._launcher, self._lattice, self._lights, self._origin = launcher, lattice, tuple(lights), origin
        to_set = lattice.cells_to_world()
        to_set[3, :3] -= origin
        self._to_set = wp.mat44(to_set.T.astype(np.float32))
        self._albedo = wp.vec3(*albedo)
        self._everywhere = wp.vec3(*np.multiply(albedo, ambient).tolist())
        self._cells = launcher.zeros(BLOCK, "volume_light", dtype=int)
        self._points = launcher.zeros(BLOCK, "volume_light", dtype=wp.vec3)
        self._scattered = launcher.zeros(BLOCK, "volume_light", dtype=wp.vec3)
        self._unshadowed = launcher.array(np.ones(BLOCK, np.float32), "volume_light")
        self._shadowed = frozenset(shadowed)
        if self._shadowed:
            self._normals = launcher.zeros(BLOCK, "volume_light", dtype=wp.vec3)
            self._visibility = launcher.zeros(BLOCK, "volume_light")
        self._shares = {n: launcher.zeros((n, BLOCK), "volume_light") for n in {n for _, n in self._lights}}

    def update(
        self,
        density: np.ndarray,
        time: float,
        look_through: Callable[[Light, wp.array, wp.array], None],
        look_past: Callable[[Light, wp.array, wp.array, wp.array], None],
    ) -> np.ndarray:
        """Computes the light that is scattered at a time code.

        Args:
            density: [nx, ny, nz]; cells without density stay black.
            time: time code.
            look_through: multiplies shares [1 or 3, n] of a light by what smoke lets through to points [n].
            look_past: writes the share [n] of a `shadowed` light that surfaces let through to points [n] with normals
                [n], which face the light.

        Returns:
            S, linear RGB, [nx, ny, nz, 3] float32.
        """
        found = np.zeros((*self._lattice.shape, 3), np.float32)
        smoky = np.flatnonzero(density > 0.0).astype(np.int32)
        sources = [light_source(light, self._origin, time) for light, _ in self._lights]
        _, ny, nz = self._lattice.shape
        launch = self._launcher.launch_each
        for first in range(0, len(smoky), BLOCK):
            block = smoky[first : first + BLOCK]
            self._cells.assign(np.resize(block, BLOCK))  # repeated, so that all launches have one size
            launch(_place_cells, BLOCK, self._cells, ny, nz, self._to_set, self._points)
            self._scattered.fill_(self._everywhere)
            for source, (light, channels) in zip(sources, self._lights, strict=True):
                shares = self._shares[channels]
                shares.fill_(1.0)
                look_through(light, self._points, shares)
                visibility = self._unshadowed
                if light.path in self._shadowed:
                    visibility = self._visibility
                    launch(_face_light, BLOCK, source, self._points, self._normals)
                    look_past(light, self._points, self._normals, visibility)
                args = (source, self._points, visibility, shares, self._albedo, self._scattered)
                launch(_scatter_light, BLOCK, *args)
            found.reshape(-1, 3)[block] = self._scattered.numpy()[: len(block)]
        return found
