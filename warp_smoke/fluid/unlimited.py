"""Advection schemes that may leave the range of their samples: to show what limiting costs and saves, not for smoke."""

from math import inf

import warp as wp

from warp_smoke.fluid.advection import SemiLagrangian, end_of_trace, sample_back
from warp_smoke.fluid.bfecc import Bfecc
from warp_smoke.fluid.cubic import sample_cubic
from warp_smoke.fluid.grid import Block
from warp_smoke.fluid.interpolation import mixed, settle
from warp_smoke.fluid.maccormack import MacCormack
from warp_smoke.launch import Launcher, Rows, bits, dense_store

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _sample_back_cubic(
    rows: Rows,
    block: Block,
    dx: wp.array3d[float],
    dy: wp.array3d[float],
    dz: wp.array3d[float],
    a: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    ambient: float,
    a_out: wp.array3d[float],
):
    """a_out(x) = a(x + d) by cubic interpolation."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    out = dense_store(a_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x, y, z, inside = end_of_trace(block, dx, dy, dz, i, j, k, a, lower, upper)
        value, _, _ = sample_cubic(a, x, y, z)
        out[i, j, k] = bits(settle(mixed(ambient, value, inside)))
        k += 1


class UnlimitedCubic(SemiLagrangian):
    """`CubicSemiLagrangian` without its limits."""

    _kernel = _sample_back_cubic


class UnlimitedMacCormack(MacCormack):
    """`MacCormack` without its limits, but for cells beside solids."""

    def __init__(self, launcher: Launcher, *args, **options):
        """Allocates; arguments as for `SemiLagrangian`."""
        super().__init__(launcher, *args, **options)
        for least, most in self._bounds.values():
            least.fill_(-inf)
            most.fill_(inf)

    def _make_guess(self, samples, field: wp.array, limits: tuple, ambient: float) -> None:
        (shape, block), guess = samples.carried, self._guess[samples]
        self._launcher.launch(sample_back, shape, block, *self._back, field, *limits, ambient, guess)
        if self._boundary and samples is self._cells:
            self._boundary.sample(self._back, field, limits, ambient, (guess, guess, guess))


class UnlimitedBfecc(UnlimitedMacCormack, Bfecc):
    """`Bfecc` without its limits."""


# By the names of the schemes that they differ from.
UNLIMITED_SCHEMES = {
    "semi_lagrangian_cubic": UnlimitedCubic,
    "maccormack": UnlimitedMacCormack,
    "bfecc": UnlimitedBfecc,
}
