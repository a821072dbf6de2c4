"""Back and forth error compensation and correction, limited to the range of the cell at the start of the trace.

T. F. Dupont, Y. Liu, *Back and Forth Error Compensation and Correction Methods*, 2003; B. Kim, Y. Liu, I. Llamas,
J. Rossignac, *FlowFixer: Using BFECC for Fluid Simulation*, 2005.
"""

import warp as wp

from warp_smoke.fluid.advection import end_of_trace
from warp_smoke.fluid.grid import Block
from warp_smoke.fluid.halo import copy_samples
from warp_smoke.fluid.interpolation import sample
from warp_smoke.fluid.maccormack import MacCormack, clamped, half_error, limited_kernel, reverted
from warp_smoke.fluid.trace import Displacement
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _compensate(
    rows: Rows,
    block: Block,
    e: Displacement,
    a: wp.array3d[float],
    guess: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    a_out: wp.array3d[float],
):
    """Compensation: a_out(x) = a(x) + ½ (a(x) − guess(x + e))."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    old = dense(a)
    out = dense_store(a_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        out[i, j, k] = bits(old[i, j, k] + half_error(block, e, i, j, k, a, guess, lower, upper))
        k += 1


@wp.func
def compensated(
    block: Block,
    d: Displacement,
    i: int,
    j: int,
    k: int,
    a: wp.array3d[float],
    _guess: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
):
    """BFECC: a(x + d), where a is the compensated field."""
    x, y, z, _ = end_of_trace(block, d, i, j, k, a, lower, upper)
    return sample(a, x, y, z)


_clamped, _reverted = (limited_kernel(compensated, limit, __name__) for limit in (clamped, reverted))


class Bfecc(MacCormack):
    """Order 2: advects the field after subtracting half the error of advecting it forth and back.

    The result is limited as by `MacCormack`: scalars are clamped, velocity falls back to the first-order guess.
    """

    def __init__(self, launcher: Launcher, *args, **options):
        """Allocates; arguments as for `SemiLagrangian`."""
        super().__init__(launcher, *args, **options)
        # Not shared: faces on closed sides are never written and must stay 0.
        self._better = {samples: launcher.zeros(samples.shape, "advection") for samples in self._spare}

    def _correct(self, samples, field: wp.array, limits: tuple, new: wp.array) -> None:
        (shape, block), guess, bounds = samples.carried, self._guess[samples], self._bounds[samples]
        better = self._better[samples]
        copy_samples(self._launcher, samples.near(self._reach), field, better)
        self._launcher.launch(_compensate, shape, block, self._ahead, field, guess, *samples.limits, better)
        self._continue(samples, field, better)
        limited = _clamped if samples is self._cells else _reverted
        self._launcher.launch(limited, shape, block, self._back, better, guess, *bounds, *limits, new)
