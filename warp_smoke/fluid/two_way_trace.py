"""Traces both ways at once: where the smoke came from in one step, and where it goes.

The forward trace follows from the backward one. The backward displacement is d = −s u + ½ s² u·∇u + O(s³), s = dt / h,
and the forward one is e = s u + ½ s² u·∇u + O(s³): their difference is 2 s u.
"""

import warp as wp

from warp_smoke.fluid.grid import Block
from warp_smoke.fluid.trace import Displacement, by_midpoint, face_sums, shortened, store_displacement
from warp_smoke.launch import Rows

wp.set_module_options({"enable_backward": False})


def two_way_kernel(rule: wp.Function, module: str) -> wp.Kernel:
    """Makes the kernel that traces both ways by an integration rule; arguments as for `tracing_kernel`."""

    @wp.kernel(name=f"trace_both_ways_{rule.key}", module=wp.get_module(module))
    def trace(
        rows: Rows,
        block: Block,
        u: wp.array3d[float],
        v: wp.array3d[float],
        w: wp.array3d[float],
        step: float,
        lower: wp.vec3,
        upper: wp.vec3,
        d_out: Displacement,
        e_out: Displacement,
    ):
        """Displacement d by the rule and e = d + 2 s u(x), s = dt / h, x + d and x + e kept within [lower, upper]."""
        i, j, c = wp.tid()
        i += rows.first + block.first[0]
        j += block.first[1]
        k = wp.max(block.first[2] + c * rows.run, 0)
        end = wp.min(k + rows.run, block.stop)
        while k < end:
            d = shortened(i, j, k, rule(u, v, w, step, i, j, k), lower, upper)
            e = shortened(i, j, k, d + step * face_sums(u, v, w, i, j, k), lower, upper)
            store_displacement(i, j, k, d, d_out)
            store_displacement(i, j, k, e, e_out)
            k += 1

    return trace


trace_both_ways_by_midpoint = two_way_kernel(by_midpoint, __name__)
