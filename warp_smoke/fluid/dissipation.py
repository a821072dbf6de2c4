"""Decay of density and temperature towards their ambient values, exact in time."""

from math import exp

import warp as wp

from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _decay(rows: Rows, ambient: float, factor: float, a_inout: wp.array3d[float]):
    """Decay: a = ambient + factor (a − ambient)."""
    i, j, c = wp.tid()
    i += rows.first
    a = dense(a_inout)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, a_inout.shape[2])
    while k < end:
        a[i, j, k] = ambient + factor * (a[i, j, k] - ambient)
        k += 1


def decay(launcher: Launcher, scalar: wp.array, ambient: float, rate: float, dt: float) -> None:
    """Lets a field decay: the difference from ambient falls by e^(−rate dt).

    Args:
        launcher: where it runs.
        scalar: [nx, ny, nz], changed.
        ambient: value it decays to.
        rate: [1/s].
        dt: [s].
    """
    launcher.launch(_decay, scalar.shape, ambient, exp(-rate * dt), scalar)
