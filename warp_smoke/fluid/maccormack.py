"""MacCormack's method, limited to the range of the cell at the start of the trace.

A. Selle, R. Fedkiw, B. Kim, Y. Liu, J. Rossignac, *An Unconditionally Stable MacCormack Method*, 2008 (with its two
ways to limit the result).
"""

from math import ceil, inf, prod

import warp as wp

from warp_smoke.fluid.advection import SemiLagrangian, end_of_trace
from warp_smoke.fluid.grid import Block
from warp_smoke.fluid.halo import copy_samples
from warp_smoke.fluid.interpolation import blend, corners, fraction, greater, lesser, mixed, sample, settle, within
from warp_smoke.fluid.runge_kutta import trace_both_ways
from warp_smoke.fluid.samples import Samples
from warp_smoke.fluid.trace import Displacement, make_displacement
from warp_smoke.launch import Launcher, Rows, bits, dense, dense_store

wp.set_module_options({"enable_backward": False})

# Samples that interpolation reads beyond the end of a trace, and round-off.
_STENCIL = 2
# The distance over which samples are read is rounded up to this, so that few different launches are recorded.
_ALIGNMENT = 4


@wp.kernel
def _guess(
    rows: Rows,
    block: Block,
    d: Displacement,
    a: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
    ambient: float,
    a_out: wp.array3d[float],
    least_out: wp.array3d[float],
    most_out: wp.array3d[float],
):
    """Like `sample_back`, with the range of the eight samples around x + d, or a_out as both bounds outside a."""
    i, j, c = wp.tid()
    i += rows.first + block.first[0]
    j += block.first[1]
    out = dense_store(a_out)
    least = dense_store(least_out)
    most = dense_store(most_out)
    k = wp.max(block.first[2] + c * rows.run, 0)
    end = wp.min(k + rows.run, block.stop)
    while k < end:
        x, y, z, inside = end_of_trace(block, d, i, j, k, a, lower, upper)
        a000, a001, a010, a011, a100, a101, a110, a111 = corners(a, x, y, z)
        fx = fraction(x, a.shape[0])
        fy = fraction(y, a.shape[1])
        fz = fraction(z, a.shape[2])
        value = blend(a000, a001, a010, a011, a100, a101, a110, a111, fx, fy, fz)
        value = settle(mixed(ambient, value, inside))
        low = lesser(lesser(lesser(a000, a001), lesser(a010, a011)), lesser(lesser(a100, a101), lesser(a110, a111)))
        high = greater(greater(a000, a001), greater(a010, a011))
        high = greater(high, greater(greater(a100, a101), greater(a110, a111)))
        out[i, j, k] = bits(value)
        least[i, j, k] = bits(wp.where(inside < 1.0, value, low))
        most[i, j, k] = bits(wp.where(inside < 1.0, value, high))
        k += 1


@wp.func
def half_error(
    block: Block,
    e: Displacement,
    i: int,
    j: int,
    k: int,
    a: wp.array3d[float],
    guess: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
):
    """Returns half the error of advecting a field forth and back, ½ (a(x) − guess(x + e)).

    It fades out as x + e leaves the samples.
    """
    old = dense(a)
    x, y, z, inside = end_of_trace(block, e, i, j, k, guess, lower, upper)
    return 0.5 * inside * (old[i, j, k] - sample(guess, x, y, z))


@wp.func
def clamped(value: float, low: float, high: float, _guess: float):
    """Clamps the value to [low, high]."""
    return within(value, low, high)


@wp.func
def reverted(value: float, low: float, high: float, guess: float):
    """Returns the value if it is in [low, high], else the guess."""
    return wp.where(within(value, low, high) == value, value, guess)


def limited_kernel(value: wp.Function, limit: wp.Function, module: str) -> wp.Kernel:
    """Makes the kernel of a second-order scheme from its formula and its limiter.

    Args:
        value: (block, d, i, j, k, a, guess, lower, upper) → new value of sample (i, j, k).
        limit: `clamped` or `reverted`.
        module: name of the module that the kernel is compiled with.
    """

    @wp.kernel(name=f"{value.key}_{limit.key}", module=wp.get_module(module))
    def carry(
        rows: Rows,
        block: Block,
        d: Displacement,
        a: wp.array3d[float],
        guess: wp.array3d[float],
        least: wp.array3d[float],
        most: wp.array3d[float],
        lower: wp.vec3,
        upper: wp.vec3,
        a_out: wp.array3d[float],
    ):
        """Limited: a_out(x) = value(x), limited to [least, most]."""
        i, j, c = wp.tid()
        i += rows.first + block.first[0]
        j += block.first[1]
        new = dense(guess)
        low = dense(least)
        high = dense(most)
        out = dense_store(a_out)
        k = wp.max(block.first[2] + c * rows.run, 0)
        end = wp.min(k + rows.run, block.stop)
        while k < end:
            found = value(block, d, i, j, k, a, guess, lower, upper)
            out[i, j, k] = bits(settle(limit(found, low[i, j, k], high[i, j, k], new[i, j, k])))
            k += 1

    return carry


@wp.func
def corrected(
    block: Block,
    e: Displacement,
    i: int,
    j: int,
    k: int,
    a: wp.array3d[float],
    guess: wp.array3d[float],
    lower: wp.vec3,
    upper: wp.vec3,
):
    """MacCormack: guess(x) + ½ (a(x) − guess(x + e))."""
    new = dense(guess)
    return new[i, j, k] + half_error(block, e, i, j, k, a, guess, lower, upper)


_clamped, _reverted = (limited_kernel(corrected, limit, __name__) for limit in (clamped, reverted))


class MacCormack(SemiLagrangian):
    """Order 2: a semi-Lagrangian guess minus half its error, which is found by advecting the guess back again.

    The result stays within the range of the samples around the point where the trace began: a scalar is clamped, which
    keeps it sharp; velocity falls back to its guess, as clamping it would let noise grow in the flow.
    """

    def __init__(self, launcher: Launcher, shape: tuple[int, int, int], *args, **options):
        """Allocates; arguments as for `SemiLagrangian`."""
        super().__init__(launcher, shape, *args, **options)
        self._reach = 0  # how far from an advected sample the guess is read
        self._ahead = make_displacement(launcher, shape)
        self._guess = {samples: launcher.zeros(samples.shape, "advection") for samples in self._spare}
        size = max(prod(samples.shape) for samples in self._spare)
        bounds = [launcher.zeros(size, "advection") for _ in range(2)]
        self._bounds = {
            samples: [each[: prod(samples.shape)].reshape(samples.shape) for each in bounds] for samples in self._spare
        }

    def trace(self, velocity: tuple, step: float, courant: float = inf) -> None:
        """Traces through one step both ways."""
        reach = min(3.0 * courant, max(self._cells.shape)) + _STENCIL  # forward traces are 2 s u longer
        self._reach = ceil(reach / _ALIGNMENT) * _ALIGNMENT
        super().trace(velocity, step, courant)

    def _trace(self, velocity: tuple, step: float) -> None:
        launcher, scheme, limits = self._launcher, self._scheme, self._trace_limits
        trace_both_ways(launcher, scheme, self._traced, velocity, step, limits, *self._ways())

    def _ways(self) -> tuple[Displacement, Displacement]:
        return self._back, self._ahead

    def _carry(self, samples: Samples, field: wp.array, limits: tuple, ambient: float, new: wp.array) -> None:
        copy_samples(self._launcher, samples.near(self._reach), field, self._guess[samples])
        self._make_guess(samples, field, limits, ambient)
        self._continue(samples, field, self._guess[samples])
        self._correct(samples, field, limits, new)

    def _make_guess(self, samples: Samples, field: wp.array, limits: tuple, ambient: float) -> None:
        """Makes the first-order guess, and the bounds of the result."""
        (shape, block), guess, bounds = samples.carried, self._guess[samples], self._bounds[samples]
        self._launcher.launch(_guess, shape, block, self._back, field, *limits, ambient, guess, *bounds)
        if self._boundary and samples is self._cells:
            self._boundary.sample(self._back, field, limits, ambient, (guess, *bounds))

    def _correct(self, samples: Samples, field: wp.array, limits: tuple, new: wp.array) -> None:
        """Makes the new field from the guess, within the bounds.

        Args:
            samples: where the field is sampled.
            field: the old field.
            limits: where backward traces may end, for fields that extend beyond open sides.
            new: the new field, written.
        """
        (shape, block), guess, bounds = samples.carried, self._guess[samples], self._bounds[samples]
        correct = _clamped if samples is self._cells else _reverted
        args = (self._ahead, field, guess, *bounds, *samples.limits, new)
        self._launcher.launch(correct, shape, block, *args)
