"""Diffusion of density and temperature, which are ambient on open sides and beyond."""

from math import inf

import warp as wp

from warp_smoke.fluid.diffusion.problem import DiffusionSolver
from warp_smoke.launch import Launcher, Rows, dense

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _shift(rows: Rows, amount: float, least: float, a_inout: wp.array3d[float]):
    """Shift: a = max(a + amount, least)."""
    i, j, c = wp.tid()
    i += rows.first
    a = dense(a_inout)
    k = wp.max(c * rows.run, 0)
    end = wp.min(k + rows.run, a_inout.shape[2])
    while k < end:
        a[i, j, k] = wp.max(a[i, j, k] + amount, least)
        k += 1


def diffuse_scalar(
    launcher: Launcher, solver: DiffusionSolver, field: wp.array, r: float, ambient: float, least: float = -inf
) -> float:
    """Diffuses a cell-centred field; r = 0 leaves it bit-identical.

    Args:
        launcher: where it runs.
        solver: solver of the domain, which assumes that fields are 0 on open sides.
        field: [nx, ny, nz], changed.
        r: from `diffusion_number`.
        ambient: value of the field on open sides.
        least: lower bound of the field, which round-off could otherwise violate.

    Returns:
        Bound on the error, as a share of the largest change; 0 from an exact solver.
    """
    if r == 0.0:
        return 0.0
    if ambient:
        launcher.launch(_shift, field.shape, -ambient, -inf, field)
    error = solver.diffuse(None, field, r)
    if ambient or least > -inf:
        launcher.launch(_shift, field.shape, ambient, least, field)
    return error
