"""Advection schemes without limiters: to show what limiting costs and prevents, not for simulating smoke."""

from math import inf

import warp as wp

from warp_smoke.fluid.advection import SemiLagrangian, sample_back, sampling_kernel
from warp_smoke.fluid.bfecc import Bfecc
from warp_smoke.fluid.cubic import sample_cubic
from warp_smoke.fluid.maccormack import MacCormack
from warp_smoke.launch import Launcher

wp.set_module_options({"enable_backward": False})


@wp.func
def _sample_unlimited(a: wp.array3d[float], x: float, y: float, z: float):
    """Returns the tricubic value of a at (x, y, z)."""
    value, _, _ = sample_cubic(a, x, y, z)
    return value


class UnlimitedCubic(SemiLagrangian):
    """`CubicSemiLagrangian` without its limiter."""

    _kernel = sampling_kernel(_sample_unlimited, __name__)


class UnlimitedMacCormack(MacCormack):
    """`MacCormack` without its limiter, except in cells near solids."""

    def __init__(self, launcher: Launcher, *args, **options):
        """Allocates; arguments as for `SemiLagrangian`."""
        super().__init__(launcher, *args, **options)
        for least, most in self._bounds.values():
            least.fill_(-inf)
            most.fill_(inf)

    def _make_guess(self, samples, field: wp.array, limits: tuple, ambient: float) -> None:
        (shape, block), guess = samples.carried, self._guess[samples]
        self._launcher.launch(sample_back, shape, block, self._back, field, *limits, ambient, guess)
        if self._boundary and samples is self._cells:
            self._boundary.sample(self._back, field, limits, ambient, (guess, guess, guess))


class UnlimitedBfecc(UnlimitedMacCormack, Bfecc):
    """`Bfecc` without its limiter."""


# By the name of the limited scheme.
UNLIMITED_SCHEMES = {
    "semi_lagrangian_cubic": UnlimitedCubic,
    "maccormack": UnlimitedMacCormack,
    "bfecc": UnlimitedBfecc,
}
